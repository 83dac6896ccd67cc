"""Small photos of one state, and cells of space with the pixel that shows each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.posed import project

Bools = NDArray[np.bool_]
U8 = NDArray[np.uint8]


@dataclass(frozen=True)
class Views:
    """Photos of one state at one size.

    Attributes:
        rgb: [V, H, W, 3] uint8.
        K: [3, 3] pixels of these photos.
        viewmats: [V, 4, 4] camera_from_world.
    """

    rgb: U8
    K: F64
    viewmats: F64

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.rgb)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        return self.rgb.shape[1], self.rgb.shape[2]


def small_views(photos: Sequence[U8], K: F64, viewmats: F64, side: int) -> Views:
    """Return photos [H, W, 3] shrunk to a longest side, with their cameras."""
    height, width = photos[0].shape[:2]
    scale = min(1.0, side / max(height, width))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = [cv2.resize(photo, size, interpolation=cv2.INTER_AREA) for photo in photos]
    return Views(np.stack(small), np.diag([size[0] / width, size[1] / height, 1.0]) @ K, viewmats)


@dataclass(frozen=True)
class Grid:
    """Cells of a box and where each view of a state shows them.

    Attributes:
        points: [N, 3] their middles.
        shape: cells along x, y and z.
        pixels: [V, N] flat index of the pixel that shows a cell, -1 outside the frame.
        size: height and width of the views.
        spread: pixels between neighbouring cells, in the nearest view.
    """

    points: F64
    shape: tuple[int, int, int]
    pixels: NDArray[np.int32]
    size: tuple[int, int]
    spread: float

    @classmethod
    def of(cls, lo: F64, hi: F64, cells: int, views: Views) -> Grid:
        """Return the grid of a box with `cells` cells along its longest side."""
        edge = float((hi - lo).max()) / cells
        shape = tuple(int(n) for n in np.maximum(1, np.ceil((hi - lo) / edge - 1e-9)))
        axes = [lo[k] + edge * (np.arange(shape[k]) + 0.5) for k in range(3)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
        height, width = views.size
        pixels, nearest = np.full((len(views), len(points)), -1, np.int32), np.inf
        for v, view in enumerate(views.viewmats):
            place, depth = project(points, view, views.K)
            x, y = np.floor(np.clip(place, -1, 1 << 20)).astype(np.int32).T
            inside = (depth > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
            pixels[v] = np.where(inside, y * width + x, -1)
            nearest = min(nearest, float(np.median(depth)))
        spread = float(views.K[0, 0]) * edge / max(nearest, 1e-9)
        return cls(points, (shape[0], shape[1], shape[2]), pixels, views.size, spread)

    def outlines(self, filled: Bools) -> U8:
        """Return [V, H, W] uint8, 1 where a view shows one of the filled cells."""
        reach = 2 * int(np.ceil(self.spread)) + 1  # closes what lies between neighbouring cells
        close = np.ones((reach, reach), np.uint8)
        out = np.zeros((len(self.pixels), *self.size), np.uint8)
        for picture, pixels in zip(out, self.pixels[:, filled], strict=True):
            picture.reshape(-1)[pixels[pixels >= 0]] = 1
            picture[:] = cv2.morphologyEx(picture, cv2.MORPH_CLOSE, close)
        return out

    def votes(self, against: Sequence[NDArray[np.floating] | U8]) -> F64:
        """Return [N] the mean of pictures [H, W] where they show a cell; 1 if none does."""
        total, seen = np.zeros(len(self.points)), np.zeros(len(self.points))
        for picture, pixels in zip(against, self.pixels, strict=True):
            shown = pixels >= 0
            total[shown] += picture.reshape(-1)[pixels[shown]]
            seen += shown
        return np.where(seen > 0, total / np.maximum(seen, 1), 1.0)

    def share_seen(self) -> F64:
        """Return [N] the share of the views that show a cell."""
        return np.asarray((self.pixels >= 0).mean(0))
