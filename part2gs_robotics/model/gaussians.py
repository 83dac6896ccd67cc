"""Gaussians: the only place where log-scales and logit-opacities live."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64

SH_C0 = 0.28209479177387814  # 1 / (2 sqrt(pi)): the constant spherical harmonic


def opacities_of(logits: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return [N] 1 / (1 + e^-x); logits below -80 count as -80, where e^80 still fits float32."""
    return np.asarray(1 / (1 + np.exp(-np.maximum(logits, logits.dtype.type(-80)))), logits.dtype)


def linear_of_srgb(colors: NDArray[np.floating]) -> F64:
    """Return light in 0..1 from sRGB in 0..1 (IEC 61966-2-1)."""
    c = np.asarray(colors, np.float64)
    return np.asarray(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4))


def srgb_of_linear(light: NDArray[np.floating]) -> F64:
    """Undo `linear_of_srgb`; negative light stays as it is on the straight branch."""
    c = np.asarray(light, np.float64)
    curved = 1.055 * np.maximum(c, 0.0) ** (1 / 2.4) - 0.055
    return np.asarray(np.where(c <= 0.0031308, 12.92 * c, curved))


@dataclass(frozen=True)
class Splats:
    """N Gaussians as they are drawn: activated values, in any floating dtype.

    Attributes:
        means: [N, 3] world frame, scene units.
        quats: [N, 4] wxyz of any length.
        scales: [N, 3] standard deviations, scene units.
        opacities: [N] in [0, 1].
        colors: [N, 3].
    """

    means: NDArray[np.floating]
    quats: NDArray[np.floating]
    scales: NDArray[np.floating]
    opacities: NDArray[np.floating]
    colors: NDArray[np.floating]

    def __len__(self) -> int:
        """Return the number of Gaussians."""
        return len(self.means)

    def select(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> Splats:
        """Return the Gaussians picked by a mask or by indices."""
        return Splats(self.means[index], self.quats[index], self.scales[index],
                      self.opacities[index], self.colors[index])


@dataclass(frozen=True)
class Gaussians:
    """N anisotropic 3-D Gaussians in the world frame, float32.

    Attributes:
        means: [N, 3] scene units.
        quats: [N, 4] wxyz, unit.
        log_scales: [N, 3] natural log of the standard deviations in scene units.
        logit_opacities: [N].
        sh0: [N, 3] degree-0 coefficients; colour = 0.5 + SH_C0 * sh0.
        shN: [N, M, 3] higher degrees, M in {0, 3, 8, 15}; M = 0 when views need no view dependence.
    """

    means: NDArray[np.float32]
    quats: NDArray[np.float32]
    log_scales: NDArray[np.float32]
    logit_opacities: NDArray[np.float32]
    sh0: NDArray[np.float32]
    shN: NDArray[np.float32]

    def __len__(self) -> int:
        """Number of Gaussians."""
        return len(self.means)

    @property
    def scales(self) -> NDArray[np.float32]:
        """[N, 3] standard deviations in scene units."""
        return np.exp(self.log_scales)

    @property
    def opacities(self) -> NDArray[np.float32]:
        """[N] in (0, 1)."""
        return opacities_of(self.logit_opacities)

    @property
    def colors(self) -> NDArray[np.float32]:
        """[N, 3] view-independent colour, clipped at 0."""
        return np.maximum(0.5 + SH_C0 * self.sh0, 0.0).astype(np.float32)

    @property
    def splats(self) -> Splats:
        """These Gaussians as they are drawn, in their view-independent colours."""
        return Splats(self.means, self.quats, self.scales, self.opacities, self.colors)

    def select(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> Gaussians:
        """Return the Gaussians picked by a mask or by indices."""
        return Gaussians(
            self.means[index],
            self.quats[index],
            self.log_scales[index],
            self.logit_opacities[index],
            self.sh0[index],
            self.shN[index],
        )
