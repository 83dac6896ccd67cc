"""Straight edges of the object: their directions, from segments in all photos of both states.

An edge's picture and the camera span a plane that its direction lies in. Parallel edges make a
family; a few dozen segments of a family tell its direction to a hundredth of a degree, where a
fitted wall is bent by a tenth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.segments import Segments
from part2gs_robotics.model.arrays import F64

PIXEL = 0.1  # pixels: an end of a segment is known that well
LENS = 3e-4  # rad: three hundredths of a pixel along a hundred: none is straighter
STRAIGHT = np.deg2rad(0.02)  # rad, of joints beside edges: median 0.005 deg, 8 of 65 above 0.03
WIDTHS = np.deg2rad([1.0, 1.0, 0.5, 0.5, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25])  # of the kernel
RING = np.deg2rad(3.0)  # rad: segments up to there tell how many are near by chance
PEAK = np.deg2rad(0.5)  # rad: segments nearer to a direction are in its peak
OWN = 15  # segments that a family has beyond chance
CLEAR = 3.0  # times as many segments in the peak as chance puts there
SAME = np.deg2rad(1.5)  # rad: seeds nearer to each other end in one family
STAYED = np.deg2rad(3.0)  # rad: a family farther from its seed is another one
APART = np.sin(np.deg2rad(5.0))  # planes that meet at less do not tell a direction
PAIRS = 2000  # a family of a twentieth of all segments is shared by five of them
VOTE = np.deg2rad(0.5)  # rad, of a segment's plane
MOST = 8  # families: three of a box, two of every open door
TRIED = 60  # seeds: what more find are chance's
_QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a . _QUARTER . b is the sine between a and b


@dataclass(frozen=True)
class Bundle:
    """Segments of both states as the planes that their directions lie in.

    Attributes:
        pictures: [N, 2, 3] picture of a world direction at a segment's middle, pixels.
        ways: [N, 2] unit direction of the segment in its picture.
        deepest: [N, 3] third row: how fast the picture's scale changes along a world direction.
        planes: [N, 3] unit normal of the plane of a segment and its camera.
        lengths: [N] pixels.
        cameras: [N] number of the camera, counted through both states.
    """

    pictures: F64
    ways: F64
    deepest: F64
    planes: F64
    lengths: F64
    cameras: NDArray[np.int64]


def bundled(states: Sequence[Segments]) -> Bundle:
    """Return the segments of all states together."""
    parts, first = [], 0
    for s in states:
        middle, way = s.ends.mean(1), s.ends[:, 1] - s.ends[:, 0]
        rays = s.Ks[s.views] @ s.viewmats[s.views, :3, :3]
        pictures = rays[:, :2] - middle[:, :, None] * rays[:, 2:]
        lengths = np.linalg.norm(way, axis=1)
        way = way / lengths[:, None]
        planes = (way[:, None] @ _QUARTER @ pictures)[:, 0]
        planes /= np.linalg.norm(planes, axis=1)[:, None]
        parts.append((pictures, way, rays[:, 2], planes, lengths, s.views + first))
        first += len(s.Ks)
    return Bundle(*(np.concatenate(p) for p in zip(*parts, strict=True)))


def edge_families(bundle: Bundle, rng: np.random.Generator) -> list[tuple[F64, F64]]:
    """Return direction [3] and covariance [3, 3] (rad^2) of families of parallel edges.

    Args:
        bundle: of both states.
        rng: picks the pairs of segments whose common direction is tried.

    Returns:
        The family with most segments first, MOST at most.
    """
    tried, found = list[F64](), list[tuple[F64, F64]]()
    for seed in _voted(bundle, rng):
        if len(found) == MOST or len(tried) == TRIED:
            break
        if all(abs(seed @ other) < np.cos(SAME) for other in (*tried, *(d for d, _ in found))):
            tried.append(seed)
            family = _family(bundle, seed)
            if family and all(abs(family[0] @ d) < np.cos(SAME / 3) for d, _ in found):
                found.append(family)
    return found


def _voted(bundle: Bundle, rng: np.random.Generator) -> F64:
    """Return [S, 3] directions that two segments share, those that most others share first."""
    planes = bundle.planes
    if len(planes) < OWN:
        return np.zeros((0, 3))
    one, two = (planes[rng.integers(len(planes), size=PAIRS)] for _ in range(2))
    seeds = np.cross(one, two)
    size = np.linalg.norm(seeds, axis=1)
    seeds = seeds[size > APART] / size[size > APART, None]
    votes = np.concatenate([(np.abs(planes @ part.T) < VOTE).sum(0)
                            for part in np.array_split(seeds, max(1, len(seeds) // 250))])
    return np.asarray(seeds[np.argsort(-votes, kind="stable")])


def _family(bundle: Bundle, seed: F64) -> tuple[F64, F64] | None:
    """Return direction and covariance of the family nearest to a seed, None if there is none."""
    d = seed
    for width in WIDTHS:
        gaps, slopes, errors = looked_at(bundle, np.broadcast_to(d, (len(bundle.lengths), 3)))
        weights = 1 / (1 + (gaps / np.maximum(width, 2 * errors)) ** 2) ** 2 / errors**2
        sides = np.linalg.svd(d[None])[2][1:]
        jac = slopes @ sides.T
        h = jac.T @ (jac * weights[:, None]) + np.eye(2) / RING**2
        d = d - np.linalg.solve(h, jac.T @ (weights * gaps)) @ sides
        d = d / np.linalg.norm(d)
    own, chance = _counts(gaps)
    if abs(d @ seed) < np.cos(STAYED) or own - chance < OWN or own < CLEAR * chance:
        return None
    # Segments of one view share its camera's error: what each view asks for, not each segment.
    asked = np.zeros((int(bundle.cameras.max()) + 1, 2))
    np.add.at(asked, bundle.cameras, jac * (weights * gaps)[:, None])
    inverse = np.linalg.inv(h)
    spread = inverse @ (asked.T @ asked) @ inverse + STRAIGHT**2 * np.eye(2)
    return d, sides.T @ spread @ sides


def looked_at(bundle: Bundle, directions: F64) -> tuple[F64, F64, F64]:
    """Return [N] rad between segments and pictures of directions, [N, 3] slopes, [N] errors.

    Args:
        bundle: of N segments.
        directions: [N, 3] unit.
    """
    picture = np.einsum("njk,nk->nj", bundle.pictures, directions)
    far = np.maximum(np.linalg.norm(picture, axis=1), 1e-9)
    unit = picture / far[:, None]
    sine = unit[:, 0] * bundle.ways[:, 1] - unit[:, 1] * bundle.ways[:, 0]
    cosine = (unit * bundle.ways).sum(1)
    gaps = np.arcsin(np.clip(sine * np.sign(cosine), -1.0, 1.0))
    normal = np.stack([unit[:, 1], -unit[:, 0]], 1) / far[:, None]
    slopes = np.einsum("nj,njk->nk", normal, bundle.pictures)
    depth = (bundle.deepest * directions).sum(1)
    errors = np.sqrt(PIXEL**2 * (12 / bundle.lengths**2 + (depth / far) ** 2) + LENS**2)
    return gaps, slopes, errors


def _counts(gaps: F64) -> tuple[int, float]:
    """Return how many segments are in a peak, and how many chance puts there."""
    size = np.abs(gaps)
    own, ring = int((size < PEAK).sum()), int((size < RING).sum())
    return own, (ring - own) * float(PEAK / (RING - PEAK))
