"""Scene folder in, Scene out: detect the layout, read cameras, decode images, validate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
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


def read_scene(path: Path, config: ReadConfig) -> Scene:
    """Return both states of the scene folder, validated.

    Args:
        path: scene folder in one of the layouts of `layouts.py`.
        config: what may be changed or assumed.

    Raises:
        SceneError: anything in the folder that cannot be used; says what, where and what to do.
    """
    layout, posed = read_cameras(path, config)
    states = (_load_state(posed[0], config), _load_state(posed[1], config))
    notes = _notes(posed, states, config)
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


def _load_state(posed: Sequence[PosedImage], config: ReadConfig) -> StateViews:
    """Decode, undistort and downscale all images of one state to one size."""
    size = _target_size(posed[0].size, config.max_side)
    if size[0] * size[1] * 4 * len(posed) > MAX_SCENE_BYTES:
        raise SceneError(f"{posed[0].path.parent}: {len(posed)} images of {size[0]} x {size[1]} "
                         f"need more than {MAX_SCENE_BYTES >> 30} GiB. Expected less; lower "
                         "--max-side or use fewer photos.")
    with_depth = config.depth and all(image.depth is not None for image in posed)
    loaded = in_threads([partial(_load_view, image, lens, size, config.invert_masks, with_depth)
                         for image, lens in zip(posed, _lenses(posed), strict=True)])
    counts = (np.stack([cast("NDArray[np.uint16]", view[3]) for view in loaded])
              if with_depth else None)
    units = np.array([image.depth_unit for image in posed])
    return StateViews(
        images=np.stack([view[0] for view in loaded]),
        alphas=np.stack([view[1] for view in loaded]),
        Ks=np.stack([view[2] for view in loaded]),
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


def _load_view(
    image: PosedImage, lens: images.Undistorter | None, size: tuple[int, int], invert: bool,
    with_depth: bool,
) -> tuple[images.U8, images.U8, NDArray[np.float64], NDArray[np.uint16] | None]:
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
    if size != image.size:
        K = np.diag([size[0] / image.size[0], size[1] / image.size[1], 1.0]) @ K
        rgb, alpha = images.resize_area(rgb, alpha, size)
        depth = None if depth is None else images.resize_nearest(depth, size)
    return rgb, alpha, K, depth


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


def _target_size(size: tuple[int, int], max_side: int) -> tuple[int, int]:
    scale = min(1.0, max_side / max(size))
    return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))


def _held_out(views: int) -> NDArray[np.bool_]:
    return np.asarray(np.arange(views) % HELD_OUT_EVERY == HELD_OUT_EVERY // 2)


def _notes(posed: States, states: tuple[StateViews, StateViews],
           config: ReadConfig) -> tuple[str, ...]:
    notes = []
    for index, (raw, views) in enumerate(zip(posed, states, strict=True)):
        if raw[0].size != (views.width, views.height):
            notes.append(f"State {index}: {raw[0].size[0]} x {raw[0].size[1]} images downscaled to "
                         f"{views.width} x {views.height} (--max-side {config.max_side}).")
        undistorted = sum(image.distortion is not None for image in raw)
        if undistorted:
            notes.append(f"State {index}: lens distortion removed from {undistorted} images.")
        partial = sum(image.depth is not None for image in raw)
        if config.depth and 0 < partial < len(raw):
            notes.append(f"State {index}: depth ignored, {len(raw) - partial} images have none.")
    return tuple(notes)
