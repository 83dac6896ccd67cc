"""Photos of one state as the fit asks for them: at full and half size, over any background."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel


class Views:
    """Images of one state at full and half resolution, as float32 on demand."""

    def __init__(self, state: StateViews) -> None:
        self.state = state
        self.levels = [(state.images, state.alphas, state.Ks)]
        small = (max(1, state.width // 2), max(1, state.height // 2))
        # Average premultiplied colours: straight ones would mix in the undefined background.
        alphas = np.stack([cv2.resize(a, small, interpolation=cv2.INTER_AREA)
                           for a in state.alphas])
        images = np.stack([_shrink(im, a, small)
                           for im, a in zip(state.images, state.alphas, strict=True)])
        ratio = np.array([small[0] / state.width, small[1] / state.height, 1.0])
        self.levels.append((images, alphas, state.Ks * ratio[:, None]))

    def target(self, view: int, level: int, background: F32, workspace: Workspace | None = None,
               ) -> tuple[F32, F32, NDArray[np.float64]]:
        """Return (image over the background [H, W, 3], alpha [H, W], K) of a view."""
        images, alphas, intrinsics = self.levels[level]
        work, size = workspace or Workspace(), alphas[view].shape
        image, alpha = (work.take(name, shape, np.float32)
                        for name, shape in (("target", (*size, 3)), ("target_alpha", size)))
        _compose(images[view], alphas[view], background, image, alpha)
        return image, alpha, intrinsics[view]

    def photo(self, view: int, level: int) -> NDArray[np.uint8]:
        """Return the straight colours [H, W, 3] of a view, without a background."""
        return self.levels[level][0][view]


def _shrink(image: NDArray[np.uint8], alpha: NDArray[np.uint8], size: tuple[int, int],
            ) -> NDArray[np.uint8]:
    weight = alpha.astype(np.float32)
    part = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    color = cv2.resize(image * weight[..., None], size, interpolation=cv2.INTER_AREA)
    return np.clip(color / np.maximum(part, 1e-6)[..., None] + 0.5, 0, 255).astype(np.uint8)


@kernel
def _compose(photo: NDArray[np.uint8], mask: NDArray[np.uint8], background: F32, image: F32,
             alpha: F32) -> None:
    """Fill image with the photo over a background, and alpha with its mask in [0, 1]."""
    grey = np.float32(1 / 255)
    for_each(len(mask), _compose_at, (photo, mask, background, image, alpha, grey))


@inlined
def _compose_at(y: int, photo: NDArray[np.uint8], mask: NDArray[np.uint8], background: F32,
                image: F32, alpha: F32, grey: float) -> None:
    for x in range(mask.shape[1]):
        a = np.float32(mask[y, x]) * grey
        alpha[y, x] = a
        for c in range(3):
            image[y, x, c] = (np.float32(photo[y, x, c]) * grey * a
                              + background[c] * (np.float32(1) - a))
