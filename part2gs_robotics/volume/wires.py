"""Wires: what views see of a part that is too thin for the grid, as the thinnest tubes it holds.

A pixel on a wire has an edge beside it, so that its depth bounds no solid. Gaussians say where it
runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.part_maps import NO_PART, PartMaps
from part2gs_robotics.volume.part_solids import THIN
from part2gs_robotics.volume.place import Place

Mask = NDArray[np.bool_]
BORDER = 2  # of offsets: next to the solid by a face or an edge, as far as its surface is wrong
NEXT = 3.0  # voxels: Gaussians no further from a lost one lead from it to the solid
NEAR = 2.0  # voxels of depth: twice what rendered depth is wrong by
BESIDE = 2.0  # voxels on both sides of which views look past: what is thicker, the grid holds
VIEWS = 3  # that see it: one or two may share an error
STEP = 0.5  # voxels between points along a Gaussian: none on its way is passed over
LINKS = 4  # of every Gaussian: both neighbours on a wire, and as many again where others lie beside
LEAP = 4.0  # voxels between ends of a wire: as much as one Gaussian that was lost in it is long
# Rows and columns, across a wire and along it: the n-th from either end are at right angles.
WAYS = ((0, 1), (1, 1), (1, -1), (1, 0))


def with_wires(solid: Solid, part: int, place: Place, maps: Sequence[PartMaps]) -> Solid:
    """Return the solid with tubes along Gaussians that views see thin and the grid has lost.

    Tubes end where views see nothing; those that do not lead to the solid are left out.

    Args:
        solid: of the part.
        part: its number.
        place: of its Gaussians at state 0.
        maps: of both states.
    """
    from scipy import ndimage

    grid, means, inside = solid.grid, place.points[part], solid.values > 0
    if not inside.any():
        return solid
    near = ndimage.binary_dilation(inside, ndimage.generate_binary_structure(3, BORDER))
    away = ~near[tuple(_voxels(grid, means).T)]
    lost = np.flatnonzero(away)
    seen, thin, free = _votes(means[lost], part, place, maps, grid.voxel)
    lost = lost[(thin >= VIEWS) & (2 * thin > seen) & (thin > free)]
    if not len(lost):
        return solid
    gaps = cKDTree(means[lost]).query(means, distance_upper_bound=NEXT * grid.voxel)[0]
    chosen = np.isfinite(gaps) & ~away
    chosen[lost] = True
    tubes = np.zeros(grid.shape, bool)
    lines = np.concatenate([place.ends[part][chosen], _links(means[chosen], NEXT * grid.voxel)])
    tubes[tuple(_voxels(grid, _along(lines, STEP * grid.voxel)).T)] = True
    tubes = ndimage.binary_dilation(tubes) & ~inside  # one voxel all round: the least that closes
    index = np.argwhere(tubes)
    ends = _votes(grid.centers(index), part, place, maps, grid.voxel)[2] >= VIEWS
    tubes[tuple(index[ends].T)] = False
    tubes |= _bridges(inside, tubes)
    pieces, _ = ndimage.label(inside | tubes)
    held = tubes & np.isin(pieces, np.unique(pieces[inside]))
    return replace(solid, values=np.where(held, np.maximum(solid.values, np.float32(THIN)),
                                          solid.values))


def _bridges(inside: Mask, tubes: Mask) -> Mask:
    """Return [X, Y, Z] tubes between pieces whose ends lie near each other, where tubes are."""
    from scipy import ndimage

    out = np.zeros_like(tubes)
    pieces, count = ndimage.label(inside | tubes)
    reach = ndimage.binary_dilation(tubes, iterations=int(LEAP))
    index = np.argwhere(reach & (pieces > 0))
    of = pieces[tuple(index.T)]
    for piece in np.unique(of) if count > 1 else ():
        mine, others = index[of == piece], index[of != piece]
        if not len(others):
            continue
        gaps, nearest = cKDTree(others).query(mine)
        k = gaps.argmin()
        if gaps[k] <= LEAP:
            way = _along(np.stack([mine[k], others[nearest[k]]])[None].astype(float), STEP)
            out[tuple(np.rint(way).astype(int).T)] = True
    return np.asarray(ndimage.binary_dilation(out) & ~inside)


def _voxels(grid: Grid, points: F64) -> I64:
    """Return [N, 3] the voxels nearest to points, none of them at the rim."""
    index = np.rint((points - grid.lo) / grid.voxel).astype(np.int64)
    return np.asarray(np.clip(index, 1, np.array(grid.shape) - 2))


def _links(points: F64, longest: float) -> F64:
    """Return [M, 2, 3] lines from points to their nearest others."""
    gaps, other = cKDTree(points).query(points, LINKS + 1, distance_upper_bound=longest)
    one, k = np.nonzero(np.isfinite(gaps))
    return np.stack([points[one], points[other[one, k]]], 1)


def _along(ends: F64, step: float) -> F64:
    """Return points at most a step apart on lines [N, 2, 3]."""
    way = ends[:, 1] - ends[:, 0]
    count = np.ceil(np.linalg.norm(way, axis=1) / step).astype(np.int64) + 1
    line = np.repeat(np.arange(len(ends)), count)
    place = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    share = place / np.maximum(count - 1, 1)[line]
    return np.asarray(ends[line, 0] + share[:, None] * way[line])


def _votes(points: F64, part: int, place: Place, maps: Sequence[PartMaps], voxel: float) -> I64:
    """Return [3, N] how many views see a point as the part's, see it thin, and see nothing there.

    Thin: they look past it on both sides and see more of the part before and behind: no corner is.
    """
    counts = np.zeros((3, len(points)), np.int64)
    for one, pose in zip(maps, (np.eye(4), place.state1_from_0[part]), strict=True):
        there, views = apply(pose, points), one.maps
        for m, k, depth, label in zip(views.projections, views.Ks, views.depths, one.labels,
                                      strict=True):
            look = _Look(m, voxel * float(k[0, 0]), depth, label, NEAR * voxel)
            counts += look.votes(there, part)
    return counts


@dataclass(frozen=True)
class _Look:
    """One view: projection [3, 4], pixels of a voxel at depth 1, depths, labels, tolerance."""

    projection: F64
    scale: float
    depth: F32
    label: NDArray[np.uint8]
    near: float

    def votes(self, points: F64, part: int) -> I64:
        """Return [3, N] whether it sees a point as the part's, sees it thin, and nothing there."""
        h = points @ self.projection[:, :3].T + self.projection[:, 3]
        w = np.maximum(h[:, 2], self.near)  # behind the camera: no place in the picture matters
        places = np.floor(h[:, 1::-1] / w[:, None]).astype(np.int64)
        wide = np.maximum(np.ceil(BESIDE * self.scale / w), 1).astype(np.int64)
        depth, label = self._read(places)
        seen = (h[:, 2] > 0) & (label == part) & (np.abs(depth - w) < self.near)
        ways = np.array(WAYS)[:, None]
        far, half = wide[:, None] * ways, ((wide + 1) // 2)[:, None] * ways
        sides = np.array([[self._past(places + s * step, w) for s in (-1, 1)] for step in far])
        along = np.array([[self._own(places + s * step, way, part) for s in (-1, 1)]
                          for step, way in zip(half, WAYS[::-1], strict=True)])
        across = np.asarray(sides.all(1)) & np.asarray(along.all(1))[::-1]
        nothing = (h[:, 2] > 0) & sides.all((0, 1)) & self._past(places, w)
        return np.stack([seen, seen & across.any(0), nothing]).astype(np.int64)

    def _read(self, places: I64) -> tuple[F64, NDArray[np.uint8]]:
        """Return depth and label at pixels [N, 2]; outside of the picture nothing is known: 0."""
        size = np.array(self.depth.shape)
        there = ((places >= 0) & (places < size)).all(1)
        y, x = np.clip(places, 0, size - 1).T
        return (np.where(there, self.depth[y, x], 0.0).astype(np.float64),
                np.where(there, self.label[y, x], NO_PART - 1).astype(np.uint8))

    def _past(self, places: I64, w: F64) -> Mask:
        """Return [N] whether the view looks past a depth at pixels."""
        depth, label = self._read(places)
        return np.asarray((label == NO_PART) | (depth > w + self.near))

    def _own(self, places: I64, way: tuple[int, int], part: int) -> Mask:
        """Return [N] whether a pixel is the part's, or one beside it along a way."""
        beside = [self._read(places + s * np.array(way))[1] == part for s in (-1, 0, 1)]
        return np.asarray(np.any(beside, axis=0))
