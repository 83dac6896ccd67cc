"""Photos whose masks the other views of their state contradict: they are left out.

A mask shifted, torn or of another photo cuts away what it misses, in the hull and in the fit, and
what is missing in one state only looks like motion. A wrong pose does the same, and shows here too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.scene import StateViews
from part2gs_robotics.silhouettes import (
    GRID,
    Silhouettes,
    grid_points,
    object_box,
    silhouettes,
    touching,
    unexplained,
    unmasked,
)
from part2gs_robotics.validate import MAX_BAD_MASKS

# Of a mask, more than twice the median of all: right ones of 28 scenes 0.000, with all poses one
# degree off 0.04 at most, but for the thin frame of a pair of glasses: 0.08; shifted by 15 % of the
# image 0.14 to 0.25, with a blob beside the object 0.07 and more.
BEYOND = 0.05
# Of a mask: right ones 0.25 at most (a thin lid seen along it, 20 views), without half of the
# object 0.75 to 2.3.
MISSING = 0.4
FEWEST = 8  # views with all of the object: fewer cannot outvote one
ENOUGH = 18  # likewise: what fewer leave is too wide to say what a mask lacks
FORGIVEN = 30  # views per one that is forgiven once masks that reach beyond the others are gone

F64 = NDArray[np.float64]
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

    Close photos see part of the object: what they lack is no fault of theirs.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    outline, right = silhouettes(state), np.zeros(len(state), bool)
    whole = outline.whole
    if whole.sum() < FEWEST:
        return ~right
    beyond = unexplained(outline, *_carved(outline.select(whole), where))
    agree = beyond <= 2.0 * np.median(beyond) + BEYOND
    right[outline.views[agree]] = True
    judges = outline.select(agree & whole)
    if len(judges.views) >= ENOUGH:
        hull = _carved(judges, where, max(1, len(judges.views) // FORGIVEN))
        right[judges.views[unmasked(judges, *hull) > MISSING]] = False
    return right


def _carved(outline: Silhouettes, where: str, forgiven: int | None = None,
            ) -> tuple[NDArray[np.float32], float]:
    """Return the cells [N, 3] that the silhouettes leave, and the edge of one."""
    points, cell = grid_points(*object_box(outline, where), GRID)
    return points[touching(outline, points, cell, forgiven)], cell
