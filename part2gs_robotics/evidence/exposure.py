"""Exposure: one brightness for both states, so that their colours can be compared.

Cameras that choose exposure or white balance anew between the states make every surface look like
another one. What stands still in both shows by how much.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.render.dispatch import render
from part2gs_robotics.runtime.buffers import Workspace

Pair = tuple[Gaussians, Gaussians]
VIEWS, SIDE = 8, 128  # of state 1: some 20,000 pixels of what both show
SOLID = 0.95  # alpha from which a pixel shows the object alone
SAME_DEPTH = 0.005  # of the depth: both states show one surface, which has not moved
TONES = (0.08, 0.92)  # darker ones are noise, brighter ones clipped
FEWEST = 300  # such pixels: fewer are a coincidence
LEAST = 0.03  # log of a gain: less than a turned surface changes by its shading


def gain_between(scene: Scene, gaussians: Pair) -> F64:
    """Return [3] how much brighter state 1 is than state 0, per channel; 1 = alike or not known.

    Args:
        scene: images of both states.
        gaussians: of both states.
    """
    views, work = small_views(scene.states[1], VIEWS, SIDE), Workspace()
    found = []
    for v in range(len(views)):
        pair = []
        for g in gaussians:
            out = render(g.splats, views.camera(v), workspace=work)
            pair.append((out.color.copy(), out.alpha.copy(), out.depth.copy()))
        found.append(_ratios(*pair))
    ratios = np.concatenate(found)
    if len(ratios) < FEWEST:
        return np.ones(3)
    logs = np.median(ratios, 0)
    return np.exp(logs) if np.abs(logs).max() > LEAST else np.ones(3)


def _ratios(zero: tuple[NDArray[np.floating], ...], one: tuple[NDArray[np.floating], ...]) -> F64:
    """Return [n, 3] logs of what state 1 is brighter in the pixels that show one still surface."""
    (color0, alpha0, depth0), (color1, alpha1, depth1) = zero, one
    both = (alpha0 > SOLID) & (alpha1 > SOLID)
    a, b = color0[both] / alpha0[both][:, None], color1[both] / alpha1[both][:, None]
    z0, z1 = depth0[both] / alpha0[both], depth1[both] / alpha1[both]
    low, high = TONES
    plain = ((a > low) & (a < high) & (b > low) & (b < high)).all(1)
    same = plain & (np.abs(z0 - z1) < SAME_DEPTH * z0)
    return np.log(b[same].astype(np.float64) / a[same])


def matched(scene: Scene, gaussians: Pair, gain: F64) -> tuple[Scene, Pair]:
    """Return scene and Gaussians with the darker state as bright as the other, per channel.

    The darker one, because bright tones are clipped and would stay so.

    Args:
        scene: images of both states.
        gaussians: of both states.
        gain: [3] of `gain_between`; 1 leaves everything as it is.
    """
    if (gain == 1).all():
        return scene, gaussians
    gains = np.maximum(gain, 1.0), np.maximum(1.0 / gain, 1.0)
    zero, one = (_brighter(s, g) for s, g in zip(scene.states, gains, strict=True))
    new = [_recolored(g, by) for g, by in zip(gaussians, gains, strict=True)]
    return replace(scene, states=(zero, one)), (new[0], new[1])


def _brighter(state: StateViews, gain: F64) -> StateViews:
    levels = np.clip(np.rint(np.arange(256)[:, None] * gain), 0, 255).astype(np.uint8)
    images = np.stack([levels[:, c][state.images[..., c]] for c in range(3)], -1)
    return replace(state, images=images)


def _recolored(gaussians: Gaussians, gain: F64) -> Gaussians:
    colors = np.clip(gaussians.colors.astype(np.float64) * gain, 0.0, 1.0)
    return replace(gaussians, sh0=((colors - 0.5) / SH_C0).astype(np.float32),
                   shN=(gaussians.shN * gain).astype(np.float32))


def told(gain: F64) -> str:
    """Return a note on the exposure, empty if both states are alike."""
    if (gain == 1).all():
        return ""
    numbers = ", ".join(f"{g:.3f}" for g in gain)
    return (f"State 1 is {numbers} times as bright as state 0 (red, green, blue of what stands "
            "still): the darker one was brightened for the search of motions and for the meshes.")
