"""What fails and is accepted: known failures of a baseline file, checks disabled with a reason."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.agree.catalogue import CHECKS, check_id, explain
from part2gs_robotics.agree.finding import CheckResult
from part2gs_robotics.errors import CheckError
from part2gs_robotics.runtime.atomic import write_text_atomic

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport

BAD = ("fail", "incomplete")


@dataclass(frozen=True)
class Baseline:
    """Names of rows that are known to fail, by asset.

    Attributes:
        file: of the baseline; None = none.
        known: names by the asset's path from the file's folder.
    """

    file: Path | None
    known: Mapping[str, Sequence[str]]

    @classmethod
    def read(cls, file: Path | None, rewrite: bool) -> Baseline:
        """Return the known failures of a file.

        Raises:
            CheckError: it is not there, unless it is to be written, or holds something else.
        """
        if rewrite and file is None:
            raise CheckError("command line: --write-baseline has no file. Expected --baseline FILE "
                             "beside it; say where known failures are kept.")
        if file is None or (rewrite and not file.exists()):
            return cls(file, {})
        try:
            known = json.loads(file.read_text("utf-8"))["accepted"]
            names = {str(path): [str(name) for name in rows] for path, rows in known.items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as err:
            raise CheckError(f"{file}: is no baseline ({type(err).__name__}: {err}). Expected a "
                             "file of --write-baseline; write it again.") from err
        return cls(file, names)

    def rewritten(self, reports: Iterable[CheckReport]) -> Baseline:
        """Return a baseline of what fails now, written to its file.

        Other assets, and those that cannot be used, stay as known.
        """
        assert self.file is not None  # `read` has refused that
        now = {self._name(report): sorted({_row(r) for r in report.results if r.status in BAD})
               for report in reports if not report.unusable}
        known = {path: rows for path, rows in sorted((dict(self.known) | now).items()) if rows}
        text = json.dumps({"format": 1, "accepted": known}, indent=1)
        write_text_atomic(self.file, text + "\n")
        return replace(self, known=known)

    def accepted(self, report: CheckReport) -> CheckReport:
        """Return the report with known failures turned into warnings that say so."""
        if report.unusable:
            return report
        known = set(self.known.get(self._name(report), ())) if self.file else set()
        rows = tuple(replace(r, status="warn", detail=f"accepted by {self.file}: {r.detail}")
                     if r.status in BAD and _row(r) in known else r for r in report.results)
        gone = sorted(known - {_row(r) for r in report.results if r.status in BAD})
        notes = tuple(f"{self.file} accepts {name}, which does not fail any more" for name in gone)
        return replace(report, results=rows, notes=(*report.notes, *notes))

    def _name(self, report: CheckReport) -> str:
        assert self.file is not None
        return Path(os.path.relpath(report.path, self.file.parent)).as_posix()


def disabled(report: CheckReport, reasons: Mapping[str, str]) -> CheckReport:
    """Return the report with failures of disabled checks skipped; each row says the reason.

    An asset that cannot be used passes no check, so none is disabled for it.
    """
    if report.unusable:
        return report
    rows = []
    for found in report.results:
        reason = reasons.get(check_id(found.name))
        if reason is not None and found.status in BAD:
            said = f"disabled ({reason}); it said {found.status}: {found.detail}".rstrip(": ")
            found = replace(found, status="skipped", detail=said)
        rows.append(found)
    notes = tuple(f"{name} is disabled: {reason}" for name, reason in sorted(reasons.items()))
    return replace(report, results=tuple(rows), notes=(*report.notes, *notes))


def reasons_of(words: Iterable[str]) -> dict[str, str]:
    """Return the reason by id of words like `overlap=a strap that gives way`.

    Raises:
        CheckError: no such check, or no reason.
    """
    reasons = {}
    for word in words:
        name, _, reason = word.partition("=")
        explain(name)  # refuses an unknown id with the nearest one
        if not reason.strip():
            raise CheckError(f"--disable {name}: says no reason. Expected {name}=REASON; whoever "
                             "reads the report wants to know why.")
        reasons[check_id(name)] = reason.strip()
    return reasons


def ids() -> list[str]:
    """Return the id of every check."""
    return [check_id(name) for name in CHECKS]


def _row(result: CheckResult) -> str:
    return f"{result.name}: {result.subject}" if result.subject else result.name
