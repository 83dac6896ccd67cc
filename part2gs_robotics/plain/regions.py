"""Regions: pieces of a photo of one even colour, and what lies on both sides of their rims."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.plain.kernels import NOTHING

EVEN = 3 / 255  # of the colour range between neighbours: shading changes by less
NOISE = 2.0  # times the quarter of neighbours that differ least: three in four are linked by it
LEAST = 1e-3  # of the photo's pixels: smaller ones have rims of too few
RIM = 80  # places along a rim that are looked at
WITHIN = 150  # places within that are looked at
INSIDE, BESIDE = 0.75, 2.0  # pixels from the outermost own ones: photos blur edges by one
LEAST_RIM = 8  # places: of fewer, a plane is chance
CLEAR = 0.06  # of the colour range: a fainter rim matches anywhere


@dataclass(frozen=True)
class Region:
    """A piece of a photo of even colour.

    Attributes:
        pixels: [N, 2] column and row.
        within: [M, 2] some of them.  colors: [M, 3] theirs.
        rim: [2, P, 2] places inside the rim and beside them outside it, pixels.
        sides: [2, P, 3] colours there, NOTHING beside the object.
        length: places that were looked at, P of which show a clear edge.
    """

    pixels: I64
    within: I64
    colors: F64
    rim: F64
    sides: F64
    length: int


def regions_of(image: F32, rng: np.random.Generator) -> list[Region]:
    """Return the regions of a photo, none of which is small.

    Args:
        image: [H, W, 3], NOTHING outside the object.
        rng: picks the places that are looked at.
    """
    labels = _labels(image)
    count = np.bincount(labels[labels >= 0])
    found = (_region(image, labels == k, rng) for k in np.flatnonzero(count >= LEAST * labels.size))
    return [one for one in found if one is not None]


def _labels(image: F32) -> I64:
    """Return [H, W] numbers of pieces whose neighbouring pixels differ little, -1 outside."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    solid = image[..., 0] < NOTHING
    pixels = np.arange(solid.size).reshape(solid.shape)
    steps, ends = list[F32](), list[I64]()
    for one, other in (((slice(None), slice(1, None)), (slice(None), slice(None, -1))),
                       ((slice(1, None),), (slice(None, -1),))):
        both = solid[one] & solid[other]
        steps.append(np.abs(image[one] - image[other]).max(-1)[both])
        ends.append(np.stack([pixels[one][both], pixels[other][both]]))
    step = np.concatenate(steps)
    if not len(step):
        return np.full(solid.shape, -1)
    even = step < max(EVEN, NOISE * float(np.quantile(step, 0.25)))
    linked = np.concatenate(ends, 1)[:, even]
    graph = coo_matrix((np.ones(linked.shape[1], bool), tuple(linked)), (solid.size, solid.size))
    labels = connected_components(graph, directed=False)[1].reshape(solid.shape).astype(np.int64)
    return np.where(solid, labels, -1)


def _region(image: F32, mask: Mask, rng: np.random.Generator) -> Region | None:
    """Return the region of a mask; None if too little of its rim is clear."""
    import cv2

    rows, columns = np.nonzero(mask)
    top, left = int(rows.min()), int(columns.min())
    piece = np.pad(mask[top:rows.max() + 1, left:columns.max() + 1], 3).astype(np.uint8)
    depth = (cv2.distanceTransform(piece, cv2.DIST_L2, 5)
             - cv2.distanceTransform(1 - piece, cv2.DIST_L2, 5))
    down, right = np.gradient(cv2.GaussianBlur(depth, (0, 0), 1.0))
    edge = piece - cv2.erode(piece, np.ones((3, 3), np.uint8))
    at = np.stack(np.nonzero(edge), 1)
    at = at[rng.permutation(len(at))[:RIM]]
    inward = np.stack([right[tuple(at.T)], down[tuple(at.T)]], 1)
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-6)
    place = at[:, ::-1] + [left - 3.0, top - 3.0]
    rim = np.stack([place + INSIDE * inward, place - BESIDE * inward])
    sides = np.stack([_colors(image, one) for one in rim])
    clear = np.abs(sides[0] - sides[1]).max(1) > CLEAR
    if clear.sum() < LEAST_RIM:
        return None
    pixels = np.stack([columns, rows], 1)
    within = pixels[rng.permutation(len(pixels))[:WITHIN]]
    colors = image[within[:, 1], within[:, 0]].astype(float)
    rim, sides = (np.ascontiguousarray(one[:, clear]) for one in (rim, sides))
    return Region(pixels, within, colors, rim, sides, len(at))


def _colors(image: F32, places: F64) -> F64:
    """Return [P, 3] colours at places, NOTHING beside the object; beyond the photo, its border."""
    import cv2

    near = places.astype(np.float32)[None]
    seen = cv2.remap(image, near[..., 0], near[..., 1], cv2.INTER_LINEAR,
                     borderMode=cv2.BORDER_REPLICATE)[0]
    return np.where(seen.max(1, keepdims=True) > 1.0, NOTHING, seen).astype(float)
