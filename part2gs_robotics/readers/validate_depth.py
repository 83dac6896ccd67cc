"""Depth images against the masks of other views: a wrong unit shows at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews

VIEWS, POINTS = 12, 400  # views compared with each other, points of each: 60,000 projections
MASK_ON = 128  # alpha above half counts as object, as in silhouettes.py
SLACK = 2  # px around a mask: rounding of edges and of resized depth
# Nine captured objects 0.99 up with 1 % noise; a tenth too small 0.62, a fifth too large 0.845.
MIN_INSIDE = 0.85


def check_depth(state: StateViews, where: str) -> float:
    """Return the share of depth points that other views' masks confirm.

    A point of the object lies inside its mask in every view, whatever hides it; depth in another
    unit than the poses leaves the masks.

    Args:
        state: with depths.
        where: named in the error.

    Raises:
        SceneError: too few points are inside.
    """
    chosen = np.unique(np.linspace(0, len(state) - 1, VIEWS).astype(int))
    inside = np.array([_confirmed(state, view, chosen) for view in chosen]).sum(0)
    share = float(inside[0] / max(inside[1], 1))
    if share < MIN_INSIDE:
        raise SceneError(
            f"{where}: {100 * share:.0f} % of the depth points lie inside the masks of other "
            f"views. Expected at least {100 * MIN_INSIDE:.0f} %: z-depth along the optical axis "
            "in the unit of the poses (depth_unit_scale_factor); correct it, or use --no-depth.")
    return share


def _confirmed(state: StateViews, view: int, others: NDArray[np.int64]) -> tuple[int, int]:
    """Return (inside a mask, looked at) over the points of one view in the other views."""
    import cv2

    points = _points(state, view)
    good = seen = 0
    for other in others:
        if other == view:
            continue
        camera = points @ state.viewmats[other][:3, :3].T + state.viewmats[other][:3, 3]
        camera = camera[camera[:, 2] > 0]
        pixels = camera @ state.Ks[other].T
        column, row = (pixels[:, :2] / pixels[:, 2:]).astype(int).T
        framed = (column >= 0) & (row >= 0) & (column < state.width) & (row < state.height)
        mask = (state.alphas[other] >= MASK_ON).astype(np.uint8)
        wide = cv2.dilate(mask, np.ones((2 * SLACK + 1,) * 2, np.uint8))
        good += int(wide[row[framed], column[framed]].sum())
        seen += int(framed.sum())
    return good, seen


def _points(state: StateViews, view: int) -> F64:
    """Return [N, 3] world points of the object in one depth image, evenly drawn."""
    assert state.depths is not None  # callers pass states with depth
    depth = state.depths[view]
    rows, columns = np.nonzero((depth > 0) & (state.alphas[view] >= MASK_ON))
    few = np.linspace(0, max(len(rows) - 1, 0), min(POINTS, len(rows))).astype(int)
    rows, columns = rows[few], columns[few]
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(few))], 1)
    local = pixels @ np.linalg.inv(state.Ks[view]).T * depth[rows, columns, None]
    return np.asarray((local - state.viewmats[view][:3, 3]) @ state.viewmats[view][:3, :3])
