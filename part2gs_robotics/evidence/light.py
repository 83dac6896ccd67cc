"""Shading: how bright a face is by the way it looks, so that paint can be compared across turns.

Light stays where it is when a part turns: a lid is brighter open than closed, and half a turn that
puts a bright side where one was looks truer than the small turn that happened. Neighbours of one
hue that face different ways show by how much, in each state alone, before any motion is known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.gaussians import Gaussians

PAIRS = 20_000  # of surfels per state, before those of two hues or one direction go
REACH = 0.1  # of the diagonal, between the two: near enough to be one paint, round a corner
SAME_HUE = 0.04  # of the brightness, per channel: two paints differ by more, shades of one by less
TURNED = np.deg2rad(25.0)  # between two normals: less says little and is a normal's noise
TONES = (0.06, 0.97)  # darker ones are noise, brighter ones clipped
FEWEST = 500  # pairs: fewer are one edge
ROUNDS = 20  # of reweighting; the last changes the third digit
KINK = 0.03  # log: smaller residuals are noise, larger ones two paints of one hue
RIDGE = 1e-4  # per pair: directions that no normal shows stay as bright as the rest
CAP = 0.3  # log: a pair that differs by more has two paints, and says nothing of the light
EXPLAINS = 0.1  # of what pairs differ by: less is chance, and the light as good as even
MOST = 3.0  # a face hardly gets brighter by a larger factor


@dataclass(frozen=True)
class Light:
    """Brightness of a face by its normal, and the normals of both states' Gaussians.

    Attributes:
        shades: [8] of the log brightness: x, y, z, xy, yz, zx, x^2 - y^2, 3 z^2 - 1. Light that
            is far away makes no finer pattern on matt faces (Ramamoorthi and Hanrahan 2001).
        normals: per state, [N_s, 3] of every Gaussian.
    """

    shades: F64
    normals: tuple[F64, F64]

    @property
    def even(self) -> bool:
        """Whether all faces are equally bright."""
        return not self.shades.any()

    def told(self) -> str:
        """Return what was found of the light, for the log."""
        if self.even:
            return "light: even, as far as faces and what turned tell"
        logs = np.concatenate(self._home)
        low, high = np.quantile(logs, (0.05, 0.95))
        return f"light: bright faces {np.exp(high - low):.2f} times as bright as dark ones"

    @cached_property
    def _home(self) -> tuple[F64, F64]:
        one, two = (_log_brightness(self.shades, n) for n in self.normals)
        return one, two

    def turned(self, state: int, labels: NDArray[np.int64], moves: list[F64]) -> F64:
        """Return [N, 3] normals of a state's Gaussians after every one turned with its part."""
        rotations = np.stack(moves)[:, :3, :3]
        return np.einsum("nij,nj->ni", rotations[labels], self.normals[state])

    def colors(
        self, state: int, gaussians: Gaussians, labels: NDArray[np.int64], moves: list[F64]
    ) -> F32:
        """Return [N, 3] colours of a state's Gaussians after every one turned with its part.

        Args:
            state: theirs, 0 or 1.
            gaussians: of the state.
            labels: [N] part of each.
            moves: [4, 4] per label; moves[0] is the identity.
        """
        colors = gaussians.colors
        if self.even:
            return colors
        for k, move in enumerate(moves):
            own = np.flatnonzero(labels == k)
            if k and len(own) and not np.allclose(move[:3, :3], np.eye(3), atol=1e-6):
                there = _log_brightness(self.shades, self.normals[state][own] @ move[:3, :3].T)
                gain = np.exp(there - self._home[state][own]).clip(1.0 / MOST, MOST)
                colors[own] *= gain[:, None].astype(np.float32)
        return colors


def light_of(states: tuple[Surfels, Surfels]) -> F64:
    """Return [8] shades of two states in one light, see `Light`; zeros where faces tell nothing.

    Args:
        states: surfels of both states.
    """
    rng = np.random.default_rng(0)
    pairs = [_pairs(s, rng) for s in states]
    slopes, ratios = (np.concatenate([p[i] for p in pairs]) for i in (0, 1))
    shades = np.zeros(slopes.shape[1])
    if len(ratios) < FEWEST:
        return shades
    ridge = RIDGE * len(ratios) * np.eye(len(shades))
    for _ in range(ROUNDS):
        weights = KINK / np.maximum(np.abs(ratios - slopes @ shades), KINK)
        weighed = slopes * weights[:, None]
        shades = np.linalg.solve(weighed.T @ slopes + ridge, weighed.T @ ratios)
    left = [np.minimum(np.abs(r), CAP).mean() for r in (ratios - slopes @ shades, ratios)]
    return shades if left[0] < (1 - EXPLAINS) * left[1] else np.zeros(len(shades))


def unshaded(surfels: Surfels, shades: F64, lacking: F64 | None = None) -> Surfels:
    """Return the surfels with the colours they would have in even light.

    Args:
        surfels: of one state.
        shades: [8] of the light.
        lacking: [8] of the light that the colours lack already; None = as photographed.
    """
    factor = brightness(shades, surfels.normals)
    if lacking is not None:
        factor /= brightness(lacking, surfels.normals)
    return replace(surfels, colors=surfels.colors / factor[:, None])


def brightness(shades: F64, normals: F64) -> F64:
    """Return [N] how bright faces are by the way they look, 1 in even light.

    Args:
        shades: [8] of the light.
        normals: [N, 3].
    """
    return np.asarray(np.exp(_log_brightness(shades, normals)).clip(1.0 / MOST, MOST))


def _pairs(surfels: Surfels, rng: np.random.Generator) -> tuple[F64, F64]:
    """Return [P, 8] differences of directions and [P] log ratios of brightness of neighbours."""
    low, high = TONES
    s = surfels.select((surfels.colors.mean(1) > low) & (surfels.colors.max(1) < high))
    if not len(s):
        return np.zeros((0, 8)), np.zeros(0)
    diag = float(np.linalg.norm(np.ptp(s.points, axis=0)))
    one = rng.integers(0, len(s), PAIRS)
    _, two = cKDTree(s.points).query(s.points[one] + rng.normal(0, REACH * diag, (PAIRS, 3)))
    bright = s.colors.mean(1)
    hue = s.colors / bright[:, None]
    alike = np.abs(hue[one] - hue[two]).mean(1) < SAME_HUE
    alike &= (s.normals[one] * s.normals[two]).sum(1) < np.cos(TURNED)
    one, two = one[alike], two[alike]
    return (_directions(s.normals[one]) - _directions(s.normals[two]),
            np.log(bright[one] / bright[two]))


def _directions(normals: F64) -> F64:
    x, y, z = normals.T
    return np.stack([x, y, z, x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1], 1)


def _log_brightness(shades: F64, normals: F64) -> F64:
    return np.asarray(_directions(normals) @ shades)
