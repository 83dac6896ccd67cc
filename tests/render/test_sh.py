"""Laws of the spherical-harmonic colours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from part2gs_robotics.render.sh import sh_colors, sh_colors_backward

Array = NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("one_numba_thread")
CAMERA = np.array([0.3, -0.2, -2.0])


def _draw(bands: int, seed: int = 0, n: int = 30) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(n, 3)), rng.normal(size=(n, 3)),
            0.4 * rng.normal(size=(n, bands, 3)))


@pytest.mark.parametrize("bands", [0, 3, 8, 15])
def test_gradients_equal_finite_differences(bands: int) -> None:
    inputs = _draw(bands)
    weights = np.random.default_rng(1).normal(size=(30, 3))
    d_sh0, d_shN, d_means = sh_colors_backward(*inputs, CAMERA, weights)
    for place, gradient in ((0, d_means), (1, d_sh0), (2, d_shN)):
        for index in np.ndindex(inputs[place].shape):
            sums = []
            for step in (1e-6, -1e-6):
                moved = [a.copy() for a in inputs]
                moved[place][index] += step
                sums.append(float(np.sum(sh_colors(*moved, CAMERA) * weights)))
            # Rounding of the sums, 1e-15 x 100, over the step.
            assert gradient[index] == pytest.approx((sums[0] - sums[1]) / 2e-6, abs=1e-7)


def test_basis_is_orthonormal_on_the_sphere() -> None:
    # Gauss-Legendre x equispaced points integrate products of degree 3 (degree 6) exactly.
    heights, weights = np.polynomial.legendre.leggauss(8)
    angles = np.arange(16) * (2 * np.pi / 16)
    z, a = (g.ravel() for g in np.meshgrid(heights, angles, indexing="ij"))
    r = np.sqrt(1 - z * z)
    points = np.column_stack([r * np.cos(a), r * np.sin(a), z])
    area = np.repeat(weights, 16) * (2 * np.pi / 16)
    basis = np.zeros((16, len(points)))
    for k in range(16):
        sh0, shN = np.zeros((len(points), 3)), np.zeros((len(points), 15, 3))
        (sh0 if k == 0 else shN[:, k - 1])[:] = 0.1  # small: colours stay above 0
        basis[k] = (sh_colors(points, sh0, shN, np.zeros(3))[:, 0] - 0.5) / 0.1
    np.testing.assert_allclose((basis * area) @ basis.T, np.eye(16), atol=1e-13)


def test_degree_zero_is_the_colour_of_the_contract() -> None:
    means, sh0, shN = _draw(0)
    expected = np.maximum(0.5 + 0.28209479177387814 * sh0, 0)
    np.testing.assert_allclose(sh_colors(means, sh0, shN, CAMERA), expected, rtol=1e-14)


def test_clipped_colour_has_no_gradient() -> None:
    means, sh0, shN = _draw(3)
    sh0[:] = -10
    assert not sh_colors(means, sh0, shN, CAMERA).any()
    assert not any(g.any() for g in sh_colors_backward(means, sh0, shN, CAMERA, np.ones((30, 3))))


def test_float32_stays_float32() -> None:
    inputs = _draw(8)
    single = [a.astype(np.float32) for a in inputs]
    out = sh_colors(*single, CAMERA)
    assert out.dtype == np.float32
    np.testing.assert_allclose(out, sh_colors(*inputs, CAMERA), atol=1e-6)


def test_no_gaussian() -> None:
    assert sh_colors(*_draw(3, n=0), CAMERA).shape == (0, 3)
