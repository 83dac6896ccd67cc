"""L1 + D-SSIM: gradients against finite differences, closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from image_measures import ssim

from part2gs_robotics.fit.image_loss import photometric, psnr


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("shape", [(20, 24, 3), (11, 11, 1), (7, 30, 3)])
def test_gradient_matches_finite_differences(weight: float, shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(0)
    image, target = rng.random(shape), rng.random(shape)
    _, grad = photometric(image, target, weight)
    for _ in range(10):
        move = rng.normal(size=shape)
        step = 1e-6
        numeric = (photometric(image + step * move, target, weight)[0]
                   - photometric(image - step * move, target, weight)[0]) / (2 * step)
        # Central differences: truncation ~step^2, rounding ~1e-16 / step = 1e-10.
        assert numeric == pytest.approx(float((grad * move).sum()), rel=1e-5, abs=1e-8)


def test_equal_images_cost_nothing() -> None:
    image = np.random.default_rng(1).random((16, 16, 3))
    loss, grad = photometric(image, image)
    assert loss == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(grad, 0.0, atol=1e-12)
    assert ssim(image, image) == pytest.approx(1.0)


def test_constant_images_have_the_closed_form() -> None:
    size, inner = 41, slice(5, -5)  # the window has radius 5: inner pixels see no border
    a, b = 0.3, 0.6
    image, target = np.full((size, size, 3), a), np.full((size, size, 3), b)
    loss, _ = photometric(image[inner, inner], target[inner, inner], 0.0)
    assert loss == pytest.approx(0.3)
    expected = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
    whole = ssim(image, target) * size**2
    border = ssim(image, target)
    # Only the inner pixels obey the closed form: compare the growth from a larger image.
    large = ssim(np.full((size + 1, size, 3), a), np.full((size + 1, size, 3), b))
    row = large * (size + 1) * size - whole
    inner_row = (row - 2 * _edge_sum(a, b)) / (size - 10)
    assert inner_row == pytest.approx(expected, rel=1e-6)
    assert border != pytest.approx(expected, rel=1e-6)


def _edge_sum(a: float, b: float) -> float:
    """Sum of SSIM over the five border pixels of a row of constant images, rows complete."""
    tail = np.arange(-5, 6)
    kernel = np.exp(-tail**2 / (2 * 1.5**2))
    kernel /= kernel.sum()
    total = 0.0
    for k in range(5):
        m = kernel[5 - k:].sum()  # weight of the window inside the image
        x, y, xx, yy, xy = m * a, m * b, m * a * a, m * b * b, m * a * b
        total += ((2 * x * y + 1e-4) * (2 * (xy - x * y) + 9e-4)
                  / ((x * x + y * y + 1e-4) * (xx - x * x + yy - y * y + 9e-4)))
    return float(total)


def test_psnr_of_a_known_error() -> None:
    assert psnr(np.full((4, 4, 3), 0.6), np.full((4, 4, 3), 0.5)) == pytest.approx(20.0)


def test_float32_agrees_with_float64() -> None:
    rng = np.random.default_rng(2)
    image, target = rng.random((40, 40, 3)), rng.random((40, 40, 3))
    loss64, grad64 = photometric(image, target)
    loss32, grad32 = photometric(image.astype(np.float32), target.astype(np.float32))
    assert loss32 == pytest.approx(loss64, rel=1e-5)
    assert grad32.dtype == np.float32
    np.testing.assert_allclose(grad32, grad64, atol=1e-3 * np.abs(grad64).max())
