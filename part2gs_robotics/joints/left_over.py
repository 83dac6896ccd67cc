"""Left over: what of the moved surface the final joints do not explain, and where.

A surfel is contradicted where its part's motion takes it to a place that the other state saw empty.
Noise makes such places too, so every body of them is heard by the photos: the other state's
Gaussians, moved by the joints, look wrong there or they do not, measured by what this scene shows
in one place in both states. What was hidden in the other state counts neither way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.canonical import SIDE, VIEWS, Canonical
from part2gs_robotics.evidence.cross_render import cross_errors, floor_of, shown
from part2gs_robotics.evidence.depth_maps import MIN_VIEWS, observe
from part2gs_robotics.evidence.graph import ON, build_graph, seen_in
from part2gs_robotics.evidence.light import Light
from part2gs_robotics.evidence.surfaces import FREE_TOLERANCE
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels, Mask
from part2gs_robotics.model.kinematics import part_motions
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.small_views import chosen, small_views
from part2gs_robotics.runtime.side_by_side import side_by_side

BODY = 0.5  # of a surfel's neighbours: a body has area, noise comes in specks and along edges
# Deviations from what both states show, by its median: a part in a wrong place hides much of that.
SIGMAS, NORMAL = 3.0, 0.6745
# Of the diagonal: panes of glass come to lie 0.015 to 0.05 from where the other state has them.
SHAPE = 0.04
ASIDE = 1.5  # surfels: the nearest one of a plane is that far to the side at most, and noise
LEAST = 0.01  # of the moved surface: noise made at most 0.0022 of 11 builds with all parts


@dataclass(frozen=True)
class Surface:
    """Every surfel of both states under the joints, state 1 after state 0.

    Attributes:
        moved: [N] whether it moved, by its part or by what the other state saw in its place.
        contradicted: [N] whether the other state saw its new place empty.
        agrees: [N] whether the other state saw a surface there.
        shape: [N] see `shaped`.
        errors: [N] how wrong photos show its place, 0..1; NaN = no photo does.
        neighbors: [N, k] rows.
    """

    moved: Mask
    contradicted: Mask
    agrees: Mask
    shape: Mask
    errors: F64
    neighbors: NDArray[np.int32]

    def share(self, mask: Mask) -> float:
        """Return how much of the moved surface a mask is."""
        return float((mask & self.moved).sum() / max(int(self.moved.sum()), 1))


def left_over(both: Canonical, motion: Motion) -> LeftOver:
    """Return what the joints leave unexplained.

    Args:
        both: states, comparable.
        motion: final joints, and the part of every Gaussian.
    """
    surface = surface_under(both, motion)
    bad, bound = sorted_out(surface)
    marked = [marks(both, state, own) for state, own in
              enumerate(np.split(bad, [len(both.surfaces.surfels[0])]))]
    return LeftOver(surface.share(bad), bound,
                    (marked[0][0], marked[1][0]), (marked[0][1], marked[1][1]))


def sorted_out(surface: Surface) -> tuple[Mask, float]:
    """Return [N] the bodies that nothing explains, and the most that noise makes of their share.

    Noise is what is contradicted though photos show nothing wrong, or a part's own poor shape. By
    chance it looks as wrong as some of what agrees does.
    """
    spots = surface.contradicted & (surface.contradicted[surface.neighbors].mean(1) >= BODY)
    number = bodies(spots, surface.neighbors)
    known = surface.errors[surface.agrees & ~surface.contradicted & np.isfinite(surface.errors)]
    usual = SIGMAS / NORMAL * float(np.median(known)) if len(known) else 0.0
    wrong = np.nan_to_num(surface.errors) > usual
    count = np.bincount(number[spots], minlength=len(spots))
    worse, near = (np.bincount(number[spots & m], minlength=len(count)) > 0.5 * count
                   for m in (wrong, surface.shape))
    bad = spots & (worse & ~near)[number]
    chance = float((known > usual).mean()) if len(known) else 0.0
    return bad, LEAST + chance * surface.share(spots & ~bad)


def bodies(mask: Mask, neighbors: NDArray[np.int32]) -> Labels:
    """Return [N] the number of the connected piece of a mask that every surfel of it is in.

    Args:
        mask: [N].
        neighbors: [N, k] rows.
    """
    rows, cols = np.repeat(np.arange(len(mask)), neighbors.shape[1]), neighbors.ravel()
    on = mask[rows] & mask[cols]
    graph = csr_matrix((np.ones(int(on.sum()), np.int8), (rows[on], cols[on])),
                       shape=(len(mask), len(mask)))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def surface_under(both: Canonical, motion: Motion) -> Surface:
    """Return every surfel of both states under the joints. Arguments as of `left_over`."""
    seen, moves = both.surfaces, part_motions(motion.joints, motion.parents)
    labels = [_labels(both, motion, state) for state in (0, 1)]
    rows = [_votes(both, state, own, moves) for state, own in enumerate(labels)]
    free, met, before = (np.concatenate([row[i] for row in rows]) for i in range(3))
    hard = np.concatenate(labels)
    errors = side_by_side([partial(_errors, both, motion, state, moves) for state in (0, 1)])
    return Surface(before | free | ((hard > 0) & met), free, met,
                   shaped(both, labels, moves), np.concatenate(errors),
                   build_graph(seen.surfels).neighbors)


def _labels(both: Canonical, motion: Motion, state: int) -> Labels:
    """Return [N_s] the part of every surfel of a state: that of the nearest Gaussian."""
    near = cKDTree(both.gaussians[state].means).query(both.surfaces.surfels[state].points)[1]
    return motion.labels(state)[near]


def _there(state: int, moves: list[F64]) -> list[F64]:
    return moves if state == 0 else [se3.inverse(move) for move in moves]


def _votes(both: Canonical, state: int, labels: Labels, moves: list[F64],
           ) -> tuple[Mask, Mask, Mask]:
    """Return [N_s] which surfels the other state saw past, met, and saw past where they were."""
    seen = both.surfaces
    points, there = seen.surfels[state].points, np.stack(_there(state, moves))[labels]
    moved = np.einsum("nij,nj->ni", there[:, :3, :3], points) + there[:, :3, 3]
    new, old = (observe(p, seen.maps[1 - state], FREE_TOLERANCE * seen.diag)
                for p in (moved, points))
    return ((new.free >= MIN_VIEWS) & (new.free > 2 * new.surface),
            (new.surface >= MIN_VIEWS) & (new.surface > 2 * new.free),
            (old.free >= MIN_VIEWS) & (old.free > 2 * old.surface))


def shaped(both: Canonical, labels: list[Labels], moves: list[F64]) -> Mask:
    """Return [N] which surfels a moving part would take near to itself in the other state.

    Its own in any direction; others only along its normals: beside a part of poor shape, glass most
    of all, labels are as poor, and what a joint explains is no sign of another.

    Args:
        both: states.
        labels: per state, [N_s] the part of every surfel.
        moves: [4, 4] per part, of state 0 into state 1.
    """
    surfels, diag = both.surfaces.surfels, both.surfaces.diag
    out = [np.zeros(len(own), bool) for own in labels]
    for state in (0, 1):
        for k, move in enumerate(_there(state, moves)[1:], 1):
            theirs = surfels[1 - state].select(labels[1 - state] == k)
            if not len(theirs):
                continue
            points = se3.apply(move, surfels[state].points)
            gaps, near = cKDTree(theirs.points).query(points, distance_upper_bound=SHAPE * diag)
            found = np.flatnonzero(np.isfinite(gaps))
            near = near[found]
            along = np.einsum("ni,ni->n", points[found] - theirs.points[near], theirs.normals[near])
            aside = np.sqrt(np.maximum(gaps[found] ** 2 - along**2, 0.0))
            fits = (labels[state][found] == k) | (aside < ASIDE * both.surfel_size * diag)
            out[state][found[fits]] = True
    return np.concatenate(out)


def _errors(both: Canonical, motion: Motion, state: int, moves: list[F64]) -> F64:
    """Return [N_s] how wrong the other state's Gaussians look where photos show each surfel."""
    seen, other = both.surfaces, 1 - state
    own, maps = seen.surfels[state], seen.maps[state]
    near = cKDTree(seen.surfels[other].points).query(both.gaussians[other].means)[1]
    normals = seen.surfels[other].normals[near]
    light = Light(np.array(motion.shades), (normals, normals))
    there = _there(other, moves)
    splats, facing = shown(other, both.seen[other], motion.labels(other), there, light)
    views = small_views(both.scene.states[state], VIEWS, SIDE)
    views = replace(views, floor=floor_of(both.seen[state], views))
    total, count = np.zeros(len(own)), np.zeros(len(own))
    scale = views.alphas.shape[1] / maps.depths.shape[1]
    index = chosen(both.scene.states[state], VIEWS)
    for v, costs in zip(index, cross_errors(splats, views, facing), strict=True):
        spots, shows = seen_in(own, maps, int(v), ON * seen.diag)
        col, row = (np.minimum((spots * scale).astype(int), np.array(costs.shape[::-1]) - 1)).T
        total[shows] += costs[row[shows], col[shows]]
        count[shows] += 1
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def marks(both: Canonical, state: int, mask: Mask) -> tuple[int, Mask]:
    """Return the photo of a state that shows most of some surfels, -1 = none, and where, [H, W].

    Args:
        both: states, comparable.
        state: 0 or 1.
        mask: [N_s] the surfels.
    """
    seen = both.surfaces
    own, maps = seen.surfels[state].select(mask), seen.maps[state]
    out: NDArray[np.bool_] = np.zeros(maps.depths.shape[1:], bool)
    if not len(own):
        return -1, out
    shows = [seen_in(own, maps, v, ON * seen.diag) for v in range(len(maps))]
    best = int(np.argmax([on.sum() for _, on in shows]))
    spots = shows[best][0][shows[best][1]]
    out[spots[:, 1], spots[:, 0]] = True
    return best, _filled(out, both.surfel_size * seen.diag * maps.Ks[best, 0, 0]
                         / float(np.median(maps.depths[best][out])))


def _filled(mask: Mask, pixels: float) -> Mask:
    """Return a mask of points grown to discs as wide as the surfels, so that none is between."""
    import cv2

    size = 2 * int(np.ceil(pixels)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc) > 0
