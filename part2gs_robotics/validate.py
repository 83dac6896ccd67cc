"""Everything cheap that can prove a scene unusable, before anything slow starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
GRID = 40  # cells per axis: 64,000 points decide alignment to 2.5 % of the object
BOX_GRID = 24  # cells per axis while the box is looked for
MASK_SIDE = 160  # masks are shrunk to this: one of its pixels is below one cell of the grid
UNEXPLAINED = 0.35  # share of a mask its own hull may miss; 0.00 measured with right cameras
MIN_HULL_IOU = 0.15  # true pairs measured: 0.42 to 0.79; shifted by 0.3: 0.13 to 0.21
DOUBTFUL_SURFACE = 0.40  # states turned by 30 to 90 degrees measured 0.13 to 0.46
MIN_SAME_SURFACE = 0.20  # true pairs measured: 0.49 to 0.73; shifted by 0.3: 0.07 to 0.15

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
        raise SceneError(f"{where}: {twice} has more than one camera. Expected one frame per photo"
                         "; remove the repeated frames.")
    first = posed[0]
    for image in posed:
        if image.size != first.size:
            raise SceneError(f"{where}: {image.name} is {image.size[0]} x {image.size[1]} pixels, "
                             f"{first.name} is {first.size[0]} x {first.size[1]}. Expected one "
                             "size per state; export all photos at one size.")


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
    boxes = [object_box(outline, f"{where}: state {index}")
             for index, outline in enumerate(outlines)]
    low, high = np.minimum(boxes[0][0], boxes[1][0]), np.maximum(boxes[0][1], boxes[1][1])
    points, cell = _grid_points(low, high, GRID)
    hulls = []
    for index, outline in enumerate(outlines):
        hulls.append(_touching(outline, points, cell).reshape(GRID, GRID, GRID))
        missed = float(np.median(_unexplained(outline, points[hulls[-1].ravel()], cell)))
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
            "register all photos of both states in one COLMAP run.")
    if same < DOUBTFUL_SURFACE:
        return (f"Only {same:.0%} of the surface stands still between the states; if parts or "
                "joints come out wrong, check that both states are in one frame.",)
    return ()


def hull_agreement(a: Bools, b: Bools) -> tuple[float, float]:
    """Return (intersection over union, smaller share of surface cells that coincide)."""
    union = int(np.count_nonzero(a | b))
    iou = int(np.count_nonzero(a & b)) / max(1, union)
    shells = [hull & ~_eroded(hull) for hull in (a, b)]
    shares = [int(np.count_nonzero(one & ~_eroded(~other))) / max(1, int(np.count_nonzero(one)))
              for one, other in (shells, shells[::-1])]
    return float(iou), float(min(shares))


@dataclass(frozen=True)
class Silhouettes:
    """Shrunk outlines of the views that show the object.

    Attributes:
        away: per view, [h, w] distance in shrunk pixels to the mask, 0 on it.
        cameras: [V, 3, 4] float32 projections into the shrunk images.
        focal: [V] shrunk pixels.
        eyes, rays: [V, 3] camera centres and unit rays through the middle of the masks.
        spans: [V] half the diagonal of the mask, as a tangent.
    """

    away: tuple[NDArray[np.float32], ...]
    cameras: NDArray[np.float32]
    focal: F64
    eyes: F64
    rays: F64
    spans: F64


def silhouettes(state: StateViews) -> Silhouettes:
    """Return the outlines of all views whose mask is not empty."""
    scale = min(1.0, MASK_SIDE / max(state.width, state.height))
    size = (max(1, round(state.width * scale)), max(1, round(state.height * scale)))
    zoom = np.diag([size[0] / state.width, size[1] / state.height, 1.0])
    away, middles, corners, used = [], [], [], []
    for view, alpha in enumerate(state.alphas):
        small = cv2.resize(alpha, size, interpolation=cv2.INTER_AREA) >= MASK_ON
        if not small.any():
            continue
        away.append(np.asarray(cv2.distanceTransform((~small).astype(np.uint8), cv2.DIST_L2, 3),
                               np.float32))
        rows, columns = np.nonzero(small)
        middles.append([(columns.min() + columns.max() + 1) / 2,
                        (rows.min() + rows.max() + 1) / 2, 1.0])
        corners.append(np.hypot(np.ptp(rows) + 1, np.ptp(columns) + 1) / 2)
        used.append(view)
    Ks, viewmats = zoom @ state.Ks[used], state.viewmats[used]
    rotations = viewmats[:, :3, :3].swapaxes(1, 2)  # world_from_camera
    rays = (rotations @ np.linalg.solve(Ks, np.array(middles)[..., None]))[..., 0]
    eyes = -(rotations @ viewmats[:, :3, 3:])[..., 0]
    return Silhouettes(tuple(away), np.asarray(Ks @ viewmats[:, :3], np.float32), Ks[:, 0, 0], eyes,
                       rays / np.linalg.norm(rays, axis=1, keepdims=True), corners / Ks[:, 0, 0])


def object_box(outline: Silhouettes, where: str) -> tuple[F64, F64]:
    """Return corners of a box around the object, from silhouettes alone.

    The centre is the point nearest to the middle rays of all masks; the first cube is wider than
    the widest silhouette and shrinks to the carved cells.

    Raises:
        SceneError: the silhouettes meet nowhere.
    """
    low, high = _first_cube(outline)
    for _ in range(2):  # the second round sharpens a first cube several times too large
        points, cell = _grid_points(low, high, BOX_GRID)
        kept = points[_touching(outline, points, cell)]
        if not len(kept):
            raise SceneError(
                f"{where}: silhouettes and cameras contradict each other, no point of space is "
                f"inside the masks of {len(outline.away)} views. Expected camera-to-world matrices "
                "with OpenGL axes and masks of one still object; check both.")
        low, high = kept.min(0) - cell, kept.max(0) + cell
    return low, high


def _first_cube(outline: Silhouettes) -> tuple[F64, F64]:
    across = np.eye(3) - outline.rays[:, :, None] * outline.rays[:, None, :]
    # a millionth of a ray's weight: only parallel rays notice it
    system = across.sum(0) + 1e-6 * np.eye(3)
    centre = np.linalg.solve(system, (across @ outline.eyes[..., None]).sum(0)[:, 0])
    reach = np.abs(((centre - outline.eyes) * outline.rays).sum(1))
    half = 1.5 * float((reach * outline.spans).max())
    return centre - half, centre + half


def _grid_points(low: F64, high: F64, side: int) -> tuple[NDArray[np.float32], float]:
    """Return [side**3, 3] cell centres of the box and the longest cell edge."""
    axes = [lo + (np.arange(side) + 0.5) * (hi - lo) / side
            for lo, hi in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return points.astype(np.float32), float((high - low).max() / side)


def _touching(outline: Silhouettes, points: NDArray[np.float32], cell: float) -> Bools:
    """Return which cells may touch the object: in no view further than a cell from its mask.

    One dissenting view per ten is forgiven, and half of the views must see the cell.
    """
    against, seen = (np.zeros(len(points), np.int32) for _ in range(2))
    for away, camera, focal in zip(outline.away, outline.cameras, outline.focal, strict=True):
        at, row, column, depth = _pixels(camera, points, away.shape)
        # half the diagonal of a cell is 0.87 edges
        against[at] += away[row, column] > 0.87 * cell * focal / depth
        seen[at] += 1
    views = len(outline.away)
    return np.asarray((against <= views // 10) & (seen > views // 2))


def _unexplained(outline: Silhouettes, kept: NDArray[np.float32], cell: float) -> F64:
    """Return per view the share of its mask that no kept cell projects onto."""
    shares = []
    for away, camera, focal in zip(outline.away, outline.cameras, outline.focal, strict=True):
        at, row, column, depth = _pixels(camera, kept, away.shape)
        covered = np.zeros(away.shape, np.uint8)
        covered[row, column] = 1
        radius = int(np.ceil(cell * focal / np.median(depth))) if len(at) else 0
        brush = np.ones((2 * min(radius, MASK_SIDE) + 1,) * 2, np.uint8)
        shares.append(1.0 - float(np.asarray(cv2.dilate(covered, brush))[away == 0].mean()))
    return np.array(shares)


def _pixels(
    camera: NDArray[np.float32], points: NDArray[np.float32], shape: tuple[int, ...],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """Return index, row, column and depth of the points inside the image."""
    u, v, depth = camera[:, :3] @ points.T + camera[:, 3:]
    front = depth > 1e-9  # behind or in the camera plane there is no pixel
    depth = np.where(front, depth, 1.0)
    u, v = u / depth, v / depth
    at = np.flatnonzero(front & (u >= 0) & (v >= 0) & (u < shape[1]) & (v < shape[0]))
    return at, v[at].astype(np.int64), u[at].astype(np.int64), depth[at].astype(np.float32)


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
