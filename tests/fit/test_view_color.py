"""View-dependent colour is kept where unseen views gain by it, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.fit.training_photos import Views
from part2gs_robotics.fit.view_color import GAIN, drawn_over, held_out_psnr, with_view_dependence

SIDE, COUNT = 48, 20


@pytest.fixture(scope="module")
def box(toy):
    """Gaussians of a box and an empty state of the cameras around it."""
    gaussians = toy.gaussians_of([toy.Box((0, 0, 0), (0.8, 0.6, 0.4), 1)], 0.05)[0]
    Ks, views = toy.cameras(COUNT, SIDE, np.array([0.4, 0.3, 0.2]), 1.1)
    state = toy.drawn(gaussians, Ks, views, SIDE)
    return gaussians, replace(state, held_out=np.arange(COUNT) % 4 == 3)


def photographed(gaussians, state):
    """Return the state with photos of Gaussians, colours as seen from every camera."""
    images = []
    for view in range(COUNT):
        seen = drawn_over(gaussians, state, view, np.zeros(3, np.float32))
        straight = seen.color / np.maximum(seen.alpha, 1e-3)[..., None]
        images.append(np.rint(255 * np.clip(straight, 0, 1)).astype(np.uint8))
    return replace(state, images=np.stack(images))


def test_matt_surfaces_keep_one_colour(box):
    gaussians, state = box
    found = with_view_dependence(gaussians, state, Views(state), 0.5, 0)
    assert found is gaussians


def test_gloss_is_found_and_moves_no_surface(box):
    gaussians, state = box
    rng = np.random.default_rng(0)
    shN = np.repeat(rng.normal(0, 0.2, (1, 3, 3)), len(gaussians), 0).astype(np.float32)
    glossy = photographed(replace(gaussians, shN=shN), state)
    views = Views(glossy)
    found = with_view_dependence(gaussians, glossy, views, 0.5, 0)
    assert found.shN.shape == (len(gaussians), 3, 3)
    gain = held_out_psnr(found, glossy, views) - held_out_psnr(gaussians, glossy, views)
    assert gain > 4 * GAIN
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh0"):
        assert getattr(found, name) is getattr(gaussians, name)


def test_without_held_out_views_nothing_is_decided(box):
    gaussians, state = box
    alone = replace(state, held_out=np.zeros(COUNT, bool))
    assert with_view_dependence(gaussians, alone, Views(alone), 0.5, 0) is gaussians
