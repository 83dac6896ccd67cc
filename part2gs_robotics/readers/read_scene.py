"""Scene folder in, Scene out: detect the layout, read cameras, decode images, validate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.align.align_states import on_what_stayed
from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import ConfigError, SceneError
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.readers import image_files as images
from part2gs_robotics.readers import validate
from part2gs_robotics.readers.layouts import States, read_layout
from part2gs_robotics.readers.nerfstudio import PosedImage
from part2gs_robotics.readers.validate_depth import check_depth
from part2gs_robotics.readers.wrong_masks import without_wrong_masks
from part2gs_robotics.runtime.plain_yaml import NotPlainError, read_plain_file
from part2gs_robotics.runtime.threads import in_threads

HELD_OUT_EVERY = 8  # 64 views leave 8 unseen: enough for a PSNR, few enough not to be missed
MAX_YAML_BYTES = 1 << 16  # scene.yaml holds a few settings
MAX_DEPTH = 4  # settings, one of them, its numbers
MAX_SCENE_BYTES = 2 << 30  # half of the memory a build may use
MARGIN = 0.12  # of the object's box, on every side: the ground around says where the object ends
WORTH = 0.9  # of the longest side of a photo: what is cut to more than that keeps few pixels more
SOLID = 128  # of 255: a pixel of the mask that shows more object than ground

Size = tuple[int, int]
Box = tuple[NDArray[np.int64], NDArray[np.int64]]  # lowest and highest corner in pixels
View = tuple[images.U8, images.U8, NDArray[np.float64], NDArray[np.uint16] | None]


@dataclass(frozen=True)
class Window:
    """What is kept of the photos of one state.

    Attributes:
        size: (width, height) of every window in pixels.
        corners: [V, 2] upper left corner in every photo.
    """

    size: Size
    corners: NDArray[np.int64]


def read_scene(path: Path, config: ReadConfig) -> Scene:
    """Return both states of the scene folder, validated.

    Args:
        path: scene folder in one of the layouts of `layouts.py`.
        config: what may be changed or assumed.

    Raises:
        SceneError: anything in the folder that cannot be used; says what, where and what to do.
    """
    layout, posed = read_cameras(path, config)
    windows = _windows(posed, config)
    states = (_load_state(posed[0], config, windows[0]), _load_state(posed[1], config, windows[1]))
    notes = _notes(posed, states, windows, config)
    for index, state in enumerate(states):
        validate.check_masks(state, f"{path}: state {index}")
    zero, one = (without_wrong_masks(state, f"State {n}") for n, state in enumerate(states))
    states = cast("tuple[StateViews, StateViews]", tuple(
        replace(state, held_out=_held_out(len(state))) for state, _ in (zero, one)))
    notes = (*notes, *(note for _, note in (zero, one) if note))
    if config.align:
        second, note = on_what_stayed(states, validate.common_box(states, str(path)), str(path))
        states, notes = (states[0], second), (*notes, note)
    for index, state in enumerate(states):
        if state.depths is not None:
            check_depth(state, f"{path}: state {index}")
    notes += validate.check_frames(states, str(path))
    up = None if config.up is None else np.array(config.up) / np.linalg.norm(config.up)
    return Scene(path, layout, states, config.scale, up, notes)


def read_cameras(path: Path, config: ReadConfig) -> tuple[str, States]:
    """Return layout name and posed images of both states; no pixel is decoded.

    Raises:
        SceneError: no layout found, too few images, or broken camera files.
    """
    if not path.is_dir():
        found = "a file" if path.exists() else "missing"
        raise SceneError(f"{path}: is {found}. Expected a scene folder with two observed states; "
                         "see docs/scene.md for the layouts.")
    layout, posed = read_layout(path, config)
    for index, state in enumerate(posed):
        validate.check_counts(state, f"{path}: state {index}")
        if not config.allow_missing:
            validate.check_all_posed(state, (*posed[0], *posed[1]), f"{path}: state {index}")
    return layout, posed


def read_scene_yaml(path: Path) -> dict[object, object]:
    """Return the mapping in scene.yaml, empty when the scene has none.

    Raises:
        ConfigError: too large, not YAML, with aliases, or not a mapping.
        SceneError: a link that leaves the scene.
    """
    file = path / "scene.yaml"
    if not file.is_file():
        return {}
    images.own_file(file, path)
    try:
        content = read_plain_file(file, MAX_YAML_BYTES, MAX_DEPTH)
    except NotPlainError as err:
        raise ConfigError(f"{file}: {err}. Expected plain settings such as 'parts: 2'; correct the "
                          "file.") from err
    if content is not None and not isinstance(content, dict):
        raise ConfigError(f"{file}: holds a {type(content).__name__}. Expected a mapping such as "
                          "'parts: 2'; correct the file.")
    return cast("dict[object, object]", content or {})


def _windows(posed: States, config: ReadConfig) -> tuple[Window | None, Window | None]:
    """Return per state where to cut its photos, None where they are small or filled.

    One size for all, so that both states show the object at one scale.
    """
    if not config.crop or max(max(state[0].size) for state in posed) <= config.max_side:
        return None, None
    boxes = [in_threads([partial(_box, image, lens, config.invert_masks)
                         for image, lens in zip(state, _lenses(state), strict=True)])
             for state in posed]
    sides = [high - low for state in boxes for low, high in state]
    widest = (1 + 2 * MARGIN) * np.max(sides, axis=0)
    zero, one = (_window(state[0].size, box, widest)
                 for state, box in zip(posed, boxes, strict=True))
    return zero, one


def _window(frame: Size, boxes: Sequence[Box], widest: NDArray[np.float64]) -> Window | None:
    """Return windows of one size round the boxes, inside the frame; None if that gains nothing."""
    size = np.minimum(np.ceil(widest).astype(np.int64), frame)
    if max(size) > WORTH * max(frame) or min(size) <= 0:
        return None
    corners = np.array([(low + high - size) // 2 for low, high in boxes])
    return Window((int(size[0]), int(size[1])), np.clip(corners, 0, np.array(frame) - size))


def _box(image: PosedImage, lens: images.Undistorter | None, invert: bool) -> Box:
    """Return lowest and highest corner of the object in a photo; the whole photo if it has none."""
    alpha = None if image.path.suffix.lower() in (".jpg", ".jpeg") else (
        images.read_rgba(image.path)[1])
    if alpha is None:
        alpha = images.read_mask(_mask_file(image), image.size)
    alpha = np.asarray(255 - alpha, np.uint8) if invert else alpha
    alpha = alpha if lens is None else lens.alone(alpha)
    row, column = (np.flatnonzero((alpha >= SOLID).any(axis)) for axis in (1, 0))
    if not len(row):
        return np.zeros(2, np.int64), np.array(image.size)
    return np.array([column[0], row[0]]), np.array([column[-1], row[-1]]) + 1


def _load_state(posed: Sequence[PosedImage], config: ReadConfig,
                window: Window | None) -> StateViews:
    """Decode, undistort, crop and downscale all images of one state to one size."""
    if window is None:
        window = Window(posed[0].size, np.zeros((len(posed), 2), np.int64))
    size = _target_size(window.size, config.max_side)
    if size[0] * size[1] * 4 * len(posed) > MAX_SCENE_BYTES:
        raise SceneError(f"{posed[0].path.parent}: {len(posed)} images of {size[0]} x {size[1]} "
                         f"need more than {MAX_SCENE_BYTES >> 30} GiB. Expected less; lower "
                         "--max-side or use fewer photos.")
    with_depth = config.depth and all(image.depth is not None for image in posed)
    whole = in_threads([partial(_load_view, image, lens, config.invert_masks, with_depth,
                                partial(_cut, corner, window.size, size))
                        for image, lens, corner in
                        zip(posed, _lenses(posed), window.corners, strict=True)])
    counts = (np.stack([cast("NDArray[np.uint16]", view[3]) for view in whole])
              if with_depth else None)
    units = np.array([image.depth_unit for image in posed])
    return StateViews(
        images=np.stack([view[0] for view in whole]),
        alphas=np.stack([view[1] for view in whole]),
        Ks=np.stack([view[2] for view in whole]),
        viewmats=np.stack([image.camera_from_world for image in posed]),
        depths=None if counts is None else counts * units.astype(np.float32)[:, None, None],
        names=tuple(image.name for image in posed),
        held_out=_held_out(len(posed)),
        depth_counts=None if counts is None else (counts, units))


def _lenses(posed: Sequence[PosedImage]) -> list[images.Undistorter | None]:
    """Return the lens of every image, None where it does not distort; one for equal images."""
    found: dict[bytes, images.Undistorter] = {}
    lenses: list[images.Undistorter | None] = []
    for image in posed:
        if image.distortion is None:
            lenses.append(None)
            continue
        key = image.K.tobytes() + np.array((*image.distortion, *image.size)).tobytes()
        key += (image.lens or "").encode()
        if key not in found:  # maps of a 12-megapixel photo take a tenth of a second
            found[key] = images.Undistorter(image.K, image.distortion, image.size, image.lens)
        lenses.append(found[key])
    return lenses


def _load_view(image: PosedImage, lens: images.Undistorter | None, invert: bool, with_depth: bool,
               cut: Callable[[View], View]) -> View:
    """Return what `cut` leaves of an undistorted photo."""
    rgb, alpha = images.read_rgba(image.path)
    if (rgb.shape[1], rgb.shape[0]) != image.size:
        raise SceneError(f"{image.path}: decodes to {rgb.shape[1]} x {rgb.shape[0]} pixels, its "
                         f"header says {image.size}. Expected equal sizes; export it again.")
    if alpha is None:
        alpha = images.read_mask(_mask_file(image), image.size)
    if invert:
        alpha = np.asarray(255 - alpha, np.uint8)
    depth = images.read_depth(cast(Path, image.depth), image.size) if with_depth else None
    K = image.K
    if lens is not None:
        (rgb, alpha), K = lens.color(rgb, alpha), lens.K
        depth = None if depth is None else lens.depth(depth)
    return cut((rgb, alpha, K, depth))


def _cut(corner: NDArray[np.int64], window: Size, size: Size, view: View) -> View:
    """Return the window of a photo at a corner, resized; its camera follows."""
    rgb, alpha, K, depth = view
    (x, y), (width, height) = (int(c) for c in corner), window
    inner = np.s_[y:y + height, x:x + width]
    rgb, alpha, depth = rgb[inner], alpha[inner], None if depth is None else depth[inner]
    K = K - np.array([[0, 0, x], [0, 0, y], [0, 0, 0]])
    if size == window:
        return np.ascontiguousarray(rgb), np.ascontiguousarray(alpha), K, depth
    rgb, alpha = images.resize_area(rgb, alpha, size)
    depth = None if depth is None else images.resize_nearest(depth, size)
    return rgb, alpha, np.diag([size[0] / width, size[1] / height, 1.0]) @ K, depth


def _mask_file(image: PosedImage) -> Path:
    """Return mask_path, or the sibling masks/ file of an image without alpha."""
    if image.mask is not None:
        return image.mask
    masks = image.path.parent.parent / "masks"
    for name in (f"{image.path.stem}.png", f"{image.path.name}.png", image.path.name):
        if (masks / name).is_file() and not (masks / name).is_symlink():
            return masks / name
    raise SceneError(f"{image.path}: no alpha channel, no mask_path and no {masks.name}/"
                     f"{image.path.stem}.png. Expected the object cut out from its background; "
                     "make masks (for example with rembg) as alpha or in a masks folder.")


def _target_size(size: Size, max_side: int) -> Size:
    scale = min(1.0, max_side / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _held_out(views: int) -> NDArray[np.bool_]:
    return np.asarray(np.arange(views) % HELD_OUT_EVERY == HELD_OUT_EVERY // 2)


def _notes(posed: States, states: tuple[StateViews, StateViews],
           windows: tuple[Window | None, Window | None], config: ReadConfig) -> tuple[str, ...]:
    notes = []
    for index, (raw, views, window) in enumerate(zip(posed, states, windows, strict=True)):
        size = raw[0].size if window is None else window.size
        if window is not None:
            notes.append(f"State {index}: {raw[0].size[0]} x {raw[0].size[1]} images cropped round "
                         f"the object to {size[0]} x {size[1]}.")
        if size != (views.width, views.height):
            notes.append(f"State {index}: {size[0]} x {size[1]} images downscaled to "
                         f"{views.width} x {views.height} (--max-side {config.max_side}).")
        undistorted = sum(image.distortion is not None for image in raw)
        if undistorted:
            notes.append(f"State {index}: lens distortion removed from {undistorted} images.")
        partial = sum(image.depth is not None for image in raw)
        if config.depth and 0 < partial < len(raw):
            notes.append(f"State {index}: depth ignored, {len(raw) - partial} images have none.")
    return tuple(notes)
