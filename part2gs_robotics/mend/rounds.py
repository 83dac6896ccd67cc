"""Rounds of check and carve, until nothing overlaps or it gets no better."""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mend.carve import carved
from part2gs_robotics.mend.evidence import evidence_of, failing
from part2gs_robotics.model.solids import size_of
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport

MOST_ROUNDS = 3  # shallow overlap is gone after one or two; what is left after three stays


def mendable(report: CheckReport) -> bool:
    """Return whether a check fails that carving can mend."""
    return bool(failing(report))


def mended(twin: Twin) -> tuple[Twin, tuple[str, ...]]:
    """Return the twin, carved where its parts overlap, and a sentence for every round.

    Args:
        twin: whose checks fail, in any unit; textures of carved parts are gone.
    """
    began = time.monotonic()
    report, notes = _draft(twin), list[str]()
    for number in range(1, MOST_ROUNDS + 1):
        evidence = evidence_of(twin, report)
        trial = carved(twin, evidence) if evidence else twin
        if all(a is b for a, b in zip(trial.parts, twin.parts, strict=True)):
            break
        after = _draft(trial)
        before, now = (max(failing(r).values(), default=0.0) for r in (report, after))
        size = size_of(tuple(part.mesh for part in twin.parts))
        notes.append(_said(number, len(evidence), (before / size, now / size),
                           time.monotonic() - began))
        if now >= before:
            notes.append(f"Mending, round {number}: no better, taken back.")
            break
        twin, report, began = trial, after, time.monotonic()
        if not failing(report):
            break
    return twin, tuple(notes)


def _said(number: int, places: int, depths: tuple[float, float], seconds: float) -> str:
    left = f"{depths[1]:.2%} of the size" if depths[1] else "nothing beyond what is allowed"
    return (f"Mending, round {number}: parts overlapped by {depths[0]:.2%} of the size; carved at "
            f"{places} poses, left {left}, {seconds:.1f} s.")


def _draft(twin: Twin) -> CheckReport:
    """Return what the checks of overlap say of a twin, written to a folder of its own."""
    with TemporaryDirectory(prefix="part2gs-robot-") as folder:
        write_mjcf(twin, Path(folder))
        return check(Path(folder), only=("states", "overlap"))
