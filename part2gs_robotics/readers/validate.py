"""Everything cheap that can prove a scene unusable, before anything slow starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.readers.nerfstudio import PosedImage
from part2gs_robotics.readers.silhouettes import (
    GRID,
    MASK_ON,
    Silhouettes,
    grid_points,
    object_box,
    silhouettes,
    touching,
    unexplained,
)

MIN_VIEWS = 20  # fewer silhouettes leave a hull too coarse to start from (docs/scene.md)
MAX_BAD_MASKS = 0.25  # a few lost masks are outvoted by the others, a quarter is a broken export
FULL_MASK = 0.98  # an object that fills the image has no outline
UNEXPLAINED = 0.35  # share of a mask its own hull may miss; 0.00 measured with right cameras
MIN_HULL_IOU = 0.15  # true pairs measured: 0.42 to 0.79; shifted by 0.3: 0.13 to 0.21
DOUBTFUL_SURFACE = 0.40  # states turned by 30 to 90 degrees measured 0.13 to 0.46
MIN_SAME_SURFACE = 0.20  # true pairs measured: 0.49 to 0.73; shifted by 0.3: 0.07 to 0.15

Bools = NDArray[np.bool_]


def check_counts(posed: Sequence[PosedImage], where: str) -> None:
    """Refuse a state with too few images or images of several sizes."""
    if len(posed) < MIN_VIEWS:
        raise SceneError(f"{where}: {len(posed)} posed images. Expected at least {MIN_VIEWS} per "
                         "state, all around the object; take more photos or re-run COLMAP with "
                         "exhaustive matching.")
    paths = [image.path for image in posed]
    if len(set(paths)) < len(paths):
        twice = next(image.name for image in posed if paths.count(image.path) > 1)
        raise SceneError(f"{where}: {twice} has more than one camera. Expected one frame per photo"
                         "; remove the repeated frames.")
    first = posed[0]
    for image in posed:
        if image.size != first.size:
            raise SceneError(f"{where}: {image.name} is {image.size[0]} x {image.size[1]} pixels, "
                             f"{first.name} is {first.size[0]} x {first.size[1]}. Expected one "
                             "size per state; export all photos at one size.")


def check_all_posed(posed: Sequence[PosedImage], every: Sequence[PosedImage], where: str) -> None:
    """Refuse images that lie beside the posed ones but have no camera.

    Args:
        posed: images of one state.
        every: images of both, which may lie in one folder.
        where: names the state.

    Raises:
        SceneError: there are some.
    """
    used = {path for image in every for path in (image.path, image.mask, image.depth)}
    suffixes = {image.path.suffix for image in posed}
    beside = {item for folder in {image.path.parent for image in posed} for item in folder.iterdir()
              if item.suffix in suffixes and not item.name.startswith(".")}
    lost = sorted(item.name for item in beside if item.resolve() not in used)
    if lost:
        raise SceneError(f"{where}: {len(lost)} of {len(posed) + len(lost)} images have no camera "
                         f"({', '.join(lost[:3])}{', ...' if len(lost) > 3 else ''}). Expected a "
                         "frame for every image; re-run COLMAP with exhaustive matching, or leave "
                         "these images out with --allow-missing.")


def check_masks(state: StateViews, where: str) -> None:
    """Refuse a state most of whose masks could not be right."""
    on = (state.alphas >= MASK_ON).mean((1, 2))
    for bad, word, hint in ((on == 0, "empty", "check alpha or masks/; --invert-masks turns them"),
                            (on > FULL_MASK, "full", "cut the object out of its background")):
        if bad.mean() > MAX_BAD_MASKS:
            names = ", ".join(state.names[i] for i in np.flatnonzero(bad)[:3])
            raise SceneError(f"{where}: {int(bad.sum())} of {len(state)} masks are {word} "
                             f"({names}, ...). Expected white on the object, black around it; "
                             f"{hint}.")


def check_frames(states: tuple[StateViews, StateViews], where: str) -> tuple[str, ...]:
    """Refuse cameras that contradict the masks, or two states in different world frames.

    Both hulls are carved on one grid. The static base is in both of them, so they overlap and
    a share of their surfaces coincides. Returns a note when that share is small.
    """
    outlines = [silhouettes(state) for state in states]
    low, high = _both(outlines, where)
    points, cell = grid_points(low, high, GRID)
    hulls = []
    for index, outline in enumerate(outlines):
        hulls.append(touching(outline, points, cell).reshape(GRID, GRID, GRID))
        missed = float(np.median(unexplained(outline, points[hulls[-1].ravel()], cell)))
        if missed > UNEXPLAINED:
            raise SceneError(
                f"{where}: state {index}: cameras and masks contradict each other; {missed:.0%} of "
                "a typical mask is seen as empty by the other views. Expected camera-to-world "
                "matrices with OpenGL axes (+x right, +y up, +z back) and a still object; check "
                "the axes of the export.")
    iou, same = hull_agreement(hulls[0], hulls[1])
    if iou < MIN_HULL_IOU or same < MIN_SAME_SURFACE:
        raise SceneError(
            f"{where}: the two states are not in one frame (their silhouette hulls overlap by "
            f"{iou:.0%}, {same:.0%} of the surface coincides). Expected a static base at one "
            f"place in both states, overlap above {MIN_HULL_IOU:.0%} and {MIN_SAME_SURFACE:.0%}; "
            "register all photos of both states in one COLMAP run, or try --align if they are "
            "nearly in one.")
    if same < DOUBTFUL_SURFACE:
        return (f"Only {same:.0%} of the surface stands still between the states; if parts or "
                "joints come out wrong, check that both states are in one frame.",)
    return ()


def common_box(states: tuple[StateViews, StateViews], where: str) -> tuple[F64, F64]:
    """Return corners [3] of a box that holds the object in both states.

    Raises:
        SceneError: a state's silhouettes meet nowhere.
    """
    return _both([silhouettes(state) for state in states], where)


def _both(outlines: Sequence[Silhouettes], where: str) -> tuple[F64, F64]:
    boxes = [object_box(outline, f"{where}: state {index}")
             for index, outline in enumerate(outlines)]
    return np.minimum(boxes[0][0], boxes[1][0]), np.maximum(boxes[0][1], boxes[1][1])


def hull_agreement(a: Bools, b: Bools) -> tuple[float, float]:
    """Return (intersection over union, smaller share of surface cells that coincide)."""
    union = int(np.count_nonzero(a | b))
    iou = int(np.count_nonzero(a & b)) / max(1, union)
    shells = [hull & ~_eroded(hull) for hull in (a, b)]
    shares = [int(np.count_nonzero(one & ~_eroded(~other))) / max(1, int(np.count_nonzero(one)))
              for one, other in (shells, shells[::-1])]
    return float(iou), float(min(shares))


def _eroded(cells: Bools) -> Bools:
    """Return cells whose six neighbours are all set; the border of the grid counts as set."""
    out = cells.copy()
    for axis in range(3):
        for step in (1, -1):
            moved = np.roll(cells, step, axis)
            edge = [slice(None)] * 3
            edge[axis] = slice(0, 1) if step == 1 else slice(-1, None)
            moved[tuple(edge)] = True
            out &= moved
    return out
