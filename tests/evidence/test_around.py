"""Surfels around every Gaussian: what they say together of its part."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from part2gs_robotics.evidence.study import VOICES, around


class Points:
    """Surfels of which places alone are asked."""

    def __init__(self, points):
        self.points = np.asarray(points, np.float64)

    def __len__(self):
        return len(self.points)


def told(means, surfels, hard, count=2):
    return near(means, surfels).shares(np.asarray(hard), count)


def near(means, surfels):
    return around(SimpleNamespace(means=np.asarray(means, np.float32)), Points(surfels))


@pytest.fixture
def rim():
    """A square rim of surfels, one unit apart, around a hole of eight units."""
    side = np.arange(-5.0, 6.0)
    x, y = np.meshgrid(side, side)
    whole = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    return whole[np.abs(whole).max(1) > 4.5]


def test_one_odd_surfel_does_not_speak_for_a_hole_full_of_gaussians(rim):
    odd = np.abs(rim - [5.0, 0.0, 0.0]).sum(1).argmin()
    hard = np.zeros(len(rim), np.int64)
    hard[odd] = 1
    hole = np.array([[x, y, 0.0] for x in np.linspace(2.0, 3.9, 8) for y in (-0.3, 0.0, 0.3)])
    gaps = np.linalg.norm(hole[:, None] - rim, axis=2)
    assert (gaps.argmin(1) == odd).all(), "it is the nearest to each of them"
    assert not told(hole, rim, hard).argmax(1).any()


def test_a_gaussian_in_its_surfel_is_of_that_surfels_part_whatever_is_around(rim):
    hard = np.arange(len(rim)) % 3  # every neighbour is of another part
    shares = told(rim + 1e-4, rim, hard, 3)
    assert_array_equal(shares.argmax(1), hard)
    assert shares[np.arange(len(rim)), hard].min() > 0.99


def test_what_far_surfels_say_counts_less_by_the_square_of_their_distance(rim):
    hard = np.ones(len(rim), np.int64)
    above = np.array([[5.0, 5.0, height] for height in (0.0, 0.5, 1.0, 2.0, 4.0)])
    sure = near(above, rim).against(hard, 2)
    assert_allclose(sure[:, 0], [1.0, 1.0, 1.0, 1 / 4, 1 / 16], rtol=1e-5)
    assert_allclose(sure[:, 1], 0.0, atol=1e-6)
    assert_allclose(near(1e3 * above, 1e3 * rim).against(hard, 2), sure, atol=1e-5)


def test_shares_are_of_one_whole_and_know_no_unit(rim):
    rng = np.random.default_rng(3)
    means, hard = rng.uniform(-5, 5, (40, 3)), rng.integers(0, 4, len(rim))
    shares = told(means, rim, hard, 4)
    assert shares.shape == (40, 4)
    assert_allclose(shares.sum(1), 1.0, rtol=1e-5)
    assert_allclose(told(1e-3 * means, 1e-3 * rim, hard, 4), shares, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("count", [1, 2, VOICES + 1])
def test_few_surfels_speak_all_of_them_and_one_hit_exactly_speaks_alone(count):
    line = np.stack([np.arange(count, dtype=float), np.zeros(count), np.zeros(count)], 1)
    hard = np.zeros(count, np.int64)
    hard[-1] = 1
    shares = told([line[-1]], line, hard)
    assert np.isfinite(shares).all()
    assert_allclose(shares, [[0.0, 1.0]], atol=1e-6)
