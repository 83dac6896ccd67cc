"""DTA layout: cam_K.txt, init_keyframes.yml, color_segmented/, mask/ and depth_filtered/.

As in the code of DTA (github.com/NVlabs/DigitalTwinArt): keyframes `frame_<t>_<id>` with
`cam_in_ob`, 16 numbers of a camera-to-world matrix with OpenGL axes, and `time` 0 or 1.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import cast

import numpy as np

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.readers.image_files import image_size, inside, own_file
from part2gs_robotics.readers.nerfstudio import (
    DEPTH_UNIT,
    MAX_FRAMES,
    PosedImage,
    from_opengl,
    intrinsics,
    refuse_missing,
)
from part2gs_robotics.runtime.plain_yaml import NotPlainError, read_plain_file

KEYFRAMES, CAMERA = "init_keyframes.yml", "cam_K.txt"
NAME = re.compile(r"frame_(\d+_\d+)")
MAX_BYTES = 4 << 20  # 10,000 keyframes of 16 numbers are 3 MB
MAX_DEPTH = 4  # keyframes, one of them, its matrix, a row
MAX_K_BYTES = 4096  # nine numbers


def is_dta(scene: Path) -> bool:
    """Tell whether the folder holds (at least half of) a DTA scene."""
    return (scene / KEYFRAMES).is_file()


def read_dta(scene: Path, allow_missing: bool, depth: bool,
             ) -> tuple[list[PosedImage], list[PosedImage]]:
    """Return the posed images of both states.

    Args:
        scene: folder of the scene.
        allow_missing: drop frames without image.
        depth: use depth_filtered/ where all images of a state have it.

    Raises:
        SceneError: cameras that cannot be used, or images that lack.
    """
    for name in (CAMERA, KEYFRAMES):
        own_file(scene / name, scene)
    K, frames = _intrinsics(scene / CAMERA), _keyframes(scene / KEYFRAMES)
    states: tuple[list[PosedImage], list[PosedImage]] = ([], [])
    missing = []
    for name, frame in sorted(frames.items()):
        where = f"{scene / KEYFRAMES}: {name[:40]}"
        time, stem = _time_and_stem(name, frame, where)
        image = _file(scene, "color_segmented", stem, where)
        if image is None:
            missing.append(name[:40])
        else:
            mask, far = (_file(scene, folder, stem, where) for folder in ("mask", "depth_filtered"))
            states[time].append(_posed(image, K, frame, (mask, far if depth else None), where))
    if missing and not allow_missing:
        refuse_missing(scene / KEYFRAMES, missing, len(frames))
    return states


def _posed(image: Path, K: F64, frame: dict[str, object], files: tuple[Path | None, Path | None],
           where: str) -> PosedImage:
    size = image_size(image)
    (fx, _, cx), (_, fy, cy), _ = K
    checked = intrinsics({"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy}, size, where)
    try:
        pose: F64 = np.array(frame.get("cam_in_ob"), float).reshape(4, 4)
    except (TypeError, ValueError, OverflowError):
        pose = np.zeros(0)
    return PosedImage(image.name, image, size, checked, None,
                      from_opengl(pose, "cam_in_ob", where), mask=files[0], depth=files[1],
                      depth_unit=DEPTH_UNIT)


def _time_and_stem(name: str, frame: object, where: str) -> tuple[int, str]:
    named = NAME.fullmatch(name)
    if named is None or not isinstance(frame, dict):
        raise SceneError(f"{where}: not a keyframe. Expected frame_<time>_<number> with cam_in_ob "
                         "and time; export the keyframes again.")
    time = frame.get("time")
    if isinstance(time, bool) or time not in (0, 1):
        raise SceneError(f"{where}: time is {str(time)[:40]!r}. Expected 0 or 1, the state this "
                         "photo shows; keep two states.")
    return int(time), named[1]


def _file(scene: Path, folder: str, stem: str, where: str) -> Path | None:
    path = inside(scene, scene / folder, f"{stem}.png", where)
    return path if path.is_file() else None


def _intrinsics(path: Path) -> F64:
    try:
        text = path.read_bytes()[:MAX_K_BYTES].decode("utf-8")
        K = np.array([float(word) for word in text.split()]).reshape(3, 3)
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror}). Expected the cameras of the "
                         "scene in this file; check that it exists and is readable.") from err
    except ValueError as err:
        raise SceneError(f"{path}: is not a matrix of 3 x 3 numbers. Expected the intrinsics of "
                         "all images, in pixels; export the cameras again.") from err
    if not np.isfinite(K).all():
        raise SceneError(f"{path}: holds NaN or infinity. Expected the intrinsics of all images, "
                         "in pixels; export the cameras again.")
    return np.asarray(K)


def _keyframes(path: Path) -> dict[str, dict[str, object]]:
    try:
        content = read_plain_file(path, MAX_BYTES, MAX_DEPTH)
    except NotPlainError as err:
        raise SceneError(f"{path}: {err}. Expected plain keyframes with cam_in_ob and time; export "
                         "them again.") from err
    if not isinstance(content, dict) or len(content) > MAX_FRAMES:
        raise SceneError(f"{path}: holds no mapping of at most {MAX_FRAMES} keyframes. Expected "
                         "frame_<time>_<number> with cam_in_ob and time; export them again.")
    return {str(name): cast("dict[str, object]", frame) for name, frame in content.items()}
