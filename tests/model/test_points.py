"""Points far from one another: greedy, never one twice, and the same in every frame."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.model.points import farthest, outermost
from part2gs_robotics.model.se3 import apply, make, rotation_from_rotvec


def test_farthest_points_cover_the_cloud_and_follow_rigid_motion():
    points = np.random.default_rng(4).uniform(size=(1500, 3))
    index = farthest(points, 100, outermost(points))
    assert len(set(index)) == 100
    gaps = np.linalg.norm(points[:, None] - points[index], axis=2)
    chosen = np.linalg.norm(points[index][:, None] - points[index], axis=2) + 9 * np.eye(100)
    # greedy law: no left-out point is farther from the sample than the sample's own spacing
    assert gaps.min(1).max() <= chosen.min() + 1e-9
    move = make(rotation_from_rotvec(np.array([1.0, 2.0, 0.4])), np.array([3.0, 0.0, 1.0]))
    moved = apply(move, points)
    np.testing.assert_array_equal(farthest(moved, 100, outermost(moved)), index)


@pytest.mark.parametrize("first", [0, 7, 59])
def test_every_point_is_the_farthest_from_those_before(first):
    points = np.random.default_rng(first).normal(size=(60, 3))
    index = farthest(points, 60, first)
    assert index[0] == first
    assert sorted(index) == list(range(60)), "never one twice"
    for step in range(1, 60):
        gaps = np.linalg.norm(points[:, None] - points[index[:step]], axis=2).min(1)
        assert gaps[index[step]] == pytest.approx(gaps.max())


def test_farthest_points_spread():
    rng = np.random.default_rng(0)
    clusters = np.repeat(np.eye(3) * 5, 40, 0) + rng.normal(scale=0.01, size=(120, 3))
    for first in range(0, 120, 7):
        assert sorted(i // 40 for i in farthest(clusters, 3, first)) == [0, 1, 2]
    assert len(farthest(clusters[:2], 5, int(rng.integers(2)))) == 2


def test_coincident_points_are_not_taken_twice():
    same = np.zeros((6, 3))
    assert sorted(farthest(same, 9, outermost(same))) == list(range(6))
    pairs = np.repeat(np.random.default_rng(1).normal(size=(5, 3)), 2, 0)
    assert sorted(farthest(pairs, 10, 3)) == list(range(10))
    assert len({i // 2 for i in farthest(pairs, 5, 3)}) == 5, "copies come last"


def test_the_outermost_is_farthest_from_the_centroid():
    points = np.random.default_rng(2).normal(size=(200, 3)) + 5.0
    gaps = np.linalg.norm(points - points.mean(0), axis=1)
    assert outermost(points) == gaps.argmax()
    assert outermost(points[:0]) == 0
    assert farthest(points[:0], 4, outermost(points[:0])).shape == (0,)
