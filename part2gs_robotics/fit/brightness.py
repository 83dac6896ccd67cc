"""Brightness: photos of one state as if the camera had kept one exposure and white balance.

A phone chooses both anew for every photo. What the Gaussians of all photos look like tells how much
brighter than the others each one is; the fit goes on with photos that are alike, and so do all
later rooms.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.fit.training_photos import Views
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians, linear_of_srgb, srgb_of_linear
from part2gs_robotics.model.scene import Camera, Scene, StateViews
from part2gs_robotics.render.dispatch import render
from part2gs_robotics.runtime.buffers import Workspace

logger = logging.getLogger(__name__)
WHEN = 0.25, 0.4, 0.55  # of a fit's steps: shapes are rough but right, then each look is nearer
SOLID = 0.95  # alpha from which a pixel shows the object alone
TONES = 0.08, 0.92  # darker ones are noise, brighter ones clipped
FEWEST = 100  # such pixels: texture differs by a fifth, so the median of fewer wanders by 3 %
LEAST = 0.07  # log of a gain, rms: 0.003 to 0.031 at one exposure, 0.16 at steps of a third stop


def gains_of(gaussians: Gaussians, state: StateViews, photos: Views) -> F64 | None:
    """Return [V, 3] how much more light each photo got than the middle one, per channel.

    Args:
        gaussians: fitted to the photos, in their natural tones, of one colour each.
        state: the photos' cameras.
        photos: of the state, as they were taken; looked at in half size.

    Returns:
        Gains, or None where photos are about equally bright, whatever their white balance.
    """
    work, level = Workspace(), 1
    images, alphas, Ks = photos.levels[level]
    logs = np.full((len(state), 3), np.nan)
    for v in range(len(state)):
        height, width = alphas[v].shape
        seen = render(gaussians.splats, Camera(state.viewmats[v], Ks[v], width, height),
                      workspace=work)
        both = (alphas[v] > 255 * SOLID) & (seen.alpha > SOLID)
        photo, drawn = images[v][both] / 255.0, seen.color[both] / seen.alpha[both][:, None]
        plain = _plain(photo) & _plain(drawn)
        if plain.sum() >= FEWEST:
            ratio = linear_of_srgb(photo[plain]) / linear_of_srgb(drawn[plain])
            logs[v] = np.median(np.log(ratio), axis=0)
    told = np.isfinite(logs[:, 0])
    if not told.any():
        return None
    logs = np.where(told[:, None], logs - np.median(logs[told], axis=0), 0.0)
    # single channels of a rough fit of vivid colours are off by 0.07, their mean by 0.03
    differ = float(np.sqrt(np.mean(logs.mean(1) ** 2)))
    return np.exp(logs) if differ > LEAST else None


def _plain(colors: NDArray[np.floating]) -> NDArray[np.bool_]:
    return np.asarray(((colors > TONES[0]) & (colors < TONES[1])).all(1))


def evened(state: StateViews, gains: F64 | None) -> StateViews:
    """Return the state with photos as bright as the middle one.

    Args:
        state: as it was taken.
        gains: [V, 3] of `gains_of`; None leaves everything as it is.
    """
    if gains is None:
        return state
    light, images = linear_of_srgb(np.arange(256) / 255.0), np.empty_like(state.images)
    for v, gain in enumerate(gains):
        for c in range(3):
            levels = np.rint(255 * np.clip(srgb_of_linear(light / gain[c]), 0, 1)).astype(np.uint8)
            images[v, ..., c] = levels[state.images[v, ..., c]]
    return replace(state, images=images)


def alike(scene: Scene, gains: tuple[F64 | None, F64 | None]) -> Scene:
    """Return the scene with photos of each state as bright as its middle one, and a note.

    Args:
        scene: as it was taken.
        gains: per state, of `gains_of`; without any the scene is returned as it is.
    """
    ranges = [f"state {s}: {found.min():.2f} to {found.max():.2f}"
              for s, found in enumerate(gains) if found is not None]
    if not ranges:
        return scene
    note = ("Photos of one state differ in brightness (light per channel beside the middle photo, "
            f"{'; '.join(ranges)}): they were made alike.")
    logger.info("%s", note)
    zero, one = (evened(state, found) for state, found in zip(scene.states, gains, strict=True))
    return replace(scene, states=(zero, one), notes=(*scene.notes, note))
