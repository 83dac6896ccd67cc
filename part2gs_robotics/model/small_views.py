"""Small views: a few spread-out photos of one state at low resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.points import farthest
from part2gs_robotics.model.scene import Camera, StateViews

NEIGHBORS = 12  # views compared: up to about 45 degrees away in a set of 64
NEAREST = 3.0  # degrees: closer views have no parallax


@dataclass(frozen=True)
class Photo:
    """One view of one state: color [H, W, 3] premultiplied, 0..1; alpha [H, W] 0..1; its camera."""

    color: NDArray[np.float32]
    alpha: NDArray[np.float32]
    camera: Camera


@dataclass(frozen=True)
class SmallViews:
    """A few views of one state at low resolution.

    Attributes:
        colors: [V, H, W, 3] premultiplied, 0..1.  alphas: [V, H, W] 0..1.
        Ks: [V, 3, 3] of the small images.  viewmats: [V, 4, 4] camera_from_world.
        floor: [V, H, W] cost of every pixel that no motion can be blamed for; None = zero.
    """

    colors: NDArray[np.float32]
    alphas: NDArray[np.float32]
    Ks: F64
    viewmats: F64
    floor: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        """Return the number of views."""
        return len(self.colors)

    def camera(self, view: int) -> Camera:
        """Return the camera of a view."""
        height, width = self.alphas[view].shape
        return Camera(self.viewmats[view], self.Ks[view], width, height)

    def photo(self, view: int) -> Photo:
        """Return one view alone."""
        return Photo(self.colors[view], self.alphas[view], self.camera(view))

    def select(self, index: list[int]) -> SmallViews:
        """Return the views of these indices."""
        floor = None if self.floor is None else self.floor[index]
        return SmallViews(self.colors[index], self.alphas[index], self.Ks[index],
                          self.viewmats[index], floor)

    def every(self, step: int) -> SmallViews:
        """Return one view of every `step`."""
        return self.select(list(range(0, len(self.colors), step)))


def spread(viewmats: F64, count: int) -> list[int]:
    """Return indices of up to `count` cameras [V, 4, 4] far from each other, in order."""
    centres = np.stack([-m[:3, :3].T @ m[:3, 3] for m in viewmats])
    return sorted(farthest(centres, count, 0).tolist())


def neighbors(viewmats: F64, middle: F64) -> list[NDArray[np.int64]]:
    """Return for each camera [V, 4, 4] the NEIGHBORS nearest by the angle at the object's middle.

    Cameras nearer than NEAREST are none: they have no parallax.
    """
    eyes = -np.einsum("vji,vj->vi", viewmats[:, :3, :3], viewmats[:, :3, 3])
    gaze = (middle - eyes) / np.linalg.norm(middle - eyes, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.clip(gaze @ gaze.T, -1, 1)))
    order = np.argsort(angles, axis=1, kind="stable")
    return [row[own[row] > NEAREST][:NEIGHBORS] for own, row in zip(angles, order, strict=True)]


def chosen(state: StateViews, count: int) -> NDArray[np.int64]:
    """Return indices of up to `count` training views spread over the sphere."""
    train = np.flatnonzero(~state.held_out)
    return np.asarray(train[spread(state.viewmats[train], count)], np.int64)


def small_views(state: StateViews, count: int, side: int) -> SmallViews:
    """Return `count` training views spread over the sphere, longest side `side` pixels."""
    index = chosen(state, count)
    scale = min(1.0, side / max(state.width, state.height))
    size = (max(1, round(state.width * scale)), max(1, round(state.height * scale)))
    colors, alphas = [], []
    for v in index:
        alpha = state.alphas[v].astype(np.float32) / 255
        color = state.images[v].astype(np.float32) / 255 * alpha[..., None]
        colors.append(cv2.resize(color, size, interpolation=cv2.INTER_AREA))
        alphas.append(cv2.resize(alpha, size, interpolation=cv2.INTER_AREA))
    Ks = state.Ks[index].copy()
    Ks[:, 0] *= size[0] / state.width
    Ks[:, 1] *= size[1] / state.height
    return SmallViews(np.stack(colors), np.stack(alphas), Ks, state.viewmats[index])


def both_small(states: tuple[StateViews, StateViews], count: int, side: int,
               ) -> tuple[SmallViews, SmallViews]:
    """Return `small_views` of both states."""
    return small_views(states[0], count, side), small_views(states[1], count, side)
