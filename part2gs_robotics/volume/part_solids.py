"""Part solids: evidence on a grid -> signed distances that are closed by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.grid import index_move
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.fuse import TRUNCATION, Fused

SMOOTHING = 1.0  # voxels, as much as rendered depth is wrong; walls of two voxels survive it
MIN_WEIGHT = 0.5  # half a view that faces the surface: less is an edge seen at a grazing angle
DEEP_SHARE = 0.9  # of the views that cannot see a point: inside a part nearly all end on that part
HULL_SHARE = 0.1  # the same inside the part's convex hull, where neighbours hide a lot
SMALLEST = 0.01  # share of the volume below which a separate piece is noise
SMALLEST_SEEN = 0.002  # of what views saw: noise of rims is a tenth of that, a rail five times
# Of a piece's voxels: true ones 0.4 to 1, a ball seen all round 0.25 up to 60 across, fill 0.09.
SHOWN = 0.25
UNSEEN_SMOOTHING = 2.5  # voxels: wider than the streaks that single views' shadows leave
FIN = 2  # voxels: half the thickness below which an unobserved sheet is a leftover, not a wall
THIN = 1.0  # voxels of signed distance given to an observed surface too thin for the grid


def moving_solid(fused: Fused) -> Solid:
    """Return the solid of a moving part: what its own surfaces bound.

    Behind a surface seen from one side only, the part is as thick as the truncation. Deeper, a
    point that nobody saw free belongs to it when nearly every view that misses the point ends on
    this part, or when it lies inside the convex hull of the part and this part hides it best.
    """
    shell = without_blobs(keep_large(_solid(fused, fused.enclosed >= DEEP_SHARE)), fused)
    unseen = (shell.values <= 0) & (fused.weight <= MIN_WEIGHT) & (fused.enclosed >= HULL_SHARE)
    inner = within_hull(shell, unseen)
    filled = np.where(inner, np.float32(TRUNCATION), shell.values)
    return without_blobs(keep_large(calm(replace(shell, values=filled), fused)), fused)


def base_solid(fused: Fused) -> Solid:
    """Return the solid of the base: everything nobody saw free and no other part claims."""
    return calm(_solid(fused, fused.weight + fused.hidden > 0), fused)


def _solid(fused: Fused, filled: NDArray[np.bool_]) -> Solid:
    from scipy import ndimage

    unseen = np.where(filled, np.float32(TRUNCATION), np.float32(-TRUNCATION))
    values = _thicken(_settle(fused, unseen), fused)
    values[ndimage.binary_fill_holes(values > 0) & (values <= 0)] = TRUNCATION
    return Solid(fused.grid, values)


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


def mended(before: Solid, after: Solid, fused: Fused) -> Solid:
    """Return a solid after carving, smoothed where the carving bit: noise leaves it in rags."""
    from scipy import ndimage

    bitten = ndimage.binary_dilation((before.values > 0) & (after.values <= 0), iterations=2)
    return replace(after, values=np.where(bitten, calm(after, fused).values, after.values))


def keep_large(solid: Solid, seen: Fused | None = None) -> Solid:
    """Return the solid without separate pieces below a share of its volume.

    Given evidence, a piece that is a share of what views saw of the part stays too: a rail between
    two doors is thin, and its ends may be hidden.
    """
    pieces, sizes = _pieces(solid)
    keep = sizes >= min(SMALLEST * sizes.sum(), sizes.max())
    if seen is not None:
        shown = _shown(pieces, len(sizes), seen)
        keep |= (shown > 0) & (shown >= SMALLEST_SEEN * shown.sum())
    return _only(solid, pieces, keep)


def without_blobs(solid: Solid, seen: Fused) -> Solid:
    """Return the solid of a moving part without separate pieces that views hardly saw.

    Fill that hangs in the air, in a room that the part closes, is a guess that no joint can hold.
    """
    pieces, sizes = _pieces(solid)
    keep = _shown(pieces, len(sizes), seen) >= SHOWN * sizes
    keep[sizes.argmax()] = True
    return _only(solid, pieces, keep)


def _pieces(solid: Solid) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Return the number of every voxel's piece, 0 = air, and the voxels of every piece, air's 0."""
    from scipy import ndimage

    pieces, _ = ndimage.label(solid.values > 0)
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return pieces, sizes


