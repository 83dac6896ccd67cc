"""Pieces of what one motion carries."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.decide.split import pieces
from part2gs_robotics.evidence.surfels import Surfels, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

SLIDE = Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), 0.4)


def square(centre, side, count=20):
    grid = np.linspace(-side / 2, side / 2, count)
    u, v = np.meshgrid(grid, grid)
    return np.stack([u.ravel(), 0 * u.ravel(), v.ravel()], 1) + centre


def surfels(*points):
    points = np.concatenate(points)
    flat = np.tile([0.0, 1, 0], (len(points), 1))
    return Surfels(points, flat, np.zeros_like(points), np.ones(len(points), np.int64))


def moved(points):
    return se3.apply(SLIDE.move, points)


def test_both_states_of_a_part_meet_at_home():
    one = square(np.zeros(3), 0.2)
    home = at_home(SLIDE, (surfels(one), surfels(moved(one))))
    np.testing.assert_allclose(home[: len(one)], home[len(one):], atol=1e-12)


def test_far_pieces_are_told_apart_the_largest_first_and_near_ones_are_one():
    large, small = square(np.array([0.0, 0, 0]), 0.2), square(np.array([0.5, 0, 0]), 0.15, 15)
    own = surfels(large, small), surfels(moved(large), moved(small))
    found = pieces(SLIDE, own, 1.0, 25)
    assert [(len(a), len(b)) for a, b in found] == [(400, 400), (225, 225)]
    assert found[1][0].points[:, 0].min() > 0.4
    beside = square(np.array([0.16, 0, 0]), 0.1)  # 0.01 beside the large one
    own = surfels(large, beside), surfels(moved(large), moved(beside))
    assert len(pieces(SLIDE, own, 1.0, 25)) == 1


def test_handles_and_what_one_state_alone_shows_are_no_pieces():
    large, handle = square(np.zeros(3), 0.2), square(np.array([0.5, 0, 0]), 0.03, 5)
    other = square(np.array([-0.5, 0, 0]), 0.2)
    own = surfels(large, handle), surfels(moved(large), moved(handle), moved(other))
    assert [(len(a), len(b)) for a, b in pieces(SLIDE, own, 1.0, 25)] == [(400, 400)]
    assert pieces(SLIDE, (surfels(large[:0]), surfels(large[:0])), 1.0, 25) == []
