"""Photos, masks and cameras to a scene folder, whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.posed import Posed
from part2gs_robotics.runtime.atomic import remove_quietly, sync_folder, write_error

U8 = NDArray[np.uint8]

JPEG_QUALITY = 95  # loses less than the phone's own JPEG did


def check_out(out: Path) -> None:
    """Refuse an output folder that holds anything.

    Raises:
        SceneError: it does.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise SceneError(f"{out}: exists and is not empty. Expected a new folder for the scene; "
                         "choose another name with -o or remove it first.")


def write_scene(out: Path, photos: Sequence[Sequence[U8]], masks: Sequence[Sequence[U8]],
                posed: Posed, facts: dict[str, object]) -> None:
    """Write the scene in the layout of one transforms.json per state.

    Args:
        out: new folder.
        photos: per state, one per registered photo, of one size.
        masks: one per photo, 255 = object.
        posed: cameras in the scene's world; z is up.
        facts: what `scene.json` says of how it was made; "settings" go to scene.yaml.

    Raises:
        StoreError: the folder cannot be written; nothing is left there.
    """
    temporary = out.with_name(f".{out.name}.tmp-{os.getpid()}")
    try:
        temporary.mkdir(parents=True)
        for state in (0, 1):
            _write_state(temporary / f"state_{state}", photos[state], masks[state], posed, state)
        settings = facts.pop("settings", {})
        lines = [f"{key}: {value}\n" for key, value in dict(settings).items()]  # type: ignore[call-overload]
        _write(temporary / "scene.yaml", "".join(lines).encode())
        _write(temporary / "scene.json", (json.dumps(facts, indent=1) + "\n").encode())
        if out.is_dir():
            out.rmdir()  # empty: `check_out` saw to it
        os.replace(temporary, out)
        sync_folder(out.parent)
    except OSError as err:
        raise write_error(out, err) from err
    finally:
        remove_quietly(temporary)


def _write_state(folder: Path, photos: Sequence[U8], masks: Sequence[U8], posed: Posed,
                 state: int) -> None:
    for name in ("images", "masks"):
        (folder / name).mkdir(parents=True)
    frames = []
    for name, photo, mask, view in zip(posed.names[state], photos, masks, posed.viewmats[state],
                                       strict=True):
        stem = Path(name).stem
        _write(folder / "images" / f"{stem}.jpg", _encoded(".jpg", photo[..., ::-1]))
        _write(folder / "masks" / f"{stem}.png", _encoded(".png", mask))
        frames.append({"file_path": f"images/{stem}.jpg", "mask_path": f"masks/{stem}.png",
                       "transform_matrix": _opengl(view).tolist()})
    height, width = photos[0].shape[:2]
    lens = {"camera_model": "PINHOLE", "fl_x": posed.K[0, 0], "fl_y": posed.K[1, 1],
            "cx": posed.K[0, 2], "cy": posed.K[1, 2], "w": width, "h": height}
    _write(folder / "transforms.json", (json.dumps({**lens, "frames": frames}, indent=1) + "\n"
                                        ).encode())


def _opengl(camera_from_world: F64) -> F64:
    """Return world_from_camera with OpenGL axes: x right, y up, z back."""
    return np.asarray(np.linalg.inv(camera_from_world) @ np.diag([1.0, -1.0, -1.0, 1.0]))


def _encoded(ending: str, pixels: NDArray[np.uint8]) -> bytes:
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if ending == ".jpg" else []
    return bytes(cv2.imencode(ending, np.ascontiguousarray(pixels), options)[1])


def _write(path: Path, data: bytes) -> None:
    """Write and sync a file inside the folder that is renamed when all are there."""
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def disk_needed(photos: Sequence[Sequence[U8]]) -> int:
    """Return a bound of the scene's size in bytes: photos as they are in memory."""
    return sum(photo.nbytes for state in photos for photo in state)


def check_space(out: Path, needed: int) -> None:
    """Refuse to begin where the scene would not fit.

    Raises:
        SceneError: too little space is free.
    """
    there = out.absolute().parent
    while not there.exists():
        there = there.parent
    free = shutil.disk_usage(there).free
    if free < needed:
        raise SceneError(f"{out}: {free // 10**6} MB free. Expected {needed // 10**6} MB for the "
                         "scene; free some space or choose another place with -o.")
