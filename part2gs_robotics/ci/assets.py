"""Check several assets side by side; what was checked before is read back."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.ci.accepted import Baseline, disabled
from part2gs_robotics.ci.cache import kept, key_of, load
from part2gs_robotics.errors import CheckError

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport


@dataclass(frozen=True)
class Wishes:
    """How assets are checked.

    Attributes:
        steps: positions per joint of the overlap sweep.
        samples: draws of the joints from their standard deviations; 0 = none.
        jobs: assets at a time; 0 = one a core.
        cache: folder of earlier results; None = check anew.
        disabled: reason by id of every check whose failures do not count.
        baseline: file of known failures; None = none is known.
        rewrite: accept what fails now: write it into the baseline.
    """

    steps: int = 21
    samples: int = 0
    jobs: int = 0
    cache: Path | None = None
    disabled: Mapping[str, str] = field(default_factory=dict)
    baseline: Path | None = None
    rewrite: bool = False


def check_assets(paths: Sequence[Path], wishes: Wishes) -> list[CheckReport]:
    """Return one report per path, in their order.

    Raises:
        CheckError: a path, the cache, the baseline or the id of a disabled check cannot be used.
    """
    for path in paths:
        if not path.exists():  # said before minutes are spent on the others
            raise CheckError(f"{path}: does not exist. Needed a twin folder, an MJCF or a URDF "
                             "file; check the path.")
    known = Baseline.read(wishes.baseline, wishes.rewrite)
    reports = [disabled(report, wishes.disabled) for report in _checked(paths, wishes)]
    if wishes.rewrite:
        known = known.rewritten(reports)
    return [known.accepted(report) for report in reports]


def _checked(paths: Sequence[Path], wishes: Wishes) -> list[CheckReport]:
    began = time.perf_counter()
    keys = [key_of(path, wishes.steps, wishes.samples) if wishes.cache else "" for path in paths]
    found = [load(wishes.cache, key) for key in keys]
    # Relabelled: the same content may lie somewhere else today.
    reports = [None if report is None else
               replace(report, path=str(path), seconds=time.perf_counter() - began,
                       notes=(*report.notes, "from the cache: nothing it depends on has changed"))
               for path, report in zip(paths, found, strict=True)]
    missing = [i for i, report in enumerate(reports) if report is None]
    fresh = _side_by_side([paths[i] for i in missing], wishes)
    for i, report in zip(missing, fresh, strict=True):
        reports[i] = report
        if wishes.cache:
            kept(wishes.cache, keys[i], report)
    return [report for report in reports if report is not None]


def _side_by_side(paths: Sequence[Path], wishes: Wishes) -> list[CheckReport]:
    one = partial(check_one, steps=wishes.steps, samples=wishes.samples)
    jobs = min(wishes.jobs or os.cpu_count() or 1, len(paths))
    if jobs < 2:
        return [one(path) for path in paths]
    # Spawned: a fork would inherit locks of the engine's and numpy's threads.
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        return list(pool.map(one, paths))


def check_one(path: Path, steps: int, samples: int) -> CheckReport:
    """Return the report of one asset, chances included where they are wanted."""
    from part2gs_robotics.sim_checks import check

    report = check(path, steps=steps)
    if not samples:
        return report
    from part2gs_robotics.chance import chances

    began = time.perf_counter()
    rows = chances(path, samples)
    return replace(report, results=(*report.results, *rows),
                   seconds=report.seconds + time.perf_counter() - began)
