"""Turns: how far a part's own straight edges turned between the states.

Two fitted surfaces bend differently, and the turn that lays one on the other is off by as much. An
edge across a hinge is seen in both states; the angle between its two directions is the turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.edges import CLEAR, PEAK, RING, STAYED, Bundle, bundled, looked_at
from part2gs_robotics.evidence import DepthMaps
from part2gs_robotics.gaussians import Gaussians
from part2gs_robotics.guides import BEND, followed
from part2gs_robotics.joints import Joint
from part2gs_robotics.segments import Segments

F64 = NDArray[np.float64]
BESIDE = 2.0  # pixels from an edge to the surface it belongs to
PLACES = np.array([0.15, 0.5, 0.85])  # along a segment: all three must be one part's
ACROSS = np.sin(np.deg2rad(20.0))  # edges across a hinge, by their ends' rough depth
ALIKE = np.cos(np.deg2rad(15.0))  # of a rough direction and the one on the segment's plane
VAGUE = np.deg2rad(1.0)  # rad: segments that tell an angle no better are left out
WIDTHS = np.deg2rad([1.0, 0.5, 0.5, 0.25, 0.25, 0.15, 0.15])  # of the kernel
FAR = 3.0  # standard deviations from the images' turn: farther, it is another edge's
# rad: what is left; a part has a few edges, seen many times. 0.004 to 0.1 deg seen, median 0.025.
TRUE = np.deg2rad(0.04)
LEAST = 8  # segments of either state that must agree


@dataclass(frozen=True)
class PartEdges:
    """Straight edges of one part in both states.

    Attributes:
        bundles: of both states.  ways: per state [N, 3] rough unit directions.
    """

    bundles: tuple[Bundle, Bundle]
    ways: tuple[F64, F64]


def part_edges(segments: Sequence[Segments], maps: Sequence[DepthMaps],
               gaussians: Sequence[Gaussians], labels: Sequence[NDArray[np.int64]], count: int,
               ) -> list[PartEdges]:
    """Return the edges of parts 1..count.

    Args:
        segments: of both states.
        maps: first surfaces of both states.
        gaussians: of both states.
        labels: [N_s] part of every Gaussian.
        count: number of moving parts.
    """
    ways, owners = zip(*(_placed(*state) for state in
                         zip(segments, maps, gaussians, labels, strict=True)), strict=True)
    edges = []
    for part in range(1, count + 1):
        one, two = (owner == part for owner in owners)
        edges.append(PartEdges((bundled([segments[0].select(one)]),
                                bundled([segments[1].select(two)])),
                               (ways[0][one], ways[1][two])))
    return edges


def _placed(segments: Segments, maps: DepthMaps, gaussians: Gaussians, labels: NDArray[np.int64],
            ) -> tuple[F64, NDArray[np.int64]]:
    """Return [N, 3] rough directions of a state's segments and [N] their parts, -1 = not clear."""
    ends, views = segments.ends, segments.views
    way = ends[:, 1] - ends[:, 0]
    across = np.stack([-way[:, 1], way[:, 0]], 1) / np.linalg.norm(way, axis=1)[:, None]
    at = ends[:, :1] + PLACES[:, None] * way[:, None]
    sides = [at + s * BESIDE * across[:, None] for s in (-1, 1)]
    depths = [_depths(maps, views, pixels) for pixels in sides]
    # The edge belongs to what is nearer.
    middle = [np.where(d[:, 1] > 0, d[:, 1], np.inf) for d in depths]
    first = (middle[0] <= middle[1])[:, None]
    depth, pixels = np.where(first, *depths), np.where(first[..., None], *sides)
    world_from_camera = np.linalg.inv(segments.viewmats)[views]
    rays = np.einsum("nij,npj->npi", np.linalg.inv(segments.Ks)[views],
                     np.concatenate([pixels, np.ones((*depth.shape, 1))], -1))
    points = np.einsum("nij,npj->npi", world_from_camera[:, :3, :3], rays * depth[..., None])
    points += world_from_camera[:, None, :3, 3]
    direction = points[:, -1] - points[:, 0]
    direction /= np.maximum(np.linalg.norm(direction, axis=1), 1e-12)[:, None]
    solid = gaussians.opacities > 0.5
    owner = labels[solid][cKDTree(gaussians.means[solid]).query(points)[1]]
    clear = (depth > 0).all(1) & (owner == owner[:, :1]).all(1)
    return direction, np.where(clear, owner[:, 0], -1)


