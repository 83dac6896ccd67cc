"""Laws of the bounded Hungarian matching (eq. 2)."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.paper.matching import MAX_MATCHES, match_hungarian


def test_hungarian_recovers_a_permuted_small_shift():
    points = np.random.default_rng(1).uniform(size=(80, 3))
    order = np.random.default_rng(2).permutation(80)
    pairs = match_hungarian(points, points[order] + 1e-4)
    assert sorted(pairs[:, 0]) == list(range(80))
    np.testing.assert_array_equal(order[pairs[:, 1]], pairs[:, 0])


def test_hungarian_is_bounded():
    points = np.random.default_rng(3).uniform(size=(700, 3))
    assert match_hungarian(points, points, 64).shape == (64, 2)
    assert match_hungarian(points[:9], points, MAX_MATCHES * 9).shape == (9, 2)
    assert match_hungarian(points[:0], points).shape == (0, 2)
