"""Exposure: a state taken brighter is told by what stands still, whatever has moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.exposure import gain_between, matched, told
from part2gs_robotics.model.gaussians import SH_C0
from part2gs_robotics.model.se3 import make

SIDE = 96


@pytest.fixture(scope="module")
def moved(toy):
    """A block slid on a base; Gaussians and photos of both states."""
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.25), 1), toy.Box((0.05, 0.1, 0.25),
                                                                  (0.4, 0.5, 0.5), 2)
    after = replace(block, move=make(np.eye(3), np.array([0.3, 0, 0])))
    pair = [toy.gaussians_of(boxes, 0.03)[0] for boxes in ([base, block], [base, after])]
    eyes = toy.cameras(8, SIDE, np.array([0.4, 0.3, 0.25]), 1.1)
    return toy.scene_of(tuple(toy.drawn(g, *eyes, SIDE) for g in pair)), (pair[0], pair[1])


def dimmed(gaussians, gain):
    return replace(gaussians, sh0=((gaussians.colors * gain - 0.5) / SH_C0).astype(np.float32))


def test_nothing_changes_where_cameras_kept_their_exposure(moved):
    gain = gain_between(*moved)
    assert (gain == 1).all()
    scene, pair = matched(*moved, gain)
    assert scene is moved[0]
    assert pair is moved[1]
    assert told(gain) == ""


@pytest.mark.parametrize("gain", [(0.7, 0.7, 0.7), (0.9, 0.75, 0.6), (1.2, 1.0, 0.9)])
def test_the_gain_is_that_of_what_stands_still(moved, gain):
    scene, (zero, one) = moved
    pair = (dimmed(zero, 0.8), dimmed(one, 0.8 * np.array(gain)))
    found = gain_between(scene, pair)
    assert found == pytest.approx(np.array(gain), rel=0.02)
    assert "brightened" in told(found)
    _, (a, b) = matched(scene, pair, found)
    scale = np.maximum(1.0 / np.array(gain), 1.0)  # of state 1; state 0 takes the other ones
    assert b.colors == pytest.approx(np.clip(pair[1].colors * scale, 0, 1), abs=0.02)
    assert a.colors == pytest.approx(
        np.clip(pair[0].colors * np.maximum(gain, 1.0), 0, 1), abs=0.02)
    assert gain_between(scene, (a, b)) == pytest.approx(np.ones(3), abs=0.03)


def test_photos_are_brightened_with_their_gaussians_and_clip(moved):
    scene, pair = moved
    bright, _ = matched(scene, pair, np.array([0.5, 1.0, 2.0]))
    zero, one = (s.images.astype(int) for s in scene.states)
    new_zero, new_one = (s.images.astype(int) for s in bright.states)
    assert (new_one[..., 0] == np.clip(2 * one[..., 0], 0, 255)).all()
    assert (new_one[..., 1:] == one[..., 1:]).all()
    assert (new_zero[..., 2] == np.clip(2 * zero[..., 2], 0, 255)).all()
    assert (new_zero[..., :2] == zero[..., :2]).all()


def test_states_that_share_no_surface_tell_nothing(moved):
    scene, (zero, one) = moved
    far = replace(dimmed(one, 0.5), means=one.means + np.float32(0.2))
    assert (gain_between(scene, (zero, far)) == 1).all()