def _depths(maps: DepthMaps, views: NDArray[np.int64], pixels: F64) -> F64:
    """Return [N, P] first-surface depth of pixels [N, P, 2], 0 outside."""
    height, width = maps.depths.shape[1:]
    cols, rows = (np.floor(pixels[..., i]).astype(int) for i in (0, 1))
    inside = (cols >= 0) & (cols < width) & (rows >= 0) & (rows < height)
    found = maps.depths[views[:, None], rows.clip(0, height - 1), cols.clip(0, width - 1)]
    return np.where(inside, found, 0.0).astype(np.float64)


def turn_of(edges: PartEdges, axis: F64, value: float) -> tuple[float, float] | None:
    """Return the turn about an axis near a given one, and its deviation, rad; None if unknown.

    Args:
        edges: of the part.
        axis: [3] unit, of the hinge.
        value: rad, a degree from the truth at most.
    """
    (one, errors_one, views_one), (two, errors_two, views_two) = (
        _angles(bundle, way, axis) for bundle, way in zip(edges.bundles, edges.ways, strict=True))
    if min(len(one), len(two)) < LEAST:
        return None
    base = 1 / (errors_one[:, None] ** 2 + errors_two**2)
    turn = value
    for width in WIDTHS:
        gaps = two - one[:, None] - turn
        gaps -= np.pi * np.round(gaps / np.pi)  # an edge has no sign
        weight = base / (1 + (gaps / width) ** 2) ** 2
        turn += float((weight * gaps).sum() / weight.sum())
    near, ring = np.abs(gaps) < PEAK, np.abs(gaps) < RING
    own = float(base[near].sum())
    chance = float(base[ring & ~near].sum() * PEAK / (RING - PEAK))
    few = min(near.any(1).sum(), near.any(0).sum()) < LEAST
    if few or own < CLEAR * chance or abs(turn - value) > STAYED:
        return None
    asked = weight * gaps
    spread = (_by_view(asked.sum(1), views_one) + _by_view(asked.sum(0), views_two))
    return turn, float(np.sqrt(spread / weight.sum() ** 2 + TRUE**2))


def turned(joint: Joint, h: F64, edges: PartEdges, diag: float) -> Joint:
    """Return the joint turned as far as its part's edges say, its place following.

    Args:
        joint: as in guides.squared, and h and diag.
        h: [P, P].
        edges: of the part.
        diag: scene units.
    """
    slides = joint.kind == "prismatic" or joint.carrier is not None  # a carrier turns edges too
    found = None if slides else turn_of(edges, joint.axis, joint.value)
    if found is None:
        return joint
    turn, error = found
    own = np.hypot(joint.sigma_value, BEND)  # infinite where the images do not show it
    gap = turn - joint.value
    if gap**2 > FAR**2 * (own**2 + error**2):
        return joint
    gain = 1.0 if np.isinf(own) else float(own**2 / (own**2 + error**2))
    moved = followed(joint, h, 2, np.array([gain * gap]), diag)
    return joint if moved is None else replace(moved, sigma_value=gain**0.5 * error)


def _by_view(asked: F64, views: NDArray[np.int64]) -> float:
    """Return the sum over views of the square of what each asks for."""
    return float((np.bincount(views, asked) ** 2).sum())


def _angles(bundle: Bundle, ways: F64, axis: F64) -> tuple[F64, F64, NDArray[np.int64]]:
    """Return angle about the axis, its error and the camera of every edge across it."""
    side = np.linalg.svd(axis[None])[2][1]
    up = np.cross(axis, side)
    across = np.cross(axis, bundle.planes)
    size = np.linalg.norm(across, axis=1)
    across /= np.maximum(size, 1e-9)[:, None]
    _, slopes, errors = looked_at(bundle, across)
    slope = np.abs((slopes * np.cross(axis, across)).sum(1))
    error = errors / np.maximum(slope, 1e-9)
    good = ((size > 1e-6) & (error < VAGUE) & (np.abs(ways @ axis) < ACROSS)
            & (np.abs((ways * across).sum(1)) > ALIKE))
    angle = np.arctan2(across @ up, across @ side)
    return angle[good], error[good], bundle.cameras[good]
