"""PARIS layout: {start,end}/camera_train.json beside {start,end}/train/<key>.png.

As in the code of PARIS (github.com/3dlg-hcvc/paris): camera-to-world with OpenGL axes, one focal
length K[0][0], the principal point in the middle of the image.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.image_files import image_size, inside, own_file
from part2gs_robotics.readers.nerfstudio import (
    MAX_FRAMES,
    SUFFIXES,
    Json,
    PosedImage,
    from_opengl,
    intrinsics,
    read_json,
    refuse_missing,
)

STATES = ("start", "end")
FILE = "camera_train.json"  # camera_val and camera_test are the benchmark's held-out views


def is_paris(scene: Path) -> bool:
    """Tell whether the folder holds (at least half of) a PARIS scene."""
    return any((scene / state / FILE).is_file() for state in STATES)


def read_paris(scene: Path, allow_missing: bool) -> tuple[list[PosedImage], list[PosedImage]]:
    """Return the posed training images of both states.

    Args:
        scene: folder of the scene.
        allow_missing: drop frames without image.

    Raises:
        SceneError: cameras that cannot be used, or images that lack.
    """
    start, end = (_state(scene, state, allow_missing) for state in STATES)
    return start, end


def _state(scene: Path, state: str, allow_missing: bool) -> list[PosedImage]:
    path = scene / state / FILE
    own_file(path, scene)
    content = read_json(path)
    frames = {key: pose for key, pose in content.items() if key != "K"}
    if len(frames) > MAX_FRAMES:
        raise SceneError(f"{path}: {len(frames)} frames. Expected at most {MAX_FRAMES}; "
                         "keep the sharpest photos of each state.")
    focal, images, missing = _focal(content, path), [], []
    for key, pose in sorted(frames.items()):
        where = f"{path}: frame {key[:40]!r}"
        image = _image(scene, path.parent / "train", key, where)
        if image is None:
            missing.append(key[:40])
            continue
        size = image_size(image)
        K = intrinsics({"fl_x": focal}, size, where)
        images.append(PosedImage(f"{state}/train/{key}", image, size, K, None,
                                 from_opengl(pose, "matrix", where)))
    if missing and not allow_missing:
        refuse_missing(path, missing, len(frames))
    return images


def _focal(content: Json, path: Path) -> float:
    try:
        K = np.array(content.get("K"), float)
    except (TypeError, ValueError, OverflowError):
        K = np.zeros(0)
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise SceneError(f"{path}: K has shape {K.shape} or holds no finite numbers. Expected the "
                         "3 x 3 intrinsics of all images, in pixels; export the cameras again.")
    return float(K[0, 0])


def _image(scene: Path, folder: Path, key: str, where: str) -> Path | None:
    for suffix in SUFFIXES:
        if inside(scene, folder, f"{key}{suffix}", where).is_file():
            return inside(scene, folder, f"{key}{suffix}", where)
    return None
