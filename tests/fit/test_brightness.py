"""Brightness: what a camera did to single photos is found and undone; alike photos stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toys import scene_of

from part2gs_robotics.fit.brightness import FEWEST, alike, evened, gains_of
from part2gs_robotics.fit.training_photos import Views
from part2gs_robotics.model.gaussians import linear_of_srgb, srgb_of_linear

SIDE, COUNT = 144, 12


@pytest.fixture(scope="module")
def box(toy):
    """Gaussians of a grey box and photos of it."""
    gaussians = toy.gaussians_of([toy.Box((0, 0, 0), (0.8, 0.6, 0.4), 1)], 0.05)[0]
    Ks, views = toy.cameras(COUNT, SIDE, np.array([0.4, 0.3, 0.2]), 1.1)
    return gaussians, toy.drawn(gaussians, Ks, views, SIDE)


def test_light_and_grey_levels_are_inverse():
    grey = np.linspace(0, 1, 256)
    np.testing.assert_allclose(srgb_of_linear(linear_of_srgb(grey)), grey, atol=1e-4)
    assert linear_of_srgb(np.array([0.5])) == pytest.approx(0.214041, abs=1e-6)  # IEC 61966-2-1


def test_exposure_and_white_balance_are_found_and_undone(box):
    gaussians, state = box
    stops = np.random.default_rng(0).choice([-1 / 3, 0.0, 1 / 3], (COUNT, 1))
    warm = np.where(np.arange(COUNT)[:, None] % 3 == 1, [1.1, 1.0, 0.9], 1.0)
    given = 2.0**stops * warm
    taken = evened(state, 1 / given)
    found = gains_of(gaussians, taken, Views(taken))
    assert found is not None
    relative = given / np.exp(np.median(np.log(given), 0))
    np.testing.assert_allclose(found, relative, rtol=0.03)  # at half size
    undone = evened(taken, found * np.exp(np.median(np.log(given), 0)))
    solid = state.alphas == 255
    off = undone.images[solid].astype(int) - state.images[solid].astype(int)
    assert np.percentile(np.abs(off), 99) <= 3


def test_photos_that_are_alike_stay(box):
    gaussians, state = box
    assert gains_of(gaussians, state, Views(state)) is None
    assert evened(state, None) is state
    scene = scene_of((state, state))
    assert alike(scene, (None, None)) is scene


def test_too_few_pixels_tell_nothing(box):
    gaussians, state = box
    alphas = np.zeros_like(state.alphas)
    edge = int(np.sqrt(FEWEST)) // 2
    alphas[:, :2 * edge, :2 * edge] = state.alphas[:, :2 * edge, :2 * edge]
    dark = evened(replace(state, alphas=alphas), np.linspace(0.5, 2, COUNT)[:, None] * np.ones(3))
    assert gains_of(gaussians, dark, Views(dark)) is None


def test_a_scene_says_what_was_done_to_its_photos(box):
    _, state = box
    gains = np.linspace(0.8, 1.25, COUNT)[:, None] * np.ones(3)
    new = alike(scene_of((state, state)), (None, gains))
    assert new.states[0].images is state.images
    assert new.states[1].images.mean() != state.images.mean()
    assert "state 1: 0.80 to 1.25" in new.notes[-1]
    assert "state 0" not in new.notes[-1]
