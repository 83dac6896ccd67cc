"""Gaussians few and simple enough that their image is known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Rendered, render, render_backward

Array = NDArray[np.float64]
SIDE, FOCAL, DISTANCE = 33, 50.0, 2.0
K = np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1.0]])
BACKGROUND = np.array([0.2, 0.5, 0.7])


def draw(opacities: list[float], sigma: float, colors: Array, dtype: type = np.float64) -> Rendered:
    """Draw balls of one size, all at the middle of the image."""
    count = len(opacities)
    arrays = (np.tile([0.0, 0, DISTANCE], (count, 1)), np.tile([2.0, 0, 0, 0], (count, 1)),
              np.full((count, 3), sigma), np.array(opacities), colors)
    return render(Splats(*(a.astype(dtype) for a in arrays)), Camera(np.eye(4), K, SIDE, SIDE),
                  background=BACKGROUND)


def expected_alpha(opacity: float, sigma: float) -> Array:
    variance = (FOCAL * sigma / DISTANCE) ** 2 + 0.3
    y, x = np.mgrid[:SIDE, :SIDE] - 16.0
    alpha = opacity * np.exp(-0.5 * (x * x + y * y) / variance)
    return np.where(alpha < 1 / 255, 0.0, alpha)


def test_one_gaussian_has_its_closed_form() -> None:
    out = draw([0.6], 0.2, np.array([[1.0, 0.5, 0]]))
    expected = expected_alpha(0.6, 0.2)
    np.testing.assert_allclose(out.alpha, expected, atol=1e-12)
    over = 0.5 * expected + (1 - expected) * BACKGROUND[1]
    np.testing.assert_allclose(out.color[..., 1], over, atol=1e-12)
    np.testing.assert_allclose(out.depth, DISTANCE * expected, atol=1e-12)
    np.testing.assert_array_equal(out.median_depth, np.where(expected > 0.5, DISTANCE, 0))


def test_coincident_gaussians_blend_in_the_order_of_their_indices() -> None:
    both = draw([0.5, 0.5], 0.2, np.array([[1.0, 0, 0], [0, 1.0, 0]]), np.float32)
    image = both.color - (1 - both.alpha)[..., None] * BACKGROUND
    alpha = expected_alpha(0.5, 0.2)
    np.testing.assert_allclose(image[..., 0], alpha, atol=1e-5)
    np.testing.assert_allclose(image[..., 1], alpha * (1 - alpha), atol=1e-5)


@pytest.mark.parametrize("count", [1, 6])
def test_opacity_zero_is_absent(count: int) -> None:
    rendered = draw([0.0] * count, 0.5, np.ones((count, 3)))
    assert not rendered.alpha.any()
    gradients = render_backward(rendered, np.ones_like(rendered.color))
    assert not gradients.colors.any()


def test_opacity_one_is_clamped() -> None:
    rendered = draw([1.0], 50.0, np.ones((1, 3)))
    np.testing.assert_allclose(rendered.alpha, 0.99, rtol=1e-12)
    gradients = render_backward(rendered, np.ones_like(rendered.color))
    assert not gradients.opacities.any()


def test_huge_gaussian_covers_the_image_without_overflow() -> None:
    rendered = draw([0.4], 1e12, np.ones((1, 3)), np.float32)
    np.testing.assert_allclose(rendered.alpha, 0.4, rtol=1e-5)
