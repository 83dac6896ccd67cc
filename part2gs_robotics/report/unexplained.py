"""What the joints do not explain, drawn on photos: the other state's Gaussians, moved, differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.report.data import Picture

OFF = 0.1  # of the full range, mean of the channels: three times the error of a fit of 30 dB
OPAQUE = 0.5  # alpha from which a pixel is taken as covered
FADED = 0.35  # of a photo's contrast left below the marks, so that they are seen on any colour
DIFFERS, HIDDEN = (216, 27, 96), (30, 120, 229)  # magenta and blue: told apart by every eye


@dataclass(frozen=True)
class Unexplained:
    """A marked photo [H, W, 3] uint8, and shares of the object that differ and were hidden."""

    image: NDArray[np.uint8]
    differs: float
    hidden: float


def marked(photo: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return a photo [H, W, 3] faded but for what a mask [H, W] says, which is magenta."""
    image = 1.0 - FADED + FADED * photo[..., :3] / 255.0
    image[mask] = np.array(DIFFERS) / 255.0
    return np.rint(image * 255).astype(np.uint8)


def unexplained(picture: Picture) -> Unexplained | None:
    """Return what of a photo the other state's moved Gaussians do not show; None without them.

    The other state may be brighter as a whole, which no joint explains: channels are compared after
    their medians are made equal. Marks of one pixel are outlines' blur and are left out.
    """
    import cv2

    if picture.moved is None or picture.mask is None:
        return None
    photo, shown = (image[..., :3] / 255.0 for image in (picture.photo, picture.moved))
    covered = picture.moved[..., 3] > OPAQUE * 255
    both = covered & picture.mask
    gain = np.ones(3)
    if both.any():
        gain = np.median(photo[both], 0) / np.maximum(np.median(shown[both], 0), 1 / 255)
    off = np.abs(shown * gain - photo).mean(-1) > OFF
    square = np.ones((3, 3), np.uint8)
    marks = [cv2.morphologyEx(mark.astype(np.uint8), cv2.MORPH_OPEN, square) > 0
             for mark in ((both & off) | (covered & ~picture.mask), picture.mask & ~covered)]
    image = 1.0 - FADED + FADED * photo
    for mark, colour in zip(marks, (DIFFERS, HIDDEN), strict=True):
        image[mark] = np.array(colour) / 255.0
    whole = max(int(picture.mask.sum()), 1)
    return Unexplained(np.rint(image * 255).astype(np.uint8),
                       float(marks[0].sum() / whole), float(marks[1].sum() / whole))
