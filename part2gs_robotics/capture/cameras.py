"""Cameras around an object for `capture`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOV_RAD = float(np.deg2rad(40.0))  # a phone's 2x lens: perspective without wide-angle stretch
ELEVATIONS_DEG = (-10.0, 70.0)  # of cameras: a little from below to steeply from above
GOLDEN_DEG = 137.50776405003785  # successive azimuths never line up
FRAME_FILL = 0.85  # widest view; the rest is margin for alpha edges


def direction(azimuth_deg: float, elevation_deg: float) -> Array:
    """Return the unit vector [3] of an azimuth (from +x to +y) and an elevation (to +z)."""
    a, e = np.deg2rad(azimuth_deg), np.deg2rad(elevation_deg)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def place_cameras(cloud: Array, count: int, rng: np.random.Generator) -> list[Array]:
    """Return `count` cameras around a cloud, each as near as the frame allows.

    A spiral of equal areas between two elevations, shaken by the generator. With x, y, z the
    cloud in camera axes about its middle (z towards the camera) and t the half field of view's
    tangent, everything is inside the frame from distance max(z + max(|x|, |y|) / t) on.

    Args:
        cloud: [N, 3] points that must be in every frame.
        count: number of cameras.
        rng: source of the shaking.

    Returns:
        world_from_camera [4, 4] each, OpenGL axes.
    """
    middle = (cloud.min(0) + cloud.max(0)) / 2
    low, high = np.sin(np.deg2rad(ELEVATIONS_DEG))
    reach, start = np.tan(FOV_RAD / 2) * FRAME_FILL, rng.uniform(0, 360)
    rotations, distances = [], []
    for i in range(count):
        height = low + (high - low) * (i + rng.uniform(0.2, 0.8)) / count
        azimuth = start + i * GOLDEN_DEG + rng.normal(0, 3)
        rot = _facing(direction(azimuth, np.rad2deg(np.arcsin(height))), rng.normal(0, 0.03))
        local = (cloud - middle) @ rot
        rotations.append(rot)
        distances.append(float((local[:, 2] + np.abs(local[:, :2]).max(1) / reach).max()))
    # Never nearer than 0.6 of the farthest: resolution stays even over the object.
    floor = 0.6 * max(distances)
    return [
        _rigid(rot, middle + rot[:, 2] * max(d, floor) * rng.uniform(1.0, 1.06))
        for rot, d in zip(rotations, distances, strict=True)
    ]


def _facing(back: Array, roll: float) -> Array:
    """Return the camera rotation [3, 3] whose z axis is `back`, turned by `roll` rad about it."""
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    c, s = np.cos(roll), np.sin(roll)
    return np.stack([c * right + s * up, c * up - s * right, back], 1)


def _rigid(rot: Array, eye: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rot, eye
    return out
