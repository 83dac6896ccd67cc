"""pytest plugin: `pytest twin/` collects a twin folder, one test per check.

Loaded by pytest wherever this package is installed, so it imports nothing else before a twin is
found, and looks at folders with twin.xml and twin.yaml alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return the collector of a twin folder; None leaves other folders to pytest."""
    if (path / "twin.xml").is_file() and (path / "twin.yaml").is_file():
        return TwinFolder.from_parent(parent, path=path)
    return None


class TwinFailed(Exception):
    """A check of a twin fails, or could not be measured."""


class TwinFolder(pytest.Directory):
    """A twin folder, checked once, by the first of its tests that runs."""

    _report: CheckReport | None = None

    def collect(self) -> Iterator[pytest.Item]:
        """Yield one test per check."""
        from part2gs_robotics.ci.accepted import ids

        for name in ids():
            yield TwinCheck.from_parent(self, name=name)

    def report(self) -> CheckReport:
        """Return what the checks say of the folder."""
        from part2gs_robotics.ci import Wishes, check_assets

        if self._report is None:
            self._report = check_assets([self.path], Wishes())[0]
        return self._report


class TwinCheck(pytest.Item):
    """All rows of one check."""

    def runtest(self) -> None:
        """Fail with the rows that fail; skip where no row is about this check."""
        from part2gs_robotics.sim_checks.result import format_row

        folder = self.parent
        assert isinstance(folder, TwinFolder)
        rows = [r for r in folder.report().results if r.to_dict()["id"] == self.name]
        bad = [r for r in rows if r.status in ("fail", "incomplete")]
        if bad:
            raise TwinFailed("\n".join(format_row(r) for r in bad))
        if all(r.status == "skipped" for r in rows):
            pytest.skip(rows[0].detail if rows else "no row of this twin is about it")
        for warned in (r for r in rows if r.status == "warn"):
            self.add_report_section("call", "check", format_row(warned))

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException],
                     style: object = None) -> str:
        """Return the rows alone: whoever checks a twin wants no traceback of ours."""
        return str(excinfo.value)

    def reportinfo(self) -> tuple[Path, int | None, str]:
        """Return where the check stands, for pytest's lines."""
        return self.path, None, f"{self.path.name}::{self.name}"
