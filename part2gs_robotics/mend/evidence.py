"""Evidence of a failed check: at which joint positions which parts overlap, and how deep."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.model.kinematics import moving_parts, part_transforms
from part2gs_robotics.model.solids import FLAKE, size_of, to_manifold
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks.geometry import lighter, overlap, place
from part2gs_robotics.sim_checks.interpenetration import LIMIT
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.subject import SWEEP_TOLERANCE

if TYPE_CHECKING:
    from manifold3d import Manifold

ROWS = ("overlap", "observed state")  # checks whose failures carving can mend
SHALLOW = 0.03  # of the size: deeper is a wrong joint or a part in another's way, never carved
GRAZE = 2e-4  # of the size: a tenth of what the check allows is left alone
COMBINATIONS = 64  # of random joint positions, as many as the check draws
STEPS = 21  # of a joint's range, as in the check
WAITS = " waits for other joints"  # of a note, after the joint's name


@dataclass(frozen=True)
class Evidence:
    """Two parts that overlap.

    Attributes:
        positions: of the moving parts, rad or units.  pair: parts.  depth: units.
    """

    positions: tuple[float, ...]
    pair: tuple[int, int]
    depth: float


def copies(twin: Twin) -> list[Manifold]:
    """Return the parts' solids as the check takes them: dense ones simplified."""
    size = size_of(tuple(part.mesh for part in twin.parts))
    return [lighter(to_manifold(part.mesh), SWEEP_TOLERANCE * size)[0].as_original()
            for part in twin.parts]


def failing(report: CheckReport) -> dict[str, float]:
    """Return the depth of overlap, of the size, by what a failing row is about; "" = all joints."""
    return {row.subject: LIMIT * row.value / row.limit for row in report.results
            if row.name in ROWS and row.status == "fail" and row.value is not None and row.limit}


def evidence_of(twin: Twin, report: CheckReport) -> list[Evidence]:
    """Return where parts overlap at the poses that failed, as far as it is shallow.

    Args:
        twin: what was checked, in the units of the report or a multiple of them.
        report: its checks.
    """
    rows = failing(report)
    size = size_of(tuple(part.mesh for part in twin.parts))
    solids = copies(twin)
    found = []
    for positions in _poses(twin, rows, _waiting(report)):
        poses = part_transforms(twin, positions)
        placed = [place(s, p).as_original() for s, p in zip(solids, poses, strict=True)]
        for pair in combinations(range(len(placed)), 2):
            both = overlap(placed[pair[0]], placed[pair[1]], FLAKE * size).solid
            if both is not None and (
                    GRAZE * size < (deep := depth(both)) <= SHALLOW * size):
                found.append(Evidence(tuple(positions), pair, deep))
    return found


def _poses(twin: Twin, rows: dict[str, float], late: set[str]) -> list[list[float]]:
    """Return joint positions that failing rows are about: states, sweeps and combinations.

    Args:
        twin: moving parts and their ranges.
        rows: what fails.
        late: joints that wait for others; these are then at state 1, else at state 0.
    """
    moving = moving_parts(twin)
    ends = [joint.value if (joint := twin.parts[i].joint) else 0.0 for i in moving]
    names = [f"{twin.parts[i].name}_joint" for i in moving]
    limits = np.array([twin.parts[i].limits for i in moving])
    start = [0.0] * len(moving)
    out = [start, ends] if set(rows) & {"state_0", "state_1"} else []
    for at in (i for i, name in enumerate(names) if name in rows):
        others = ends if names[at] in late else start
        out += [[*others[:at], float(q), *others[at + 1:]]
                for q in np.linspace(limits[at, 0], limits[at, 1], STEPS)]
    rng = np.random.default_rng(0)  # the check's own draws: the same poses
    for turn in range(COMBINATIONS if "" in rows else 0):
        waited = bool(turn % 2) and bool(late)
        out.append([float(rng.uniform(*limits[i])) if (name in late) == waited else rest
                    for i, (name, rest) in enumerate(
                        zip(names, ends if waited else start, strict=True))])
    return out


def _waiting(report: CheckReport) -> set[str]:
    """Return the joints that wait for others, which a check tells in its notes alone."""
    return {note.partition(WAITS)[0] for note in report.notes if WAITS in note}
