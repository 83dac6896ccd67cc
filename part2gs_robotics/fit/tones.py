"""Tones: photos with even contrast for the fit, and back to their own colours.

A loss in grey levels hardly sees the grain of dark wood: its hollows stay closed. The fit looks at
the photos through one rising curve that spreads the tones the object really has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.scene import StateViews

EVEN = 0.7  # share of histogram equalisation; the rest stays linear, so that no tone is lost
STEEPEST = 5.0  # times the contrast at most: sensor noise of one grey level stays near two percent
WIDTH = 3.0  # grey levels, standard deviation that smooths the histogram: no single-tone cliffs
SOLID = 230  # alpha from which a pixel shows the object alone
LEVELS = np.arange(256) / 255.0  # what 8 bits can show, as colours


@dataclass(frozen=True)
class Tones:
    """A rising curve from grey levels to even grey levels.

    Attributes:
        curve: [256] float64 in 0..1, strictly rising.
    """

    curve: NDArray[np.float64]

    def even(self, state: StateViews) -> StateViews:
        """Return the state with every image seen through the curve."""
        table = np.rint(255 * self.curve).astype(np.uint8)
        return replace(state, images=table[state.images])

    def forward(self, gaussians: Gaussians) -> Gaussians:
        """Return Gaussians of natural colour as the even images show them."""
        return _recolored(gaussians, LEVELS, self.curve)

    def back(self, gaussians: Gaussians) -> Gaussians:
        """Return Gaussians fitted to even images in their natural colours."""
        return _recolored(gaussians, self.curve, LEVELS)


def _recolored(gaussians: Gaussians, old: NDArray[np.float64],
               new: NDArray[np.float64]) -> Gaussians:
    colors = np.interp(gaussians.colors, old, new)
    return replace(gaussians, sh0=((colors - 0.5) / SH_C0).astype(np.float32))


def tones_of(state: StateViews) -> Tones:
    """Return the curve of a state's object pixels.

    Source: contrast-limited histogram equalisation (Pizer et al. 1987), one curve for all views so
    that one surface keeps one colour. Chosen by benchmarks/fit.py.
    """
    counts = np.bincount(state.images[state.alphas > SOLID].ravel(), minlength=256)
    if not counts.any():
        return Tones(LEVELS.copy())
    reach = np.arange(-9, 10)
    bell = np.exp(-0.5 * (reach / WIDTH) ** 2)
    share = np.convolve(counts / counts.sum(), bell / bell.sum(), "same")
    slope = np.minimum(EVEN * 256 * share + 1 - EVEN, STEEPEST)
    slope += 1 - slope.mean()  # what the limit cut off goes to all tones alike
    curve = np.cumsum(slope) - slope / 2
    return Tones((curve - curve[0]) / (curve[-1] - curve[0]))
