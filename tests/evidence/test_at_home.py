"""Surfels of a part where it is in state 0, and how far apart two motions carry them."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.evidence.surfels import Surfels, apart, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint


def surfels(points):
    flat = np.tile([0.0, 1, 0], (len(points), 1))
    return Surfels(points, flat, np.zeros_like(points), np.ones(len(points), np.int64))


def test_both_states_of_a_part_meet_at_home():
    points = np.random.default_rng(0).normal(size=(50, 3))
    for h in (Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), 0.4),
              Joint("revolute", np.array([0.0, 0, 1]), np.array([0.3, 0.1, 0]), 1.2)):
        home = at_home(h, (surfels(points), surfels(se3.apply(h.move, points))))
        np.testing.assert_allclose(home[:50], home[50:], atol=1e-12)
        np.testing.assert_allclose(home[:50], points, atol=1e-12)


def test_two_motions_are_as_far_apart_as_they_carry_the_part():
    points = np.random.default_rng(1).normal(size=(40, 3))
    slide = Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), 0.4)
    longer = Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), 0.55)
    own = surfels(points), surfels(se3.apply(slide.move, points))
    assert apart(slide, slide, own) == 0.0
    assert apart(longer, slide, own) == pytest.approx(0.15)
    assert apart(longer, slide, (surfels(points[:0]), surfels(points[:0]))) == np.inf
