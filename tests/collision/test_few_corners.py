"""Few corners: convex pieces that engines are quick with, inside the ones they stand for."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from part2gs_robotics.collision.few_corners import MOST_CORNERS, few_cornered
from part2gs_robotics.model.solids import corners_of, hull_of


def rounded_box(scale=1.0):
    """A box with a small ball at every corner: many corners, of which few matter."""
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-0.6, 0.6) for z in (-0.3, 0.3)])
    near = rng.standard_normal((8, 30, 3))
    near *= 0.02 / np.linalg.norm(near, axis=2, keepdims=True)
    return hull_of(scale * (corners[:, None] + near).reshape(-1, 3))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_rounded_box_keeps_its_volume_with_few_corners(scale):
    full = rounded_box(scale)
    assert len(corners_of(full)) > MOST_CORNERS
    few = few_cornered(full)
    assert len(corners_of(few)) <= MOST_CORNERS
    assert few.volume() > 0.99 * full.volume()


def test_it_lies_inside_so_that_nothing_new_is_met():
    full = manifold3d.Manifold.sphere(1.0, 24)
    few = few_cornered(full)
    assert len(corners_of(few)) <= MOST_CORNERS
    assert (few - full).volume() < 1e-9
    assert few.volume() > 0.85 * full.volume()


def test_few_corners_stay_as_they_are():
    cube = manifold3d.Manifold.cube((1.0, 2.0, 3.0))
    assert few_cornered(cube) is cube
