"""Textured: where photos tell depth, and where fitted surfaces are only carried over from there."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import Mask
from part2gs_robotics.model.scene import StateViews

WINDOW = 7  # pixels a side: about what stereo compares
NOISE = 3.0  # of 255: deviation about a pixel that sensors, JPEG and soft shading leave


def textured(state: StateViews) -> Mask:
    """Return [V, H, W] pixels about which a photo is not of one colour.

    With depth images every pixel counts: nothing is carried over.
    """
    import cv2

    if state.depths is not None:
        return np.ones(state.alphas.shape, bool)
    out = np.zeros(state.alphas.shape, bool)
    for view, image in enumerate(state.images):
        grey = image.astype(np.float32).mean(2)
        mean, square = (cv2.blur(x, (WINDOW, WINDOW)) for x in (grey, grey * grey))
        out[view] = square - mean * mean > NOISE**2
    return out
