"""Check several assets side by side; what was checked before is read back."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.ci.accepted import Baseline, disabled
from part2gs_robotics.ci.alone import Request, check_alone, stop_all
from part2gs_robotics.ci.cache import kept, key_of, load
from part2gs_robotics.errors import CheckError
from part2gs_robotics.runtime.threads import in_threads

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport


@dataclass(frozen=True)
class Wishes:
    """How assets are checked.

    Attributes:
        steps: positions per joint of the overlap sweep.
        samples: draws of the joints from their standard deviations; 0 = none.
        stress: also the long rows: ten seconds of rest, slow drives.
        root: folder that nothing a model names may leave; None = that of each.
        jobs: assets at a time; 0 = one a core.
        cache: folder of earlier results; None = check anew.
        disabled: reason by id of every check whose failures do not count.
        baseline: file of known failures; None = none is known.
        rewrite: accept what fails now: write it into the baseline.
    """

    steps: int = 21
    samples: int = 0
    stress: bool = False
    root: Path | None = None
    jobs: int = 0
    cache: Path | None = None
    disabled: Mapping[str, str] = field(default_factory=dict)
    baseline: Path | None = None
    rewrite: bool = False


def check_assets(paths: Sequence[Path], wishes: Wishes) -> list[CheckReport]:
    """Return one report per path, in their order; one that cannot be used stops no other.

    Raises:
        CheckError: a path, the cache, the baseline or the id of a disabled check cannot be used.
    """
    for path in paths:
        if not path.exists():  # said before minutes are spent on the others
            raise CheckError(f"{path}: does not exist. Needed a twin folder, an MJCF, URDF or "
                             "USD file; check the path.")
    known = Baseline.read(wishes.baseline, wishes.rewrite)
    reports = [disabled(report, wishes.disabled) for report in _checked(paths, wishes)]
    if wishes.rewrite:
        known = known.rewritten(reports)
    return [known.accepted(report) for report in reports]


def _checked(paths: Sequence[Path], wishes: Wishes) -> list[CheckReport]:
    began = time.perf_counter()
    asked = [Request(str(path), str(wishes.root or ""), wishes.steps, wishes.samples, wishes.stress)
             for path in paths]
    keys = [key_of(request, wishes.cache) if wishes.cache else "" for request in asked]
    found = [load(wishes.cache, key) for key in keys]
    # Relabelled: the same content may lie somewhere else today.
    reports = [None if report is None else
               replace(report, path=str(path), seconds=time.perf_counter() - began,
                       notes=(*report.notes, "from the cache: nothing it depends on has changed"))
               for path, report in zip(paths, found, strict=True)]
    missing = [i for i, report in enumerate(reports) if report is None]
    fresh = in_threads([partial(check_alone, asked[i]) for i in missing], wishes.jobs, stop_all)
    for i, report in zip(missing, fresh, strict=True):
        reports[i] = report
        if wishes.cache and not report.unusable:  # more time or memory may help the next time
            kept(wishes.cache, keys[i], report)
    return [report for report in reports if report is not None]
