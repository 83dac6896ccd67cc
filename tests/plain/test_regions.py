"""Regions: pieces of one even colour, their rims, and what noise does to them."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.plain.kernels import NOTHING
from part2gs_robotics.plain.regions import BESIDE, INSIDE, regions_of

SIDE, LEFT, RIGHT = 60, 0.4, 0.7


def halves() -> np.ndarray:
    """Return two plain halves with nothing around them."""
    image = np.full((SIDE, SIDE, 3), NOTHING, np.float32)
    image[10:50, 10:30], image[10:50, 30:50] = LEFT, RIGHT
    return image


def found(image: np.ndarray):
    return regions_of(image.astype(np.float32), np.random.default_rng(0))


def test_halves_of_two_colours_are_two_regions() -> None:
    regions = found(halves())
    assert [len(one.pixels) for one in regions] == [800, 800]
    assert [float(one.colors.mean()) for one in regions] == pytest.approx([LEFT, RIGHT], abs=1e-6)


def test_shading_that_changes_slowly_is_one_region() -> None:
    image = halves()
    image[10:50, 10:50] = np.linspace(LEFT, RIGHT, 40)[None, :, None]
    assert [len(one.pixels) for one in found(image)] == [1600]


@pytest.mark.parametrize("noise", [2.0, 5.0])
def test_noise_of_the_photo_does_not_tear_regions(noise: float) -> None:
    image, rng = halves(), np.random.default_rng(1)
    image[10:50, 10:50] += rng.normal(scale=noise / 255, size=(40, 40, 3))
    sizes = sorted(len(one.pixels) for one in found(image))[-2:]
    assert min(sizes) > 720  # of 800
    assert max(sizes) <= 800  # and the halves do not run into each other


def test_rims_look_at_both_sides_of_an_edge() -> None:
    left = found(halves())[0]
    outward = left.rim[1] - left.rim[0]
    np.testing.assert_allclose(np.linalg.norm(outward, axis=1), INSIDE + BESIDE, rtol=1e-6)
    straight = np.abs(outward[:, 0]) > 0.999 * (INSIDE + BESIDE)  # corners look aslant
    to_right = straight & (outward[:, 0] > 0)
    assert to_right.sum() > 5
    np.testing.assert_allclose(left.sides[0, to_right], LEFT, atol=1e-5)
    np.testing.assert_allclose(left.sides[1, to_right], RIGHT, atol=1e-5)
    assert (left.sides[1, straight & (outward[:, 0] < 0)] == NOTHING).all()


def test_small_pieces_and_faint_rims_are_no_regions() -> None:
    image = halves()
    image[10:50, 30:50] = NOTHING
    image[20:22, 40:41] = RIGHT  # two pixels
    assert [len(one.pixels) for one in found(image)] == [800]
    assert found(np.full((SIDE, SIDE, 3), LEFT)) == []  # no rim at all
    assert found(np.full((SIDE, SIDE, 3), NOTHING)) == []
