"""Structural similarity of two images, read off the loss that a fit lowers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.fit.image_loss import photometric


def ssim(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Return the mean structural similarity of two [H, W, C] images in [0, 1]."""
    loss, _ = photometric(image, target, 1.0)
    return 1.0 - loss
