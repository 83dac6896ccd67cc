"""Tones: rising curves that spread what the object shows, and the way back."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.fit.tones import STEEPEST, tones_of
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.scene import StateViews


def state_of(gray: np.ndarray, alpha: int = 255) -> StateViews:
    images = np.repeat(gray.astype(np.uint8)[None, ..., None], 3, -1)
    alphas = np.full(images.shape[:3], alpha, np.uint8)
    return StateViews(images, alphas, np.eye(3)[None], np.eye(4)[None], None, ("a.png",),
                      np.zeros(1, bool))


def colored(count: int = 200) -> Gaussians:
    rng = np.random.default_rng(0)
    f32 = np.float32
    return Gaussians(rng.normal(size=(count, 3)).astype(f32),
                     np.tile(f32([1, 0, 0, 0]), (count, 1)),
                     np.zeros((count, 3), f32), np.zeros(count, f32),
                     ((rng.uniform(0.02, 0.98, (count, 3)) - 0.5) / SH_C0).astype(f32),
                     np.zeros((count, 0, 3), f32))


def dark_grain() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.clip(25 + 5 * rng.standard_normal((64, 64)), 0, 255)


def test_the_grain_of_dark_wood_gains_contrast() -> None:
    state = state_of(dark_grain())
    tones = tones_of(state)
    assert tones.even(state).images.std() > 2.5 * state.images.std()
    assert np.diff(tones.curve).min() > 0
    assert tones.curve[0] == 0
    assert tones.curve[-1] == 1


@pytest.mark.parametrize("gray", [np.full((8, 8), 90), np.arange(256).reshape(16, 16)])
def test_no_tone_is_stretched_beyond_the_limit(gray: np.ndarray) -> None:
    # What the limit cuts off is at most 1 on average, and goes to all tones alike.
    steps = 255 * np.diff(tones_of(state_of(gray)).curve)
    assert steps.max() < STEEPEST + 1
    assert steps.min() > 0.1


def test_colors_come_back() -> None:
    tones, start = tones_of(state_of(dark_grain())), colored()
    there = tones.forward(start)
    assert np.abs(there.colors - start.colors).max() > 0.1
    np.testing.assert_allclose(tones.back(there).colors, start.colors, atol=2e-6)
    np.testing.assert_array_equal(there.means, start.means)


def test_without_an_object_nothing_changes() -> None:
    state = state_of(dark_grain(), alpha=0)
    np.testing.assert_array_equal(tones_of(state).even(state).images, state.images)
