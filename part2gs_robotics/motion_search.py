"""Hypothesis search: joint motions that explain what left and what arrived.

A surfel of state 1 has *arrived* where state 0 saw free space, one of state 0 was *vacated*
where state 1 sees free space; what was never observed says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics import se3
from part2gs_robotics.landing import Landing, score_moves, score_turns
from part2gs_robotics.surfels import Surfels

F64 = NDArray[np.float64]
SLIDE_STEP = 0.01  # of the diagonal: half the search tolerance
TURN_STEP = np.deg2rad(5.0)  # a patch at half a diagonal moves 4 % of the diagonal
PIVOT_STEP = 0.04  # of the diagonal
MAX_SLIDE = 0.6  # of the diagonal: longer than any drawer of the object itself
SCREW = 2  # kind of a hypothesis; grown from turns, never searched
MAX_TURN = np.deg2rad(180.0)


@dataclass(frozen=True)
class Hypothesis:
    """A one-degree-of-freedom motion, world_at_1_from_world_at_0.

    Attributes:
        kind: 0 = prismatic, 1 = revolute, 2 = screw.
        axis: [3] unit.  origin: [3].  value: rad or scene units.
        carrier: [4, 4] motion of the part that carries this one, None = the base.
        pitch: scene units per rad, screw only.
        held: whether the axis is that of straight edges, so that surfels need not find it.
    """

    kind: int
    axis: F64
    origin: F64
    value: float
    carrier: F64 | None = None
    pitch: float = 0.0
    held: bool = False

    @property
    def move(self) -> F64:
        """[4, 4] motion from state 0 to state 1."""
        return self.own if self.carrier is None else self.carrier @ self.own

    @property
    def own(self) -> F64:
        """[4, 4] motion beside the carrier, in the world at state 0."""
        if self.kind:
            return se3.screw_motion(self.axis, self.origin, self.value, self.pitch * self.value)
        return se3.make(np.eye(3), self.axis * self.value)


def directions(surfels: Surfels, patch: Surfels, rng: np.random.Generator, limit: int = 10,
               known: F64 | None = None) -> F64:
    """Return [D, 3] sign-free candidate axes: known ones, dominant normals, crosses, patch axes."""
    normals = surfels.normals[rng.permutation(len(surfels))[:3000]]
    found: list[F64] = []
    rest = normals
    while len(rest) > 0.02 * len(normals) and len(found) < limit:
        picks = rest[rng.permutation(len(rest))[:64]]
        votes = (np.abs(picks @ rest.T) > np.cos(np.deg2rad(8))).sum(1)
        best = picks[votes.argmax()]
        members = rest[np.abs(rest @ best) > np.cos(np.deg2rad(8))]
        mean = (members * np.sign(members @ best)[:, None]).mean(0)
        found.append(mean / np.linalg.norm(mean))
        rest = rest[np.abs(rest @ best) < np.cos(np.deg2rad(15))]
    strong = found[:4]
    found += [np.cross(a, b) for i, a in enumerate(strong) for b in strong[:i]]
    centred = patch.points - patch.points.mean(0)
    found += list(np.linalg.svd(centred, full_matrices=False)[2])
    first = list(known) if known is not None else []
    return _distinct(np.array([*first, *found]), np.deg2rad(6.0))


def on_edge(axis: F64, straight: F64 | None) -> bool:
    """Return whether an axis is one of the directions [E, 3] of edges."""
    return straight is not None and bool((np.abs(straight @ axis) > 1 - 1e-12).any())


def _distinct(axes: F64, angle: float) -> F64:
    out: list[F64] = []
    for axis in axes:
        norm = np.linalg.norm(axis)
        if norm > 0.3 and all(abs(axis @ o) / norm < np.cos(angle) for o in out):
            out.append(axis / norm)
    return np.array(out)


def slides(axes: F64, diag: float) -> list[Hypothesis]:
    """Return all prismatic hypotheses along the axes, both ways."""
    steps = np.arange(SLIDE_STEP, MAX_SLIDE, SLIDE_STEP) * diag
    return [
        Hypothesis(0, a, np.zeros(3), float(s * d)) for a in axes for d in steps for s in (1, -1)
    ]


def turns(axis: F64, lo: F64, hi: F64, diag: float) -> tuple[F64, F64, F64, F64]:
    """Return turns about parallel axes: rotations, and the shifts that follow them.

    Returns:
        Pivots [P, 3], angles [A], rotations [A, 3, 3], shifts [P, A, 3].
    """
    basis = np.linalg.svd(axis[None])[2][1:]
    centre, step = (lo + hi) / 2, PIVOT_STEP * diag
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


def search_patch(
    patch: Surfels,
    target: Landing,
    axes: F64,
    box: tuple[F64, F64],
    tau: float,
    forward: bool,
    keep: int = 12,
    straight: F64 | None = None,
) -> list[tuple[float, Hypothesis]]:
    """Return the best motions of one patch as (cost, hypothesis), best first.

    Args:
        patch: surfels of the source state.
        target: landing grid of the other state.
        axes: [D, 3] candidate axes.
        box: corners of the object.
        tau: matching distance in scene units.
        forward: True if the patch is of state 0 (moves map 0 to 1), else the inverse is tried.
        keep: hypotheses kept per axis and kind.
        straight: [E, 3] those of the axes that edges have.
    """
    diag = float(np.linalg.norm(box[1] - box[0]))
    out: list[tuple[float, Hypothesis]] = []
    flip = 1.0 if forward else -1.0
    guesses = slides(axes, diag)
    costs = score_moves(np.stack([g.move for g in guesses]), patch, target, tau)
    for i in np.argsort(costs)[: 2 * keep]:
        g = guesses[i]
        out.append((float(costs[i]), Hypothesis(0, g.axis, patch.points.mean(0), flip * g.value,
                                                held=on_edge(g.axis, straight))))
    for axis in axes:
        held = on_edge(axis, straight)
        pivots, angles, rots, shifts = turns(axis, *box, diag)
        costs = score_turns(rots, shifts, patch, target, tau)
        for i in np.argsort(costs)[:keep]:
            p, a = divmod(int(i), len(angles))
            out.append((float(costs[i]), Hypothesis(1, axis, pivots[p], flip * float(angles[a]),
                                                    held=held)))
    return sorted(out, key=lambda pair: pair[0])
