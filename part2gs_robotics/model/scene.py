"""The Scene: what the readers hand to every later room."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Camera:
    """A pinhole camera in the world frame.

    Attributes:
        viewmat: [4, 4] camera_from_world, OpenCV axes.
        K: [3, 3] pixels, no skew, pixel centres at +0.5.
        width: pixels.
        height: pixels.
    """

    viewmat: NDArray[np.float64]
    K: NDArray[np.float64]
    width: int
    height: int


@dataclass(frozen=True)
class StateViews:
    """All posed images of one observed state, in one resolution.

    Attributes:
        images: [V, H, W, 3] uint8, straight (not premultiplied) RGB.
        alphas: [V, H, W] uint8, 255 = object.
        Ks: [V, 3, 3] float64, pixels, pixel centres at (i + 0.5, j + 0.5).
        viewmats: [V, 4, 4] float64, camera_from_world, OpenCV axes.
        depths: [V, H, W] float32 z-depth in scene units, 0 = invalid; None without depth images.
        names: image names, for messages.
        held_out: [V] bool, True = never trained on.
        depth_counts: ([V, H, W] uint16, [V] scene units per count) of `depths` as stored, where
            they came from files: another unit can be taken without rounding twice.
    """

    images: NDArray[np.uint8]
    alphas: NDArray[np.uint8]
    Ks: NDArray[np.float64]
    viewmats: NDArray[np.float64]
    depths: NDArray[np.float32] | None
    names: tuple[str, ...]
    held_out: NDArray[np.bool_]
    depth_counts: tuple[NDArray[np.uint16], NDArray[np.float64]] | None = None

    @property
    def width(self) -> int:
        """Image width in pixels."""
        return int(self.images.shape[2])

    @property
    def height(self) -> int:
        """Image height in pixels."""
        return int(self.images.shape[1])

    def __len__(self) -> int:
        """Number of views."""
        return len(self.images)

    def camera(self, view: int) -> Camera:
        """Return the camera of a view."""
        return Camera(self.viewmats[view], self.Ks[view], self.width, self.height)

    def select(self, keep: NDArray[np.bool_]) -> StateViews:
        """Return the views where keep [V] is true."""
        counts = self.depth_counts
        return StateViews(
            self.images[keep], self.alphas[keep], self.Ks[keep], self.viewmats[keep],
            None if self.depths is None else self.depths[keep],
            tuple(name for name, kept in zip(self.names, keep, strict=True) if kept),
            self.held_out[keep], None if counts is None else (counts[0][keep], counts[1][keep]))


@dataclass(frozen=True)
class Scene:
    """Two observed states of one object in one world frame (as read: the scene's own).

    Attributes:
        path: the scene folder.
        layout: name of the layout that was read.
        states: views of state 0 and state 1.
        meters_per_unit: metres per scene unit, None if unknown.
        up: [3] unit up direction of the world, None if unknown.
        notes: what the reader changed or assumed, one sentence each (undistorted, downscaled, ...).
    """

    path: Path
    layout: str
    states: tuple[StateViews, StateViews]
    meters_per_unit: float | None = None
    up: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()