def _shown(pieces: NDArray[np.int32], count: int, seen: Fused) -> NDArray[np.int64]:
    """Return how many voxels of every piece views saw, air's 0."""
    shown = np.bincount(pieces[seen.own > 2 * MIN_WEIGHT], minlength=count)
    shown[0] = 0
    return shown


def _only(solid: Solid, pieces: NDArray[np.int32], keep: NDArray[np.bool_]) -> Solid:
    """Return the solid with the pieces to keep; the same one if these are all."""
    if keep[1:].all():
        return solid
    keep[0] = True  # air stays air
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
    empty = (fused.distance < -0.9 * TRUNCATION * fused.grid.voxel) & (fused.weight > 2)
    return within_hull(solid, empty & (solid.values <= 0))


def within_hull(solid: Solid, candidates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the candidate voxels inside the convex hull of a solid."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.argwhere(solid.values > 0)
    out = np.zeros_like(candidates)
    if len(points) < 4:
        return out
    try:
        planes = ConvexHull(_row_ends(points)).equations
    except QhullError:  # a flat part has no inside
        return out
    # Voxel corners repeat each plane many times; rounded to 1e-6 they are one.
    _inside_planes(candidates, np.unique(np.round(planes, 6), axis=0), out)
    return out


def _row_ends(points: NDArray[np.int64]) -> F64:
    """Return the first and last point of every row of voxels: enough for the convex hull."""
    change = np.any(points[1:, :2] != points[:-1, :2], axis=1)
    ends = np.concatenate([[True], change]) | np.concatenate([change, [True]])
    return np.asarray(points[ends], np.float64)


@kernel
def _inside_planes(candidates: NDArray[np.bool_], planes: F64, out: NDArray[np.bool_]) -> None:
    nx, ny, nz = candidates.shape
    for_each(nx, _inside_planes_at, (candidates, planes, out, ny, nz))


@inlined
def _inside_planes_at(x: int, candidates: NDArray[np.bool_], planes: F64, out: NDArray[np.bool_],
                      ny: int, nz: int) -> None:
    for y in range(ny):
        for z in range(nz):
            inside = candidates[x, y, z]
            k = 0
            while inside and k < len(planes):
                p = planes[k]
                inside = p[0] * x + p[1] * y + p[2] * z + p[3] < -0.5  # half a voxel within
                k += 1
            out[x, y, z] = inside


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
    unseen = (base.values > 0) & (seen.weight <= MIN_WEIGHT)
    values = base.values.copy()
    _clear(values, unseen, room, index_move(part.grid, part_from_base[None], base.grid)[0])
    return replace(base, values=values)


@kernel
def _clear(values: F32, unseen: NDArray[np.bool_], room: NDArray[np.bool_], m: F64) -> None:
    nx, ny, nz = values.shape
    hx, hy, hz = room.shape
    for_each(nx, _clear_at, (values, unseen, room, m, ny, nz, hx, hy, hz))


@inlined
def _clear_at(x: int, values: F32, unseen: NDArray[np.bool_], room: NDArray[np.bool_], m: F64,
              ny: int, nz: int, hx: int, hy: int, hz: int) -> None:
    for y in range(ny):
        for z in range(nz):
            if unseen[x, y, z]:
                u = round(m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3])
                v = round(m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3])
                w = round(m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3])
                if 0 <= u < hx and 0 <= v < hy and 0 <= w < hz and room[u, v, w]:
                    values[x, y, z] = -TRUNCATION
