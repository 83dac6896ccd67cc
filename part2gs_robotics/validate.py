"""Everything cheap that can prove a scene unusable, before anything slow starts."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.reader_nerfstudio import PosedImage
from part2gs_robotics.scene import StateViews

MIN_VIEWS = 20  # fewer silhouettes leave a hull too coarse to start from (docs/scene.md)
MASK_ON = 128  # alpha above half counts as object, as in the hull
MAX_BAD_MASKS = 0.25  # a few lost masks are outvoted by the others, a quarter is a broken export
FULL_MASK = 0.98  # an object that fills the image has no outline
GRID = 40  # cells per axis: 64,000 points decide alignment to 2.5 % of the object in half a second
MASK_SIDE = 160  # masks are shrunk to this: one of its pixels is below one cell of the grid
UNEXPLAINED = 0.35  # share of a mask its own hull may miss; right cameras stay below 0.1
MIN_HULL_IOU = 0.10  # measured 0.42 to 0.83 for true pairs of states; unrelated frames are near 0
MIN_SAME_SURFACE = 0.15  # a base of a sixth of the surface; measured 0.3 to 0.8 on true pairs

F64 = NDArray[np.float64]
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
        raise SceneError(f"{where}: {twice} has more than one camera. Expected one frame per photo; "
                         "remove the repeated frames.")
    first = posed[0]
    for image in posed:
        if image.size != first.size:
            raise SceneError(f"{where}: {image.name} is {image.size[0]} x {image.size[1]} pixels, "
                             f"{first.name} is {first.size[0]} x {first.size[1]}. Expected one size "
                             "per state; export all photos at one size.")


def check_all_posed(posed: Sequence[PosedImage], where: str) -> None:
    """Refuse images that lie beside the posed ones but have no camera."""
    used = {path for image in posed for path in (image.path, image.mask, image.depth)}
    suffixes = {image.path.suffix for image in posed}
    beside = {item for folder in {image.path.parent for image in posed} for item in folder.iterdir()
              if item.suffix in suffixes and not item.name.startswith(".")}
    lost = sorted(item.name for item in beside if item.resolve() not in used)
    if lost:
        raise SceneError(f"{where}: {len(lost)} of {len(posed) + len(lost)} images have no camera "
                         f"({', '.join(lost[:3])}{', ...' if len(lost) > 3 else ''}). Expected a "
                         "frame for every image; re-run COLMAP with exhaustive matching, or leave "
                         "these images out with --allow-missing.")


def check_state(state: StateViews, where: str) -> None:
    """Refuse masks that are empty or full, or that contradict the cameras."""
    on = (state.alphas >= MASK_ON).mean((1, 2))
    for bad, word, hint in ((on == 0, "empty", "check alpha or masks/; --invert-masks turns them"),
                            (on > FULL_MASK, "full", "cut the object out of its background")):
        if bad.mean() > MAX_BAD_MASKS:
            names = ", ".join(state.names[i] for i in np.flatnonzero(bad)[:3])
            raise SceneError(f"{where}: {int(bad.sum())} of {len(state)} masks are {word} ({names}, "
                             f"...). Expected white on the object, black around it; {hint}.")
    box = object_box(state)
    points, cell = _grid_points(*box)
    missed = np.median(_unexplained(state, points[_touching(state, points, cell)], cell))
    if missed > UNEXPLAINED:
        raise SceneError(f"{where}: cameras and masks contradict each other; {missed:.0%} of a "
                         "typical mask is seen as empty by the other views. Expected camera-to-"
                         "world matrices with OpenGL axes (+x right, +y up, +z back) and a still "
                         "object; check the axes of the export.")


def check_states(first: StateViews, second: StateViews, where: str) -> tuple[str, ...]:
    """Refuse two states that do not share one world frame; returns notes.

    Both hulls are carved on one grid. The static base is in both of them, so they overlap and
    a share of their surfaces coincides.
    """
    boxes = [object_box(state) for state in (first, second)]
    low, high = np.minimum(boxes[0][0], boxes[1][0]), np.maximum(boxes[0][1], boxes[1][1])
    points, cell = _grid_points(low, high)
    a, b = (_touching(state, points, cell).reshape(GRID, GRID, GRID) for state in (first, second))
    iou, same = hull_agreement(a, b)
    if iou < MIN_HULL_IOU or same < MIN_SAME_SURFACE:
        raise SceneError(
            f"{where}: the two states are not in one frame (their silhouette hulls overlap by "
            f"{iou:.0%}, {same:.0%} of the surface coincides). Expected a static base at one place "
            f"in both states, overlap above {MIN_HULL_IOU:.0%} and {MIN_SAME_SURFACE:.0%}; register "
            "all photos of both states in one COLMAP run.")
    return ()


def hull_agreement(a: Bools, b: Bools) -> tuple[float, float]:
    """Return (intersection over union, smaller share of surface cells that coincide)."""
    union = np.count_nonzero(a | b)
    iou = np.count_nonzero(a & b) / union if union else 0.0
    shells = [hull & ~_eroded(hull) for hull in (a, b)]
    shares = [np.count_nonzero(one & ~_eroded(~other)) / max(1, np.count_nonzero(one))
              for one, other in (shells, shells[::-1])]
    return float(iou), float(min(shares))


def object_box(state: StateViews) -> tuple[F64, F64]:
    """Return corners of a box around the object, from silhouettes alone.

    The centre is the point nearest to the central rays of all masks; the first cube is wider than
    the widest silhouette and shrinks to the carved cells.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    low, high = _first_cube(state)
    for _ in range(2):  # the second round sharpens a first cube several times too large
        points, cell = _grid_points(low, high)
        kept = points[_touching(state, points, cell)]
        if not len(kept):
            raise SceneError(
                f"{state.names[0]} and {len(state) - 1} further views: silhouettes and cameras "
                "contradict each other, no point of space is inside all masks. Expected camera-to-"
                "world matrices with OpenGL axes and masks of one still object; check both.")
        low, high = kept.min(0) - cell, kept.max(0) + cell
    return low, high


