"""Synthetic photos: two balls, one of which moves, ray-cast exactly and written as a scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.atomic import write_bytes_atomic, write_text_atomic

Layout = Literal["artgs", "nerfstudio", "single"]

DISTANCE = 4.0  # cameras to origin
FOV = 0.7  # rad, both balls in either state fill about half of the image
BALLS = (  # (centre in state 0, centre in state 1, radius, colour)
    ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.7, (200, 60, 40)),
    ((0.8, 0.0, 0.2), (0.0, 0.8, 0.2), 0.35, (40, 90, 220)),
)


# Settings of `build` for such a scene of 32 pixels: all stages run, in seconds and to no good twin.
TINY = {"preset": "draft", "steps": 40, "half_steps": 10, "device": "cpu", "parts": 1,
        "stereo": False, "texture": False, "resolution": 32, "hull_resolution": 32,
        "start_gaussians": 1500, "max_gaussians": 2000, "patches": 4, "surfel_size": 0.04,
        "proof_views": 4, "proof_side": 32, "align_views": 4, "align_side": 32, "sharp_side": 32,
        "sweep_values": 3, "free_range": False, "flat_walls": False, "convex": False}


def write_ball_scene(folder: Path, views: int = 24, side: int = 48,
                     layout: Layout = "artgs") -> Path:
    """Write a two-state scene of a fixed ball and a ball that turns by 90 degrees about z.

    Args:
        folder: created; the scene's world has the fixed ball of radius 0.7 at its origin.
        views: photos per state, evenly spread on a sphere.
        side: image side in pixels.
        layout: how cameras are written.
    """
    frames: list[list[dict[str, object]]] = [[], []]
    for state, name in enumerate(("start", "end")):
        images = folder / name / "train" / "rgba"
        images.mkdir(parents=True)
        for view, world_from_camera in enumerate(ring_of_cameras(views)):
            pixels = ball_photo(world_from_camera, side, state)
            data = np.asarray(cv2.imencode(".png", pixels[..., [2, 1, 0, 3]])[1]).tobytes()
            write_bytes_atomic(images / f"{view:04d}.png", data)
            base = folder / name if layout == "nerfstudio" else folder  # where the json lies
            path = (images / f"{view:04d}.png").relative_to(base)
            frames[state].append({"file_path": path.as_posix(), "time": state,
                                  "transform_matrix": world_from_camera.tolist()})
    focal = side / (2 * np.tan(FOV / 2))
    angle = {"camera_angle_x": FOV}
    full = {"fl_x": focal, "fl_y": focal, "cx": side / 2, "cy": side / 2, "w": side, "h": side}
    jsons = {
        "artgs": [("transforms_train_start.json", angle, frames[0]),
                  ("transforms_train_end.json", angle, frames[1])],
        "nerfstudio": [("start/transforms.json", full, frames[0]),
                       ("end/transforms.json", full, frames[1])],
        "single": [("transforms.json", full, frames[0] + frames[1])],
    }[layout]
    for name, intrinsics, listed in jsons:
        write_text_atomic(folder / name, json.dumps({**intrinsics, "frames": listed}))
    return folder


def ring_of_cameras(views: int, distance: float = DISTANCE, height: float = 0.9) -> list[F64]:
    """Return [4, 4] world_from_camera, OpenGL axes, looking at the origin from all around.

    Args:
        views: number of cameras.
        distance: to the origin.
        height: bound of the cameras' heights over `distance`; none stands on a pole.
    """
    golden = np.pi * (3 - np.sqrt(5))
    out = []
    for k in range(views):
        z = height * (1 - 2 * (k + 0.5) / views)
        flat = np.sqrt(1 - z * z)
        back = np.array([flat * np.cos(golden * k), flat * np.sin(golden * k), z])
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        pose[:3, 3] = distance * back
        out.append(pose)
    return out


def viewmats_around(views: int, distance: float) -> F64:
    """Return [V, 4, 4] camera_from_world, OpenCV axes, evenly over the whole sphere."""
    opengl_from_opencv = np.diag([1.0, -1.0, -1.0, 1.0])
    poses = ring_of_cameras(views, distance, 1.0)
    return np.stack([np.linalg.inv(pose @ opengl_from_opencv) for pose in poses])


def box_depth(camera_from_box: F64, low: F64, high: F64, side: int, focal: float) -> F64:
    """Return [side, side] exact z-depth of a box, infinite beside it (slab test)."""
    box_from_camera = np.linalg.inv(camera_from_box)
    u = (np.arange(side) + 0.5 - side / 2) / focal
    local = np.stack([*np.meshgrid(u, u), np.ones((side, side))], -1)
    rays, eye = local @ box_from_camera[:3, :3].T, box_from_camera[:3, 3]
    with np.errstate(divide="ignore"):
        a, b = (low - eye) / rays, (high - eye) / rays
    near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
    return np.where(near < far, near, np.inf)


def ball_photo(world_from_camera: F64, side: int, state: int) -> NDArray[np.uint8]:
    """Return [side, side, 4] RGBA of both balls, shaded by their normals."""
    focal = side / (2 * np.tan(FOV / 2))
    at = (np.arange(side) + 0.5 - side / 2) / focal
    x, y = np.meshgrid(at, -at)
    rays = np.stack([x, y, -np.ones_like(x)], -1) @ world_from_camera[:3, :3].T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    eye = world_from_camera[:3, 3]
    image = np.zeros((side, side, 4), np.uint8)
    nearest = np.full((side, side), np.inf)
    for *centres, radius, color in BALLS:
        to_ball = np.array(centres[state]) - eye
        along = rays @ to_ball
        inside = radius**2 - (to_ball @ to_ball - along**2)
        depth = along - np.sqrt(np.maximum(inside, 0.0))
        hit = (inside > 0) & (depth < nearest)
        normals = (depth[..., None] * rays - to_ball) / radius
        shade = 0.6 + 0.4 * normals[..., 2:]
        painted = np.concatenate([np.array(color) * shade, np.full((side, side, 1), 255.0)], -1)
        image[hit] = painted[hit].astype(np.uint8)
        nearest = np.where(hit, depth, nearest)
    return image


def write_tiny_scene(folder: Path, parts: int = 1) -> Path:
    """Write a scene that builds in seconds: 48 photos of 32 pixels and `TINY` in its scene.yaml."""
    write_ball_scene(folder, side=32)
    lines = [f"{key}: {json.dumps(value)}\n" for key, value in (TINY | {"parts": parts}).items()]
    write_text_atomic(folder / "scene.yaml", "".join(lines))
    return folder
