"""Fill: values for texels that no photo shows, and for the space between the charts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, Mask
from part2gs_robotics.texture.atlas import GUTTER, Atlas

STRIDE = 4  # texels between those that look for neighbours; values spread over those between
MOST_TOLD = 60_000  # known texels that may be asked: a cap on time alone
TURN = 0.1  # of the size: as far away as a texel that faces another way by a right angle
SPREADING = GUTTER + STRIDE  # steps of one texel that values spread
NEAREST = 8  # seen texels that an unseen one takes its colour from


def fill(atlas: Atlas, colors: F32, seen: Mask, backup: F32) -> NDArray[np.uint8]:
    """Return the [H, W, 3] picture of a part, without holes or seams.

    Unseen texels take the colours of the nearest seen ones of the surface that face alike; then
    colours spread over the charts' borders, so that no filter of a renderer mixes in anything else.

    Args:
        atlas: of the part.
        colors: [T, 3] 0..255 of its texels.
        seen: [T] texels with a colour.
        backup: [3] 0..255 colour of a part that no photo shows.
    """
    asking = sparse(atlas, ~seen) if seen.any() else np.zeros(len(seen), bool)
    found = from_nearest(atlas, colors, seen, asking, NEAREST)
    pixels = np.concatenate([atlas.pixels[seen], atlas.pixels[asking]])
    mean = colors[seen].mean(0) if seen.any() else backup
    picture = spread(atlas, pixels, np.concatenate([colors[seen], found]), mean)
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def sparse(atlas: Atlas, wanted: Mask) -> Mask:
    """Return [T] some of the wanted texels: every one is a few texels from one of them."""
    rows, columns = np.divmod(atlas.pixels, atlas.shape[1])
    asking = wanted & (rows % STRIDE == 0) & (columns % STRIDE == 0)
    count = np.bincount(atlas.charts[asking], minlength=int(atlas.charts.max(initial=0)) + 1)
    return np.asarray(asking | (wanted & (count < 2)[atlas.charts]))  # small charts: all of them


def from_nearest(atlas: Atlas, values: F32, known: Mask, asking: Mask, count: int) -> F32:
    """Return [A, C] values of the nearest known texels of the surface that face alike.

    Args:
        atlas: of the part.
        values: [T, C] of its texels.
        known: [T] texels with a value.
        asking: [T] texels that want one.
        count: of neighbours whose values are mixed.
    """
    from scipy.spatial import cKDTree

    if not asking.any():
        return np.zeros((0, values.shape[1]), np.float32)
    told = np.flatnonzero(known)[::-(-int(known.sum()) // MOST_TOLD)]
    size = float(np.ptp(atlas.points, axis=0).max())
    place = np.concatenate([atlas.points, TURN * size * atlas.normals], 1)
    near = [*range(1, min(count, len(told)) + 1)]
    away, index = cKDTree(place[told]).query(place[asking], k=near)
    weight = 1.0 / np.maximum(away, 1e-6 * size) ** 2
    mixed = np.einsum("tk,tkc->tc", weight, values[told][index]) / weight.sum(1)[:, None]
    return np.asarray(mixed, np.float32)


def spread(atlas: Atlas, pixels: NDArray[np.int64], values: F32, mean: F32) -> F32:
    """Return the [H, W, C] picture with values at some pixels, spread over those around.

    Args:
        atlas: of the part.
        pixels: [n] flat indices.
        values: [n, C] of theirs, C <= 4.
        mean: [C] value far from all of them.
    """
    import cv2

    height, width = atlas.shape
    picture = np.zeros((height, width, values.shape[1]), np.float32)
    known = np.zeros((height, width), bool)
    picture.reshape(height * width, -1)[pixels], known.ravel()[pixels] = values, True
    for _ in range(SPREADING):
        weight = cv2.blur(known.astype(np.float32), (3, 3), borderType=cv2.BORDER_CONSTANT)
        fresh = ~known & (weight > 1e-6)
        around = cv2.blur(picture, (3, 3), borderType=cv2.BORDER_CONSTANT)
        picture[fresh] = around[fresh] / weight[fresh][:, None]
        known = known | fresh
    picture[~known] = mean
    return picture