def _first_cube(state: StateViews) -> tuple[F64, F64]:
    system, right, rays = np.zeros((3, 3)), np.zeros(3), []
    for alpha, K, viewmat in zip(state.alphas, state.Ks, state.viewmats, strict=True):
        rows, columns = np.nonzero(alpha >= MASK_ON)
        if not len(rows):
            continue
        middle = np.array([(columns.min() + columns.max() + 1) / 2,
                           (rows.min() + rows.max() + 1) / 2, 1.0])
        ray = viewmat[:3, :3].T @ np.linalg.solve(K, middle)
        ray /= np.linalg.norm(ray)
        eye = -viewmat[:3, :3].T @ viewmat[:3, 3]
        across = np.eye(3) - np.outer(ray, ray)
        system, right = system + across, right + across @ eye
        span = np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1) / (2 * K[0, 0])
        rays.append((eye, ray, span))
    # a millionth of a ray's weight: only parallel rays notice it, and they are refused later
    centre = np.linalg.solve(system + 1e-6 * np.eye(3), right)
    half = 1.5 * max(abs(float((centre - eye) @ ray)) * span for eye, ray, span in rays)
    return centre - half, centre + half


def _grid_points(low: F64, high: F64) -> tuple[F64, float]:
    """Return [GRID**3, 3] cell centres of the box and the longest cell edge."""
    axes = [lo + (np.arange(GRID) + 0.5) * (hi - lo) / GRID
            for lo, hi in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return points, float((high - low).max() / GRID)


def _touching(state: StateViews, points: F64, cell: float) -> Bools:
    """Return which cells may touch the object: in no view further than a cell from its mask.

    Views whose mask is empty are skipped; one dissenting view per ten is forgiven.
    """
    against = np.zeros(len(points), np.int64)
    seen = np.zeros(len(points), np.int64)
    used = 0
    for view in np.flatnonzero((state.alphas >= MASK_ON).any((1, 2))):
        used += 1
        distance, scale = _outside_distance(state.alphas[view])
        u, v, depth = _project(state.Ks[view], state.viewmats[view], points, scale)
        visible = ((depth > 0) & (u >= 0) & (v >= 0) & (u < distance.shape[1])
                   & (v < distance.shape[0]))
        at = np.flatnonzero(visible)
        # half the diagonal of a cell is 0.87 edges
        reach = 0.87 * cell * state.Ks[view, 0, 0] * scale / depth[at]
        against[at] += distance[v[at].astype(int), u[at].astype(int)] > reach
        seen[at] += 1
    return np.asarray((against <= used // 10) & (seen > used // 2))


def _unexplained(state: StateViews, kept: F64, cell: float) -> F64:
    """Return per view the share of its mask that no kept cell projects onto."""
    shares = []
    for view in np.flatnonzero((state.alphas >= MASK_ON).any((1, 2))):
        distance, scale = _outside_distance(state.alphas[view])
        u, v, depth = _project(state.Ks[view], state.viewmats[view], kept, scale)
        ok = (depth > 0) & (u >= 0) & (v >= 0) & (u < distance.shape[1]) & (v < distance.shape[0])
        covered = np.zeros(distance.shape, np.uint8)
        covered[v[ok].astype(int), u[ok].astype(int)] = 1
        radius = int(np.ceil(cell * state.Ks[view, 0, 0] * scale / max(1e-9, np.median(depth))))
        covered = np.asarray(cv2.dilate(covered, np.ones((2 * min(radius, 64) + 1,) * 2, np.uint8)))
        mask = distance == 0
        shares.append(1 - covered[mask].mean() if mask.any() else 0.0)
    return np.array(shares)


def _outside_distance(alpha: NDArray[np.uint8]) -> tuple[NDArray[np.float32], float]:
    """Return the distance of every pixel to the shrunk mask and the factor it was shrunk by."""
    height, width = alpha.shape
    scale = min(1.0, MASK_SIDE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = cv2.resize((alpha >= MASK_ON).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    away = cv2.distanceTransform((small <= 0).astype(np.uint8), cv2.DIST_L2, 3)
    return np.asarray(away, np.float32), size[0] / width


def _project(K: F64, viewmat: F64, points: F64, scale: float) -> tuple[F64, F64, F64]:
    camera = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = np.where(np.abs(camera[:, 2]) < 1e-12, 1e-12, camera[:, 2])
    u = (K[0, 0] * camera[:, 0] / depth + K[0, 2]) * scale
    v = (K[1, 1] * camera[:, 1] / depth + K[1, 2]) * scale
    return u, v, depth


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
