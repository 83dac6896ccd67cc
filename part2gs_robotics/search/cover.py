"""Choice of the motions that together explain the evidence, one part each."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.faces import directions
from part2gs_robotics.evidence.landing import UNEXPLAINED, Landing, land
from part2gs_robotics.evidence.study import FINE_TAU, Study
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.points import farthest
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.patches import Aim, search_patch
from part2gs_robotics.search.refine import refine

PATCH_RADIUS = 0.10  # of the diagonal: smaller than a drawer front, larger than a knob
PATCH_POINTS = 80  # enough to rank 1e5 hypotheses, few enough to do it in a second
LEAST_MOTION = (
    0.35  # trust lost per diagonal of way: a door swapped with its neighbour fits as well
)
PLACES = 8  # of each patch: the true one is among the first eight that differ
SEARCH_TAU = 0.04  # of the diagonal: the capture range of the coarse grid, and its step


def propose(study: Study, seeds: tuple[int, int], rng: np.random.Generator,
            patch_points: int = PATCH_POINTS) -> list[Joint]:
    """Return refined motions of patches spread over the evidence of both states.

    Args:
        study: what left and what arrived, and where it may land.
        seeds: patches of state 0 and of state 1.
        rng: picks patches.
        patch_points: surfels of a patch that rank the motions.
    """
    diag = float(np.linalg.norm(study.box[1] - study.box[0]))
    tasks: list[Callable[[], list[Joint]]] = []
    for state in (1, 0):
        surfels = study.evidence.sets[state]
        if len(surfels) < 20:
            continue
        for i in farthest(surfels.points, seeds[state], int(rng.integers(len(surfels)))):
            near = np.flatnonzero(
                ((surfels.points - surfels.points[i]) ** 2).sum(1) < (PATCH_RADIUS * diag) ** 2
            )
            if len(near) < 15:
                continue
            patch = surfels.select(rng.permutation(near)[:patch_points])
            axes = directions(study.lands[0].surfels, patch, rng,
                              known=study.straight.directions)
            local = surfels.select(rng.permutation(near)[:400])
            aim = Aim(study.lands[1 - state], study.box, diag, SEARCH_TAU * diag, state == 0)
            tasks.append(partial(_motions, study, patch, local, axes, aim))
    return [h for found in side_by_side(tasks) for h in found]


def landings(patch: Surfels, axes: F64, aim: Aim, straight: F64, count: int) -> list[Joint]:
    """Return the motions that land a patch best, in places that differ.

    Args:
        patch: surfels, in random order.
        axes: [D, 3] candidate axes.
        aim: where the patch may land.
        straight: [E, 3] those of the axes that edges have.
        count: at most.
    """
    ranked = search_patch(patch, aim, axes, straight)
    return [h for _, h in spread(ranked, count, patch.points, 0 if aim.forward else 1)]


def on_patch(h: Joint, local: Surfels, aim: Aim, study: Study) -> Joint:
    """Return a motion refined on surfels of one state."""
    empty = local.select(np.zeros(0, np.int64))
    sets = (local, empty) if aim.forward else (empty, local)
    return refine(h, sets, study.lands, (aim.tau, 0.5 * aim.tau), 3)


def _motions(study: Study, patch: Surfels, local: Surfels, axes: F64, aim: Aim) -> list[Joint]:
    """Return the motions of one patch of a state, refined on the evidence around it."""
    found = landings(patch, axes, aim, study.straight.directions, PLACES)
    return [on_patch(h, local, aim, study) for h in found]


def spread(
    ranked: list[tuple[float, Joint]], count: int, points: F64, state: int
) -> list[tuple[float, Joint]]:
    """Return the best hypotheses that move a patch of a state to different places.

    Args:
        ranked: cost and hypothesis, best first.
        count: at most.
        points: [N, 3] of the patch.
        state: that the patch is of.
    """
    out: list[tuple[float, Joint]] = []
    places: list[F64] = []
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for cost, h in ranked:
        moved = se3.apply(h.move if state == 0 else se3.inverse(h.move), points)
        if all(np.abs(moved - p).max() > 0.25 * size for p in places):
            out.append((cost, h))
            places.append(moved)
        if len(out) == count:
            break
    return out


def explained(
    h: Joint, evidence: Evidence, lands: tuple[Landing, Landing], tau: float
) -> tuple[F64, F64]:
    """Return what a motion saves per vacated and per arrived surfel, each >= 0."""
    zero, _, _ = land(h.move, evidence.vacated, lands[1], tau)
    one, _, _ = land(se3.inverse(h.move), evidence.arrived, lands[0], tau)
    return np.maximum(UNEXPLAINED - zero, 0), np.maximum(UNEXPLAINED - one, 0)


def saved_matrix(
    found: list[Joint], evidence: Evidence, lands: tuple[Landing, Landing], diag: float
) -> F64:
    """Return [H, n] what motions save per evidence surfel; long ways are trusted less."""
    rows = []
    for h in found:
        zero, one = explained(h, evidence, lands, FINE_TAU * diag)
        way0 = np.linalg.norm(
            se3.apply(h.move, evidence.vacated.points) - evidence.vacated.points, axis=1
        )
        back = se3.inverse(h.move)
        way1 = np.linalg.norm(
            se3.apply(back, evidence.arrived.points) - evidence.arrived.points, axis=1
        )
        trust = np.maximum(0.0, 1.0 - LEAST_MOTION / diag * np.concatenate([way0, way1]))
        rows.append(np.concatenate([zero, one]) * trust)
    size = len(evidence.vacated) + len(evidence.arrived)
    return np.array(rows).reshape(len(rows), size)


def cover(saved: F64, price: float) -> list[int]:
    """Return the rows whose best-of saves most: add, drop, swap until none helps.

    Args:
        saved: [H, n] what every row saves.
        price: of every row.
    """
    chosen: list[int] = []
    best = 0.0
    if len(saved) == 0:
        return chosen

    def value(rows: list[int]) -> float:
        return (float(saved[rows].max(0).sum()) if rows else 0.0) - price * len(rows)

    while True:
        bases = [chosen, *([c for c in chosen if c != d] for d in chosen)]
        trials: list[tuple[float, list[int]]] = [(value(b), b) for b in bases[1:]]
        for base in bases:
            floor = saved[base].max(0) if base else np.zeros(saved.shape[1])
            gains = np.maximum(saved, floor).sum(1) - price * (len(base) + 1)
            j = int(gains.argmax())
            trials.append((float(gains[j]), [*base, j]))
        score, rows = max(trials, key=lambda pair: pair[0])
        if score <= best + 1e-9:
            return chosen
        best, chosen = score, rows


def choose(
    found: list[Joint],
    evidence: Evidence,
    lands: tuple[Landing, Landing],
    diag: float,
    price: float,
    rounds: int = 3,
) -> list[tuple[Joint, float]]:
    """Return the chosen motions with the cost of doing without each.

    Facility location over the hypotheses; the chosen ones are refined on what they explain and
    compete again, so that a polished motion replaces its own rough copies.
    """
    pool = list(found)
    saved = saved_matrix(pool, evidence, lands, diag)
    for _ in range(rounds):
        fresh = []
        for c, own in _owners(saved, cover(saved, price)):
            fresh.append(
                refine(
                    pool[c],
                    _subset(evidence, own),
                    lands,
                    (0.02 * diag, FINE_TAU * diag, 0.01 * diag),
                    4,
                )
            )
        pool += fresh
        saved = (
            np.concatenate([saved, saved_matrix(fresh, evidence, lands, diag)]) if fresh else saved
        )
    rows = cover(saved, price)
    total = saved[rows].max(0).sum() if rows else 0.0
    return [
        (
            pool[c],
            float(
                total - (saved[[r for r in rows if r != c]].max(0).sum() if len(rows) > 1 else 0.0)
            ),
        )
        for c in rows
    ]


def _owners(saved: F64, rows: list[int]) -> list[tuple[int, NDArray[np.bool_]]]:
    best = saved[rows].max(0) if rows else np.zeros(saved.shape[1])
    return [(c, (saved[c] >= best - 1e-12) & (saved[c] > 0.05)) for c in rows]


def _subset(evidence: Evidence, own: NDArray[np.bool_]) -> tuple[Surfels, Surfels]:
    n0 = len(evidence.vacated)
    return evidence.vacated.select(own[:n0]), evidence.arrived.select(own[n0:])
