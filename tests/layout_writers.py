"""The ball scene written in the layouts of others, by code that shares nothing with our readers.

Each follows the data sets' own files: PARIS and DTA as their authors' loaders read them, COLMAP by
pycolmap, the library of its authors.
"""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
from synth_photos import FOV, ball_photo, ring_of_cameras

VIEWS, SIDE = 24, 48
FOCAL = SIDE / (2 * np.tan(FOV / 2))


def photos(state: int):
    """Yield camera-to-world (OpenGL axes) and RGBA photo of every view of a state."""
    for pose in ring_of_cameras(VIEWS):
        yield pose, ball_photo(pose, SIDE, state)


def save(path: Path, rgba: np.ndarray) -> None:
    """Write pixels as PNG, RGBA or one channel."""
    path.parent.mkdir(parents=True, exist_ok=True)
    order = rgba[..., [2, 1, 0, 3][:rgba.shape[2]]] if rgba.ndim == 3 else rgba
    assert cv2.imwrite(str(path), order)


def write_paris(folder: Path) -> Path:
    """load/sapien/<category>/<id>: camera_<split>.json with K and one matrix per image key."""
    K = [[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1]]
    for state, name in enumerate(("start", "end")):
        listed: dict[str, object] = {"K": K}
        for number, (pose, rgba) in enumerate(photos(state)):
            save(folder / name / "train" / f"{number:04d}.png", rgba)
            listed[f"{number:04d}"] = pose.tolist()
        (folder / name / "camera_train.json").write_text(json.dumps(listed))
        for split in ("val", "test"):  # held out by the benchmark: nobody may read them
            (folder / name / f"camera_{split}.json").write_text("answers")
    return folder


def write_dta(folder: Path) -> Path:
    """data/<instance>: cam_K.txt, init_keyframes.yml and folders of images named <t>_<id>."""
    folder.mkdir(parents=True)
    (folder / "cam_K.txt").write_text(f"{FOCAL:.10f} 0.0 {SIDE / 2}\n0.0 {FOCAL:.10f} {SIDE / 2}\n"
                                      "0.0 0.0 1.0\n")
    lines = []
    for state in (0, 1):
        for number, (pose, rgba) in enumerate(photos(state)):
            stem = f"{state}_{number:04d}"
            save(folder / "color_segmented" / f"{stem}.png", rgba[..., :3])
            save(folder / "color_raw" / f"{stem}.png", rgba[..., :3])
            save(folder / "mask" / f"{stem}.png", rgba[..., 3])
            values = "".join(f"  - {float(v)!r}\n" for v in pose.ravel())
            lines.append(f"frame_{stem}:\n  cam_in_ob:\n{values}  time: {state}\n")
    (folder / "init_keyframes.yml").write_text("".join(lines))
    return folder


def write_colmap(folder: Path, kind: str = "bin", camera=None, places=("images/a", "images/b"),
                 view=None) -> Path:
    """Two folders of photos and sparse/0, written by pycolmap.

    Args:
        folder: of the scene.
        kind: bin or txt.
        camera: pycolmap camera; None = a pinhole.
        places: folders of the states' photos.
        view: pixels of a photo from its number and state; None = those of a pinhole.
    """
    import pycolmap

    model = pycolmap.Reconstruction()
    camera = camera or pycolmap.Camera(model="PINHOLE", width=SIDE, height=SIDE,
                                       params=[FOCAL, FOCAL, SIDE / 2, SIDE / 2], camera_id=7)
    model.add_camera_with_trivial_rig(camera)
    number = 0
    for state, place in enumerate(places):
        for index, (pose, rgba) in enumerate(photos(state)):
            number += 1
            name = f"{place.removeprefix('images/')}/photo {index:03d}.png"
            save(folder / place / f"photo {index:03d}.png",
                 rgba if view is None else view(index, state))
            world = np.linalg.inv(pose @ np.diag([1.0, -1, -1, 1]))
            image = pycolmap.Image(name=name, camera_id=camera.camera_id, image_id=number,
                                   keypoints=np.random.default_rng(number).random((number % 3, 2)))
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(world[:3]))
    (folder / "sparse/0").mkdir(parents=True)
    getattr(model, "write_binary" if kind == "bin" else "write_text")(str(folder / "sparse/0"))
    return folder
