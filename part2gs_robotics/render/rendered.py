"""What every rasteriser returns, whatever device drew it: images, and gradients of a loss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class Near:
    """What of an image is asked for: only what lies near some of the Gaussians.

    Attributes:
        own: [N] which Gaussians.
        reach: pixels around each; farther off an image may be empty.
    """

    own: NDArray[np.bool_]
    reach: int


class Kept(Protocol):
    """What a device keeps of a rendering, for its gradient and for what is asked later."""

    def median_depth(self) -> Floats:
        """Return the image of Rendered.median_depth."""


@dataclass(frozen=True)
class Rendered:
    """An image and what its gradient needs.

    Attributes:
        color: [H, W, 3], background included.
        alpha: [H, W] in [0, 1].
        depth: [H, W] sum of w_i z_i in scene units, not divided by alpha.
        extra: [H, W, C] blended extra channels, C = 0 without any.
        visible: [N] whether the Gaussian's ellipse touches the image, as far as it was asked for.
        saved: state for render_backward; its type tells the device.
    """

    color: Floats
    alpha: Floats
    depth: Floats
    extra: Floats
    visible: NDArray[np.bool_]
    saved: Kept

    @cached_property
    def median_depth(self) -> Floats:
        """[H, W] z at which the transmittance falls below 0.5, 0 where alpha < 0.5.

        Has no gradient. Drawn when first asked for: no fit needs it.
        """
        return self.saved.median_depth()


@dataclass(frozen=True)
class Gradients:
    """Gradients of a scalar loss with respect to the inputs of render.

    Attributes:
        means: [N, 3].
        quats: [N, 4], orthogonal to quats (they are normalised inside).
        scales: [N, 3].
        opacities: [N].
        colors: [N, 3].
        extra: [N, C].
        means2d_abs: [N] norm of the gradient with respect to the projected centre, per pixel.
            Times max(W, H) / 2 it compares with 3DGS's densification threshold 0.0002.
        visible: [N] whether the Gaussian's ellipse touches the image.
    """

    means: Floats
    quats: Floats
    scales: Floats
    opacities: Floats
    colors: Floats
    extra: Floats
    means2d_abs: Floats
    visible: NDArray[np.bool_]
