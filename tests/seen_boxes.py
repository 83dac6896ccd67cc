"""Boxes as views all round see them: exact depths and parts, and exact distances on grids."""

import numpy as np
from synth_photos import box_depth, viewmats_around

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.volume.part_maps import NO_PART, PartMaps

SIZE, FOCAL, DISTANCE, VIEWS, VOXEL = 160, 260.0, 2.0, 30, 0.012
LO, HI = np.array([-0.2, -0.15, -0.1]), np.array([0.2, 0.15, 0.1])


def part_maps(boxes) -> PartMaps:
    """Return maps of boxes (lo, hi, label, world_from_box)."""
    viewmats = viewmats_around(VIEWS, DISTANCE)
    every = np.stack([[box_depth(m if w is None else m @ w, lo, hi, SIZE, FOCAL)
                       for lo, hi, _, w in boxes] for m in viewmats])
    depth = every.min(1)
    seen = np.isfinite(depth)
    names = np.array([b[2] for b in boxes], np.uint8)
    K = np.array([[FOCAL, 0, SIZE / 2], [0, FOCAL, SIZE / 2], [0, 0, 1.0]])
    maps = DepthMaps(np.where(seen, depth, 0).astype(np.float32), seen.astype(np.float32),
                     np.repeat(K[None], VIEWS, 0), viewmats)
    return PartMaps(maps, np.where(seen, names[every.argmin(1)], NO_PART).astype(np.uint8))


def box_distance(grid: Grid, lo, hi) -> np.ndarray:
    """Return exact signed distances, positive inside."""
    points = grid.centers(np.stack(np.indices(grid.shape), -1))
    out = np.maximum(lo - points, points - hi)
    return -np.where((out > 0).any(-1), np.linalg.norm(np.maximum(out, 0), axis=-1), out.max(-1))


def grid_around(lo, hi, margin=6) -> Grid:
    # Half a voxel off, so that no voxel centre lies exactly on a face.
    return Grid.around(lo - (margin + 0.5) * VOXEL, hi + margin * VOXEL, VOXEL)
