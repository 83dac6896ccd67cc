"""Part solids: evidence on a grid -> signed distances that are closed by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.carve import F32, F64, Solid
from part2gs_robotics.fuse import TRUNCATION, Fused

SMOOTHING = 0.7  # voxels: below one voxel, so that walls of two voxels survive
MIN_WEIGHT = 0.5  # half a view that faces the surface: less is an edge seen at a grazing angle
DEEP_SHARE = 0.9  # of the views that cannot see a point: inside a part nearly all end on that part
DEEP_VIEWS = 3  # fewer may all look from one side, and then the depth behind it is unknown
SMALLEST = 0.01  # share of the volume below which a separate piece is noise
UNSEEN_SMOOTHING = 2.5  # voxels: wider than the streaks that single views' shadows leave
FIN = 2  # voxels: half the thickness below which an unobserved sheet is a leftover, not a wall
THIN = 1.0  # voxels of signed distance given to an observed surface too thin for the grid


def moving_solid(fused: Fused) -> Solid:
    """Return the solid of a moving part: what its own surfaces bound, never more.

    Behind a surface seen from one side only, the part is as thick as the truncation. Deeper points
    belong to it when nearly every view that cannot see them ends on this part.
    """
    hidden = fused.hidden_own + fused.hidden_other
    deep = (fused.hidden_own >= DEEP_VIEWS) & (fused.hidden_own >= DEEP_SHARE * hidden)
    return _solid(fused, deep)


def base_solid(fused: Fused) -> Solid:
    """Return the solid of the base: everything nobody saw free and no other part claims."""
    return _solid(fused, fused.weight + fused.hidden_own + fused.hidden_other > 0)


def _solid(fused: Fused, filled: NDArray[np.bool_]) -> Solid:
    from scipy import ndimage

    unseen = np.where(filled, np.float32(TRUNCATION), np.float32(-TRUNCATION))
    values = _thicken(_settle(fused, unseen), fused)
    values[ndimage.binary_fill_holes(values > 0) & (values <= 0)] = TRUNCATION
    return calm(Solid(fused.grid, values), fused)


def calm(solid: Solid, fused: Fused) -> Solid:
    """Return the solid smoothed: a little at observed surfaces, strongly elsewhere.

    Where nobody saw a surface, the border between seen free and unknown is the ragged outline of
    a few views' shadows.
    """
    from scipy import ndimage

    values = solid.values
    fine = ndimage.gaussian_filter(values, SMOOTHING, truncate=3.0)
    near = ndimage.binary_dilation(fused.own > MIN_WEIGHT, iterations=2)
    share = ndimage.gaussian_filter(near.astype(np.float32), 1.0, truncate=2.0)
    rough = ndimage.gaussian_filter(values, UNSEEN_SMOOTHING, truncate=2.0)
    smooth = np.asarray(share * fine + (1 - share) * rough, np.float32)
    return replace(solid, values=smooth)


def without_fins(solid: Solid, seen: Fused) -> Solid:
    """Return the solid without unobserved sheets thinner than the grid can hold.

    Neighbouring sweeps leave such fins between them in what nobody saw.
    """
    from scipy import ndimage

    inside = solid.values > 0
    thick = ndimage.binary_dilation(ndimage.binary_erosion(inside, iterations=FIN),
                                    iterations=FIN + 1)
    fin = inside & ~thick & (seen.own < MIN_WEIGHT)
    return replace(solid, values=np.where(fin, np.float32(-TRUNCATION), solid.values))


def _settle(fused: Fused, unseen: F32) -> F32:
    """Return distances in voxels where observed, `unseen` elsewhere, less what others claim."""
    values = np.where(fused.weight > MIN_WEIGHT, fused.distance / np.float32(fused.grid.voxel),
                      unseen)
    votes = fused.own + fused.other
    share = (fused.own - fused.other) / np.maximum(votes, np.float32(MIN_WEIGHT))
    claimed = (votes > MIN_WEIGHT) & (values > 0)
    limit = np.float32(TRUNCATION) * share
    return np.clip(np.where(claimed, np.minimum(values, limit), values), -TRUNCATION,
                   TRUNCATION).astype(np.float32)


def _thicken(values: F32, fused: Fused) -> F32:
    """Give an observed surface with no solid beside it the least thickness the grid can hold."""
    from scipy import ndimage

    near = np.abs(fused.distance) < 0.75 * fused.grid.voxel
    surface = near & (fused.own > 2 * MIN_WEIGHT) & (fused.own > fused.other)
    lost = surface & ~ndimage.binary_dilation(values > 0.5, iterations=2)
    # One more voxel all round: smoothing takes that much off a sheet of single voxels.
    sheet = ndimage.binary_dilation(lost) if lost.any() else lost
    return np.where(sheet, np.maximum(values, np.float32(THIN)), values)


def keep_large(solid: Solid) -> Solid:
    """Return the solid without separate pieces below a share of its volume."""
    from scipy import ndimage

    pieces, count = ndimage.label(solid.values > 0)
    if count <= 1:
        return solid
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    keep = sizes >= min(SMALLEST * sizes.sum(), sizes.max())
    keep[0] = True
    return replace(solid, values=np.where(keep[pieces], solid.values, np.float32(-TRUNCATION)))


def without_voids(solid: Solid) -> Solid:
    """Return the solid with rooms that nothing can reach filled: nobody can have seen them."""
    from scipy import ndimage

    inside = solid.values > 0
    void = ndimage.binary_fill_holes(inside) & ~inside
    # Half a voxel inside: the level set passes between the filled voxels and nothing else.
    return replace(solid, values=np.where(void, np.float32(0.5), solid.values))


def cavity(solid: Solid, fused: Fused) -> NDArray[np.bool_]:
    """Return the voxels seen free inside the convex hull of a part: the room inside a drawer.

    What is empty in one state moves with the part, so the base cannot fill it in the other.
    """
    from scipy.spatial import ConvexHull, QhullError

    inside = solid.values > 0
    empty = (fused.distance < -0.9 * TRUNCATION * fused.grid.voxel) & (fused.weight > 2) & ~inside
    points = np.argwhere(inside)
    candidates = np.argwhere(empty)
    if len(points) < 4 or not len(candidates):
        return np.zeros_like(inside)
    try:
        planes = _few_planes(ConvexHull(_thin_out(points)).equations)
    except QhullError:  # a flat part has no inside
        return np.zeros_like(inside)
    within = np.ones(len(candidates), bool)
    for plane in planes:
        within[within] = candidates[within] @ plane[:3] + plane[3] < -0.5
    out = np.zeros_like(inside)
    out[tuple(candidates[within].T)] = True
    return out


def _thin_out(points: NDArray[np.int64]) -> F64:
    """Return the points that are extreme along their own row of voxels, enough for a hull."""
    order = np.lexsort(points.T[::-1])
    rows = points[order]
    change = np.any(rows[1:, :2] != rows[:-1, :2], axis=1)
    ends = np.concatenate([[True], change]) | np.concatenate([change, [True]])
    return np.asarray(rows[ends], np.float64)


def _few_planes(planes: F64) -> F64:
    """Return the distinct planes of a hull; voxel corners repeat each of them many times."""
    return np.unique(np.round(planes, 6), axis=0)


def clear_cavity(base: Solid, seen: Fused, room: NDArray[np.bool_], part: Solid,
                 part_from_base: F64) -> Solid:
    """Return the base without the part's cavity, where the base itself was never observed.

    Args:
        base: solid to change.
        seen: evidence about the base, on the same grid.
        room: cavity of the part, on its grid.
        part: solid of the part.
        part_from_base: [4, 4] in the state at which the cavity is emptied.
    """
    index = np.argwhere((base.values > 0) & (seen.weight <= MIN_WEIGHT))
    points = base.grid.centers(index) @ part_from_base[:3, :3].T + part_from_base[:3, 3]
    at = np.rint((points - part.grid.lo) / part.grid.voxel).astype(np.int64)
    fits = np.all((at >= 0) & (at < room.shape), axis=1)
    index, at = index[fits], at[fits]
    hit = room[tuple(at.T)]
    values = base.values.copy()
    values[tuple(index[hit].T)] = -TRUNCATION
    return replace(base, values=values)
