"""Photos whose masks the other views of their state contradict: they are left out.

A mask shifted, torn or of another photo cuts away what it misses, in the hull and in the fit, and
what is missing in one state only looks like motion. A wrong pose does the same, and shows here too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.readers.silhouettes import (
    GRID,
    Silhouettes,
    grid_points,
    object_box,
    silhouettes,
    touching,
    unexplained,
    unmasked,
)
from part2gs_robotics.readers.validate import MAX_BAD_MASKS

# Of a mask, beside twice the median, on 31 scenes (benchmarks/masks.py): right 0.00, wrong 0.04 up.
BEYOND = 0.05
MISSING = 0.4  # right masks 0.25 at most (a thin part seen along it, 20 views), halved 0.75 to 2.48
FEWEST = 8  # views with all of the object: fewer cannot outvote one
ENOUGH = 18  # likewise: what fewer leave is too wide to say what a mask lacks
FORGIVEN = 30  # views per one that is forgiven once masks that reach beyond the others are gone

Bools = NDArray[np.bool_]


def without_wrong_masks(state: StateViews, where: str) -> tuple[StateViews, str]:
    """Return the state without photos whose masks contradict the others, and a note, '' if none.

    Args:
        state: all its views.
        where: what messages call the state.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    right = right_masks(state, where)
    if right.all():
        return state, ""
    names = [name for name, kept in zip(state.names, right, strict=True) if not kept]
    listed = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
    some = f"{len(names)} of {len(state)} masks contradict the others or are empty ({listed})"
    if len(names) > MAX_BAD_MASKS * len(state):
        return state, (f"{where}: {some}: too many to leave out. Check masks and poses; the twin "
                       "may lack what they cut away.")
    return state.select(right), (f"{where}: {some}; these photos are left out. Check their masks "
                                 "and poses.")


def right_masks(state: StateViews, where: str) -> Bools:
    """Return [V] which masks agree with those that show the whole object; all where these are few.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    beyond, missing = contradictions(state, where)
    return _agree(beyond) & ~(missing > MISSING)


def contradictions(state: StateViews, where: str) -> tuple[F64, F64]:
    """Return [V] how much of every mask the others say is no object, and what they say it lacks.

    Both are shares of the mask. Close photos see part of the object: what they lack is no fault of
    theirs, and NaN. Where few views show all of the object nobody is judged: zeros and NaN.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    outline, missing = silhouettes(state), np.full(len(state), np.nan)
    whole = outline.whole
    if whole.sum() < FEWEST:
        return np.zeros(len(state)), missing
    beyond = np.full(len(state), np.inf)  # an empty mask says there is no object at all
    beyond[outline.views] = unexplained(outline, *_carved(outline.select(whole), where))
    judges = outline.select(_agree(beyond)[outline.views] & whole)
    if len(judges.views) >= ENOUGH:
        hull = _carved(judges, where, max(1, len(judges.views) // FORGIVEN))
        missing[judges.views] = unmasked(judges, *hull)
    return beyond, missing


def _agree(beyond: F64) -> Bools:
    return np.asarray(beyond <= 2.0 * np.median(beyond[np.isfinite(beyond)]) + BEYOND)


def _carved(outline: Silhouettes, where: str, forgiven: int | None = None,
            ) -> tuple[NDArray[np.float32], float]:
    """Return the cells [N, 3] that the silhouettes leave, and the edge of one."""
    points, cell = grid_points(*object_box(outline, where), GRID)
    return points[touching(outline, points, cell, forgiven)], cell
