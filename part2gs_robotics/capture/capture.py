"""Photograph a two-state scene with ground truth from an articulated MJCF or URDF.

Written files:
- scene/transforms_{train,test}_{start,end}.json: cameras, world_from_camera in OpenGL axes
- scene/{start,end}/{train,test}/rgba/0000.png: straight RGB, alpha = covered share
- scene/{start,end}/{train,test}/depth/0000.png: optional, uint16 thousandths, 0 = background
- scene.gt/gt.json: parts, joints and both states; beside the scene, never in it
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.assets.engine import logged_messages
from part2gs_robotics.capture.cameras import FOV_RAD, place_cameras
from part2gs_robotics.capture.joint_states import States, choose_states
from part2gs_robotics.errors import ConfigError, SceneError

if TYPE_CHECKING:
    from part2gs_robotics.capture.rig import JointInfo, Rig

Array = NDArray[np.float64]

STATE_NAMES = ("start", "end")
VIEWS = (4, 2000)  # per state, the least and most that can mean anything
SIZES = (32, 2048)  # 2048 x 3 sub-pixels is the widest off-screen buffer of software EGL


@dataclass(frozen=True)
class Captured:
    """What was written: scene folder, truth folder, moving joints, images and seconds."""

    scene: Path
    truth: Path
    joints: tuple[str, ...]
    frames: int
    seconds: float


@dataclass(frozen=True)
class Shots:
    """What is photographed.

    Attributes:
        views: training views per state.
        test_views: further views per state that no fit may use.
        size: image side, pixels.
        seed: places of the cameras; the same seed gives the same bytes on one machine.
        depth: also write 16-bit depth images.
    """

    views: int = 64
    test_views: int = 0
    size: int = 400
    seed: int = 0
    depth: bool = False


def capture(model: Path, scene: Path, shots: Shots | None = None,
            states: States | None = None) -> Captured:
    """Write a two-state scene and its ground truth from an articulated model.

    Args:
        model: MJCF or URDF file; every file it refers to lies below its folder.
        scene: new folder; the truth goes to `<scene>.gt` beside it.
        shots: how many photos of what size; None = 64 per state of 400 pixels.
        states: joint name -> (q at state 0, q at state 1), rad or scene units. None moves every
            hinge and slide from 5 % to 75 % of its range (unlimited: 0 to 45 degrees).

    Returns:
        Where everything lies.

    Raises:
        ConfigError: a number or joint that cannot be used.
        CheckError: a model that cannot be read.
        SceneError: an output folder that cannot be written.
    """
    from part2gs_robotics.capture.rig import Rig

    shots = shots or Shots()
    _check_numbers(shots.views, shots.test_views, shots.size)
    began = time.perf_counter()
    with (
        logged_messages(str(model)),
        _new_folders(scene) as (folder, truth),
        Rig(model, shots.size) as rig,
    ):
        moves = choose_states(rig, states, model)
        clouds = [_posed(rig, moves, s) for s in (0, 1)]
        cloud = np.concatenate(clouds)
        rig.focus(cloud)
        for s in (0, 1):
            _posed(rig, moves, s)
            for split, count in (("train", shots.views), ("test", shots.test_views)):
                rng = np.random.default_rng([shots.seed, s, split == "test"])
                if count:
                    _shoot_all(rig, place_cameras(cloud, count, rng), folder, s, split, shots)
        notes: dict[str, object] = {"model": model.name, "views": shots.views,
                                    "size": shots.size, "seed": shots.seed}
        _write_json(truth / "gt.json", _truth(rig, moves, cloud, notes))
    return Captured(
        scene, _truth_folder(scene), tuple(j.name for j, _ in moves),
        2 * (shots.views + shots.test_views), time.perf_counter() - began,
    )  # fmt: skip


def _check_numbers(views: int, test_views: int, size: int) -> None:
    if not VIEWS[0] <= views <= VIEWS[1] or not 0 <= test_views <= VIEWS[1]:
        raise ConfigError(
            f"capture: --views {views}, test views {test_views}. "
            f"Expected {VIEWS[0]} to {VIEWS[1]} views per state; change --views."
        )
    if not SIZES[0] <= size <= SIZES[1]:
        raise ConfigError(
            f"capture: --size {size}. Expected {SIZES[0]} to {SIZES[1]} pixels; change --size."
        )


def _posed(rig: Rig, moves: list[tuple[JointInfo, tuple[float, float]]], s: int) -> Array:
    rig.pose({joint.name: values[s] for joint, values in moves})
    return rig.points()


def _shoot_all(rig: Rig, cameras: list[Array], folder: Path, s: int, split: str, shots: Shots,
               ) -> None:
    """Write the images and the camera file of one state and split."""
    below, size = f"{STATE_NAMES[s]}/{split}", shots.size
    focal = size / 2 / np.tan(FOV_RAD / 2)
    frames = []
    for i, world_from_camera in enumerate(cameras):
        rgba, z = rig.shoot(world_from_camera, depth=shots.depth)
        _write_png(folder / below / "rgba" / f"{i:04d}.png", rgba[..., [2, 1, 0, 3]])
        if shots.depth:
            steps = np.clip((z * 1000).round(), 0, 65535).astype(np.uint16)
            _write_png(folder / below / "depth" / f"{i:04d}.png", steps)
        frames.append(
            {
                "file_path": f"{below}/rgba/{i:04d}.png",
                "time": s,
                "transform_matrix": world_from_camera.tolist(),
            }
        )
    lens = {"camera_angle_x": FOV_RAD, "camera_angle_y": FOV_RAD, "fl_x": focal, "fl_y": focal}
    frame = {"cx": size / 2, "cy": size / 2, "w": size, "h": size, "frames": frames}
    _write_json(folder / f"transforms_{split}_{STATE_NAMES[s]}.json", {**lens, **frame})


def _truth(
    rig: Rig,
    moves: list[tuple[JointInfo, tuple[float, float]]],
    cloud: Array,
    notes: dict[str, object],
) -> dict[str, object]:
    """Return the truth: axes point so that every motion from state 0 to state 1 is positive."""
    _posed(rig, moves, 0)
    moving = {joint.body: k for k, (joint, _) in enumerate(moves, 1)}
    parts = []
    for joint, (first, second) in moves:
        axis, anchor = rig.axis_and_anchor(joint)
        kind = ("revolute" if joint.limits else "continuous") if joint.hinge else "prismatic"
        parts.append(
            {
                "name": rig.body_name(joint.body),
                "joint": joint.name,
                "type": kind,
                "axis": (axis * np.sign(second - first)).tolist(),
                "point": anchor.tolist(),
                "parent": rig.carrier(joint.body, moving),
                "motion": abs(second - first),
                "q": [first, second],
            }
        )
    low, high = cloud.min(0), cloud.max(0)
    diagonal = float(np.linalg.norm(high - low))
    box = {"bbox": [low.tolist(), high.tolist()], "bbox_diagonal": diagonal}
    return {"parts": parts, **box, **notes}


def _truth_folder(scene: Path) -> Path:
    return scene.with_name(scene.name + ".gt")


@contextmanager
def _new_folders(scene: Path) -> Iterator[tuple[Path, Path]]:
    """Yield two temporary folders that become the scene and its truth when all went well."""
    truth = _truth_folder(scene)
    for target in (scene, truth):
        if target.exists() and (not target.is_dir() or any(target.iterdir())):
            raise SceneError(
                f"{target}: exists and is not empty. Expected a new folder; "
                "choose another name or remove it first."
            )
    temporary = [t.with_name(f".{t.name}.tmp-{os.getpid()}") for t in (scene, truth)]
    try:
        for path in temporary:
            path.mkdir(parents=True)
        yield temporary[0], temporary[1]
        for path, target in zip(temporary, (scene, truth), strict=True):
            os.replace(path, target)
    except OSError as error:
        raise SceneError(
            f"{scene}: cannot be written ({error.strerror or error}). "
            "Expected a writable folder with free space; choose another place."
        ) from error
    finally:
        for path in temporary:
            shutil.rmtree(path, ignore_errors=True)


def _write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes())


def _write_json(path: Path, content: dict[str, object]) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n")
