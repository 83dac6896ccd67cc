"""A tray without texture: five boxes, every face of one even colour."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from toys import Box, cameras, cast

from part2gs_robotics.fit.hull import carve
from part2gs_robotics.fit.stereo import mapped, stereo_depths
from part2gs_robotics.plain.planes import Bounds

SIZE, WALL, HEIGHT = 0.8, 0.06, 0.4
CENTRE = np.array([SIZE / 2, SIZE / 2, HEIGHT / 2])
DIAGONAL = float(np.linalg.norm([SIZE, SIZE, HEIGHT]))
SIDE, VIEWS = 200, 48
CLEAN, NOISY = 0.0, 4.0  # of 255
S, W, H = SIZE, WALL, HEIGHT
BOXES = [Box(lo, hi) for lo, hi in (
    ((0, 0, 0), (S, S, W)), ((0, 0, 0), (W, S, H)), ((S - W, 0, 0), (S, S, H)),
    ((0, 0, 0), (S, W, H)), ((0, S - W, 0), (S, S, H)))]  # fmt: skip
BRIM = 0.95  # of the walls' upper ends: with the floor's own, photos show both as one
TONES = np.array([0.45, 0.6, 0.8])  # of faces that look along x, y and z, as light falls


def even(points, seed):
    """Return [n, 3] the tone of the face that every point lies on."""
    gaps = np.min([np.abs(points[:, None] - np.array([box.lo, box.hi])).min(1) for box in BOXES], 0)
    tones = np.where(points[:, 2] > HEIGHT - 1e-6, BRIM, TONES[gaps.argmin(1)])
    return np.repeat(tones[:, None], 3, 1)


@cache
def tray(noise: float = CLEAN):
    """Return photos of the tray with exact depth; noise: of 255, of every pixel."""
    state = cast(BOXES, *cameras(VIEWS, SIDE, CENTRE, DIAGONAL), SIDE, even)
    if noise:
        rough = np.random.default_rng(0).normal(scale=noise, size=state.images.shape)
        state = replace(state, images=np.clip(state.images + rough, 0, 255).astype(np.uint8))
    return state


@cache
def seen(noise: float):
    """Return photos, bounds, stereo's maps and larger views of the tray."""
    state = replace(tray(noise), depths=None)
    hull = carve(state, resolution=96)
    bounds = Bounds(hull.values, hull.lo, hull.voxel, hull.diagonal)
    return state, bounds, stereo_depths(state, hull)[0], mapped(state, 64, 150)
