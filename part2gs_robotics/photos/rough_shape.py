"""A first shape of the object in each state, from colours and the plane alone.

What the cameras look at has the object's colours, what lies outside the space that all of them
see has the background's. A cell of space is the object's where hardly any view shows background
there; its outline then teaches both colours anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.table_picture import OBJECT
from part2gs_robotics.photos.views import Bools, Grid, Views

U8 = NDArray[np.uint8]

BINS = 32  # per channel of Lab: 8 counts of L and 4 of a and b, an eighth of the common range
ROUNDS = 5  # of colours and shape in turn; the shape no longer changes after 3
SEED = 0.06  # of the cameras' distance: a ball there lies in nearly every object
VETO = -0.3  # log of how much likelier the object's colour is: below it a pixel is background
FORGIVEN = 0.15  # of the views of a cell: highlights and foreign colours on the object
REACH = 0.3  # of the cameras' distance: what hangs together here is the object


def rough_shapes(views: Sequence[Views], grids: Sequence[Grid], tables: Sequence[Sequence[U8]],
                 swept: Sequence[Sequence[U8]], middle: F64, radius: float) -> list[Bools]:
    """Return [N] filled cells per state.

    Args:
        views: of each state.
        grids: of each state, over the space that all cameras see.
        tables: per state and view, what the plane says of its pixels.
        swept: per state and view, 1 where neighbouring photos tell the plane.
        middle: [3] what the cameras look at.
        radius: their distance from it.

    Raises:
        SceneError: nothing has colours of its own there.
    """
    bins = [[_bins(rgb) for rgb in state.rgb] for state in views]
    away = np.linalg.norm(grids[0].points - middle, axis=1)
    spaces = [grid.share_seen() > 0.9 for grid in grids]  # a tenth of the photos may aim badly
    filled = [space & (away < SEED * radius) for space in spaces]
    outside = [grid.outlines(space) for grid, space in zip(grids, spaces, strict=True)]
    near = np.exp(-((away / (REACH * radius)) ** 2))
    for _ in range(ROUNDS):
        own = [grid.outlines(cells) for grid, cells in zip(grids, filled, strict=True)]
        odds = _odds(bins, own, outside)
        for s, grid in enumerate(grids):
            against = [_against(odds[b], table) | plane
                       for b, table, plane in zip(bins[s], tables[s], swept[s], strict=True)]
            filled[s] = main_piece(spaces[s] & (grid.votes(against) < FORGIVEN), grid, near)
            if not filled[s].any():
                raise SceneError(f"masks: state {s} shows no object that differs from its "
                                 "surroundings where the cameras look. Expected one object in the "
                                 "middle of every photo; give masks (alpha or masks/), or put it "
                                 "on a surface of another colour.")
        outside = [grid.outlines(cells) for grid, cells in zip(grids, filled, strict=True)]
    return filled


def main_piece(cells: Bools, grid: Grid, near: F64) -> Bools:
    """Return the connected piece of filled cells that lies most about the middle."""
    from scipy.ndimage import label

    pieces = label(cells.reshape(grid.shape))[0].reshape(-1)
    weight = np.bincount(pieces, near)
    weight[0] = 0.0
    return np.asarray((pieces == weight.argmax()) & cells)


def _bins(rgb: U8) -> NDArray[np.int64]:
    lab = cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB).astype(np.int64)
    tone = np.clip(lab[..., 1:] // 4 - 16, 0, BINS - 1)
    return np.asarray((lab[..., 0] // 8 * BINS + tone[..., 0]) * BINS + tone[..., 1])


def _odds(bins: Sequence[Sequence[NDArray[np.int64]]], own: Sequence[U8],
          outside: Sequence[U8]) -> F64:
    """Return [BINS^3] the log odds of the object's colours over those outside of its outlines."""
    from scipy.ndimage import gaussian_filter

    counts = np.zeros((2, BINS**3))
    for state, mine, theirs in zip(bins, own, outside, strict=True):
        for picture, fill, hull in zip(state, mine, theirs, strict=True):
            counts[0] += np.bincount(picture[fill > 0], minlength=BINS**3)
            counts[1] += np.bincount(picture[hull == 0], minlength=BINS**3)
    smooth = [gaussian_filter(c.reshape(BINS, BINS, BINS), 1.0).reshape(-1) for c in counts]
    shares = [s / max(s.sum(), 1e-300) + 1e-7 for s in smooth]  # a colour never seen says nothing
    return np.asarray(np.clip(np.log(shares[0] / shares[1]), -4, 4))


def _against(odds: F64, table: U8) -> U8:
    """Return [H, W] 1 where a pixel shows background."""
    # what looks like the plane may yet be the foot of an object of one colour
    return ((cv2.blur(odds, (3, 3)) < VETO) & (table != OBJECT)).astype(np.uint8)
