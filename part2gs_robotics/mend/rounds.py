"""Rounds of check and carve, until nothing overlaps or it gets no better."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mend.carve import carved
from part2gs_robotics.mend.evidence import evidence_of, failing
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport

Round = tuple[str, float]  # a sentence, and seconds
MOST_ROUNDS = 3  # shallow overlap is gone after one or two; what is left after three stays


def mendable(report: CheckReport) -> bool:
    """Return whether a check fails that carving can mend."""
    return bool(failing(report))


def mended(twin: Twin, report: CheckReport | None = None) -> tuple[Twin, tuple[Round, ...]]:
    """Return the twin, carved where its parts overlap, and what every round brought.

    A round that makes nothing better is taken back, and is the last.

    Args:
        twin: whose checks fail, in any unit; textures of carved parts are gone.
        report: of the twin as it was written, in any unit as well: slivers that overlap there may
            be rounded away here. None = it is checked here.
    """
    began, rounds = time.monotonic(), list[Round]()
    report = report or _draft(twin)
    while failing(report) and len(rounds) < MOST_ROUNDS:
        evidence = evidence_of(twin, report)
        trial = carved(twin, evidence)
        after = _draft(trial) if evidence else report
        before, now = (max(failing(r).values(), default=0.0) for r in (report, after))
        rounds.append((_said(len(rounds) + 1, len(evidence), (before, now)),
                       time.monotonic() - began))
        if now >= before:
            break
        twin, report, began = trial, after, time.monotonic()
    return twin, tuple(rounds)


def _said(number: int, places: int, depths: tuple[float, float]) -> str:
    left = f"{depths[1]:.2%} of the size" if depths[1] else "nothing beyond what is allowed"
    taken = ", taken back" if depths[1] >= depths[0] else ""
    return (f"Mending, round {number}: parts overlapped by {depths[0]:.2%} of the size; carved at "
            f"{places} poses, left {left}{taken}.")


def _draft(twin: Twin) -> CheckReport:
    """Return what the checks of overlap say of a twin, written to a folder of its own."""
    with TemporaryDirectory(prefix="part2gs-robot-") as folder:
        write_mjcf(twin, Path(folder))
        return check(Path(folder), only=("states", "overlap"))
