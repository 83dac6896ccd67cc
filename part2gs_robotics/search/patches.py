"""Search: motions of one joint that explain what left and what arrived.

A surfel of state 1 has *arrived* where state 0 saw free space, one of state 0 was *vacated*
where state 1 sees free space; what was never observed says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.evidence.faces import on_edge
from part2gs_robotics.evidence.landing import Landing, score_moves, score_turns
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint

SLIDE_STEP = 0.01  # of the diagonal: half the search tolerance
TURN_STEP = np.deg2rad(5.0)  # a patch at half a diagonal moves 4 % of the diagonal
MAX_SLIDE = 0.6  # of the diagonal: longer than any drawer of the object itself
KEPT = 12  # motions per axis and kind: the next ones land a patch beside the best
MAX_TURN = np.deg2rad(180.0)  # either way: every turn there is


def slides(axes: F64, diag: float) -> list[Joint]:
    """Return all prismatic hypotheses along the axes, both ways."""
    steps = np.arange(SLIDE_STEP, MAX_SLIDE, SLIDE_STEP) * diag
    return [
        Joint("prismatic", a, np.zeros(3), float(s * d))
        for a in axes for d in steps for s in (1, -1)
    ]


def turns(axis: F64, lo: F64, hi: F64, step: float) -> tuple[F64, F64, F64, F64]:
    """Return turns about parallel axes: rotations, and the shifts that follow them.

    Args:
        axis: [3] of all.
        lo: corner of the box that the axes pass.
        hi: the opposite corner.
        step: between neighbouring axes, scene units.

    Returns:
        Pivots [P, 3], angles [A], rotations [A, 3, 3], shifts [P, A, 3].
    """
    basis = np.linalg.svd(axis[None])[2][1:]
    centre = (lo + hi) / 2
    corners = np.array(
        [
            [lo, hi][b][i]
            for a in range(8)
            for i, b in enumerate([(a >> 2) & 1, (a >> 1) & 1, a & 1])
        ]
    )
    corners = corners.reshape(8, 3) - centre
    flat = corners @ basis.T
    axes = [
        np.arange(flat[:, i].min() - step, flat[:, i].max() + 1.5 * step, step) for i in range(2)
    ]
    u, v = np.meshgrid(*axes, indexing="ij")
    pivots = centre + u.reshape(-1, 1) * basis[0] + v.reshape(-1, 1) * basis[1]
    angles = np.arange(-MAX_TURN, MAX_TURN - 1e-9, TURN_STEP)
    angles = angles[np.abs(angles) > 0.5 * TURN_STEP]
    rots = np.stack([se3.rotation_from_rotvec(axis * a) for a in angles])
    return pivots, angles, rots, pivots[:, None] - np.einsum("aij,pj->pai", rots, pivots)


@dataclass(frozen=True)
class Aim:
    """What a patch is moved into.

    Attributes:
        target: landing grid of the other state.
        box: corners of the box that axes of turns pass.
        diag: of the object.  tau: matching distance, and step between axes; scene units.
        forward: True if the patch is of state 0 (moves map 0 to 1), else the inverse is tried.
    """

    target: Landing
    box: tuple[F64, F64]
    diag: float
    tau: float
    forward: bool


def search_patch(patch: Surfels, aim: Aim, axes: F64, straight: F64 | None = None,
                 keep: int = KEPT) -> list[tuple[float, Joint]]:
    """Return the best motions of one patch with their costs, best first.

    Args:
        patch: surfels of the source state.
        aim: where it may land.
        axes: [D, 3] candidate axes.
        straight: [E, 3] those of the axes that edges have.
        keep: motions kept per axis and kind.
    """
    out: list[tuple[float, Joint]] = []
    flip = 1.0 if aim.forward else -1.0
    guesses = slides(axes, aim.diag)
    costs = score_moves(np.stack([g.move for g in guesses]), patch, aim.target, aim.tau)
    for i in np.argsort(costs)[: 2 * keep]:
        g = guesses[i]
        slide = Joint("prismatic", g.axis, patch.points.mean(0), flip * g.value,
                      held=on_edge(g.axis, straight))
        out.append((float(costs[i]), slide))
    for axis in axes:
        held = on_edge(axis, straight)
        pivots, angles, rots, shifts = turns(axis, *aim.box, aim.tau)
        costs = score_turns(rots, shifts, patch, aim.target, aim.tau)
        for i in np.argsort(costs)[:keep]:
            p, a = divmod(int(i), len(angles))
            turn = Joint("revolute", axis, pivots[p], flip * float(angles[a]), held=held)
            out.append((float(costs[i]), turn))
    return sorted(out, key=lambda pair: pair[0])
