"""The CPU rasteriser at the ends of its range: every result finite and equal to a known truth."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from render_reference import render_reference

from part2gs_robotics.model.arrays import F64 as Array
from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Gradients, Rendered, render, render_backward

Scene = dict[str, Array]
Float = type[np.floating]
pytestmark = pytest.mark.usefixtures("one_numba_thread")
INPUTS = ("means", "quats", "scales", "opacities", "colors", "extra")
IMAGES = ("color", "alpha", "depth", "extra")
NEAR, DISTANCE = 0.01, 2.0  # scene units; a Gaussian is drawn where z is larger than NEAR
SIDE, FOCAL = 33, 50.0
BACKGROUND = np.array([0.2, 0.5, 0.7])
both = pytest.mark.parametrize("dtype", [np.float32, np.float64])


def camera(width: int, height: int) -> Array:
    return np.array([[FOCAL, 0, width / 2], [0, FOCAL, height / 2], [0, 0, 1]])


def balls(means: list[list[float]], sigma: float, opacity: float = 0.6) -> Scene:
    """Balls of one size and opacity, each of its own colour."""
    n, rng = len(means), np.random.default_rng(0)
    return {"means": np.array(means, float).reshape(n, 3),
            "quats": np.tile([1.0, 0, 0, 0], (n, 1)), "scales": np.full((n, 3), sigma),
            "opacities": np.full(n, opacity), "colors": rng.uniform(0, 1, (n, 3)),
            "extra": rng.normal(size=(n, 2))}


def some(n: int, width: int = SIDE, height: int = SIDE, seed: int = 0) -> Scene:
    """Draw Gaussians of 1 to 10 pixels, of any orientation, over an image and its border."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.0, 3.0, n)
    places = rng.uniform(-0.1, 1.1, (n, 2)) * (width, height) - np.array([width, height]) / 2
    return {"means": np.column_stack([places * z[:, None] / FOCAL, z]),
            "quats": rng.normal(size=(n, 4)),
            "scales": z[:, None] / FOCAL * np.exp(rng.uniform(0, np.log(10), (n, 3))),
            "opacities": rng.uniform(0.05, 0.95, n), "colors": rng.uniform(0, 1, (n, 3)),
            "extra": rng.normal(size=(n, 2))}


def drawn(g: Scene, dtype: Float, width: int = SIDE, height: int = SIDE,
          view: Array | None = None) -> Rendered:
    v = {k: a.astype(dtype) for k, a in g.items()}
    lens = Camera(np.eye(4) if view is None else view, camera(width, height), width, height)
    out = render(Splats(*(v[k] for k in INPUTS[:-1])), lens, extra=v["extra"],
                 background=BACKGROUND)
    assert all(np.isfinite(getattr(out, k)).all() for k in (*IMAGES, "median_depth"))
    return out


def weights(width: int, height: int) -> Scene:
    rng = np.random.default_rng(1)
    return {k: rng.normal(size=(height, width, *channels))
            for k, channels in zip(IMAGES, ((3,), (), (), (2,)), strict=True)}


def backward(out: Rendered) -> Gradients:
    """Gradients of a random linear loss over all images."""
    w = weights(*out.alpha.shape[::-1])
    found = render_backward(out, *(w[image] for image in IMAGES))
    assert all(np.isfinite(getattr(found, k)).all() for k in (*INPUTS, "means2d_abs"))
    return found


def reference(g: Scene, width: int, height: int) -> tuple[Scene, Scene]:
    """Images and gradients of the loss of `backward` by autograd."""
    t = {k: torch.tensor(a, requires_grad=True) for k, a in g.items()}
    out = render_reference(t["means"], t["quats"], t["scales"], t["opacities"], t["colors"],
                           torch.eye(4, dtype=torch.float64), torch.tensor(camera(width, height)),
                           width, height, extra=t["extra"], background=torch.tensor(BACKGROUND))
    w = weights(width, height)
    loss = torch.stack([(getattr(out, k) * torch.tensor(w[k])).sum() for k in IMAGES]).sum()
    slopes = torch.autograd.grad(loss, list(t.values()))
    return ({k: getattr(out, k).detach().numpy() for k in (*IMAGES, "median_depth")},
            {k: slope.numpy() for k, slope in zip(t, slopes, strict=True)})


def assert_equals_reference(g: Scene, dtype: Float, width: int = SIDE, height: int = SIDE) -> None:
    """Compare images and gradients with the reference at inputs that the dtype holds exactly."""
    g = {k: a.astype(dtype).astype(np.float64) for k, a in g.items()}
    out = drawn(g, dtype, width, height)
    gradients = backward(out)
    images, exact = reference(g, width, height)
    # float64: sums in another order, and the reference's matrix inverse on long ellipses.
    # float32: asked for is 1e-3 in images; a cosine of 0.9999 is an angle of 1.4e-2.
    image_error, gradient_error = (1e-9, 1e-8) if dtype == np.float64 else (1e-3, 1e-2)
    for k, expected in images.items():
        np.testing.assert_allclose(getattr(out, k), expected, rtol=0, atol=image_error, err_msg=k)
    for k, expected in exact.items():
        error = np.linalg.norm(getattr(gradients, k) - expected)
        assert error <= gradient_error * np.linalg.norm(expected) + 1e-9, k


def footprint(g: Scene, variance: float) -> Array:
    """Alpha image of a round Gaussian by hand; variance in pixels^2 includes the low-pass."""
    x, y, z = g["means"][0]
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    squared = (columns - FOCAL * x / z) ** 2 + (rows - FOCAL * y / z) ** 2
    alpha = g["opacities"][0] * np.exp(-0.5 * squared / variance)
    return np.where(alpha < 1 / 255, 0, np.minimum(alpha, 0.99))


@both
def test_no_gaussian_shows_the_background(dtype: Float) -> None:
    out = drawn(balls([], 0.1), dtype)
    np.testing.assert_array_equal(out.color - BACKGROUND.astype(dtype), 0)
    assert not any(getattr(out, k).any() for k in ("alpha", "depth", "median_depth", "extra"))
    assert not out.visible.any()
    assert backward(out).means.shape == (0, 3)


@both
def test_one_gaussian_equals_the_reference(dtype: Float) -> None:
    assert_equals_reference(some(1), dtype)


@both
@pytest.mark.parametrize("z", [-2.0, -1e-9, 0.0])
def test_gaussians_behind_the_camera_are_absent(dtype: Float, z: float) -> None:
    behind = balls([[0.0, 0.0, z], [0.3, -0.2, z], [0.0, 0.0, -1e6]], 0.2)
    alone, front = drawn(behind, dtype), some(5)
    assert not alone.visible.any()
    assert not alone.alpha.any()
    assert not any(getattr(backward(alone), k).any() for k in INPUTS)
    mixed = drawn({k: np.concatenate([behind[k], front[k]]) for k in INPUTS}, dtype)
    expected = drawn(front, dtype)
    for k in IMAGES:
        np.testing.assert_array_equal(getattr(mixed, k), getattr(expected, k))
    gradients, without = backward(mixed), backward(expected)
    for k in INPUTS:
        assert not getattr(gradients, k)[:3].any()
        np.testing.assert_array_equal(getattr(gradients, k)[3:], getattr(without, k))


@both
def test_gaussian_on_the_near_plane_is_absent_and_one_past_it_is_drawn(dtype: Float) -> None:
    on = dtype(NEAR)  # in float32 just below 0.01, so that it is absent under either rounding
    before, past = np.nextafter(on, dtype(0)), np.nextafter(on, dtype(1))
    out = drawn(balls([[0.0, 0.0, float(before)], [0.0, 0.0, float(on)]], 1e-3), dtype)
    assert not out.visible.any()
    assert not out.alpha.any()
    assert not backward(out).means.any()
    g = balls([[0.0, 0.0, float(past)]], 1e-3)  # 5 px
    # The plane itself is 1e-7 off in float32.
    np.testing.assert_allclose(drawn(g, dtype).alpha, footprint(g, 25.3), rtol=0, atol=1e-6)
    assert_equals_reference(g, dtype)


@both
def test_gaussians_around_the_camera_and_the_near_plane_equal_the_reference(dtype: Float) -> None:
    g = some(12)
    g["means"] *= np.linspace(-0.01, 0.05, 12)[:, None] / g["means"][:, 2:]
    g["scales"] *= 0.02  # still hundreds of pixels for the nearest
    assert_equals_reference(g, dtype)


@both
@pytest.mark.parametrize("sigma", [1.0, 1e3, 1e6])
def test_gaussians_covering_the_image_equal_the_reference(dtype: Float, sigma: float) -> None:
    assert_equals_reference(balls([[0.1, -0.05, 2], [0.1, 0.1, 3], [-0.4, 0, 2.5]], sigma), dtype)


@both
def test_covering_gaussians_blend_by_hand(dtype: Float) -> None:
    g = balls([[0.0, 0.0, 2.0], [0.0, 0.0, 3.0]], 1e6, opacity=0.4)
    out = drawn(g, dtype)
    color = 0.4 * g["colors"][0] + 0.24 * g["colors"][1] + 0.36 * BACKGROUND
    np.testing.assert_allclose(out.color, np.broadcast_to(color, out.color.shape), rtol=1e-5)
    gradients = render_backward(out, None, np.ones_like(out.alpha))
    # alpha = 1 - (1 - a)(1 - b) in every pixel; float32 sums 1,089 of them.
    np.testing.assert_allclose(gradients.opacities, 0.6 * SIDE * SIDE, rtol=1e-4)


def needles(length: float) -> Scene:
    """Needles in all directions; length in pixels, a million times their thickness."""
    g = some(6)
    g["scales"] = g["means"][:, 2:] / FOCAL * length * np.array([1, 1e-6, 1e-6])
    return g


@both
@pytest.mark.parametrize("length", [1, 10, 100])
def test_needles_of_aspect_1e6_equal_the_reference(dtype: Float, length: float) -> None:
    assert_equals_reference(needles(length), dtype)


@both
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4, np.pi / 2, 3.0])
def test_needle_of_a_million_pixels_is_a_line(dtype: Float, angle: float) -> None:
    g = balls([[0.1, -0.05, DISTANCE]], DISTANCE / FOCAL)  # one pixel thick
    g["scales"][0] *= [1e6, 1, 1e-6]
    g["quats"][0] = [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5 - SIDE / 2
    off = (columns - 2.5) * np.sin(angle) - (rows + 1.25) * np.cos(angle)
    alpha = 0.6 * np.exp(-0.5 * off**2 / 1.3)
    out = drawn(g, dtype)
    backward(out)
    # float64: (distance / 1e6 px)^2. float32: terms of up to 500 cancel in the exponent, and
    # the quaternion's rounding turns the line by 1e-7 rad, 1e-6 px at the border.
    np.testing.assert_allclose(out.alpha, np.where(alpha < 1 / 255, 0, alpha), rtol=0,
                               atol=1e-8 if dtype == np.float64 else 3e-4)


@both
def test_needle_seen_from_its_end_is_a_point(dtype: Float) -> None:
    g = balls([[0.0, 0.0, DISTANCE]], 1e-6)
    g["scales"][0, 2] = 1.0
    out = drawn(g, dtype)
    backward(out)
    np.testing.assert_allclose(out.alpha, footprint(g, 0.3), rtol=0, atol=1e-6)


@both
def test_opacities_zero_and_one_equal_the_reference(dtype: Float) -> None:
    g = some(8)
    g["opacities"] = np.tile([0.0, 1.0], 4)
    assert_equals_reference(g, dtype)
    gradients = backward(drawn(g, dtype))
    assert not any(getattr(gradients, k)[::2].any() for k in INPUTS)  # opacity 0 has no slope


@both
def test_opacity_of_one_grey_level_is_at_most_one_pixel(dtype: Float) -> None:
    # An alpha of exactly 1/255 is on the border: rounding may keep or drop the centre.
    g = balls([[0.0, 0.0, DISTANCE]], 0.2, opacity=1 / 255)
    out = drawn(g, dtype)
    backward(out)
    center = float(out.alpha[SIDE // 2, SIDE // 2])
    assert center == pytest.approx(1 / 255, rel=1e-5) or center == 0
    assert np.count_nonzero(out.alpha) <= 1
    g["opacities"][:] = 0.999 / 255
    assert not drawn(g, dtype).alpha.any()
    g["opacities"][:] = 1.001 / 255
    alpha = drawn(g, dtype).alpha
    assert alpha[SIDE // 2, SIDE // 2] == pytest.approx(1.001 / 255, rel=1e-4)
    assert np.count_nonzero(alpha) == 1  # 0.2 is 5 px: one pixel away it is 2 % less


@both
@pytest.mark.parametrize("opacity", [0.004, 0.05, 0.5, 0.97])
def test_ten_thousand_coincident_gaussians_have_their_closed_form(dtype: Float,
                                                                  opacity: float) -> None:
    n = 10_000
    g = balls([[0.0, 0.0, DISTANCE]] * n, 0.2, opacity)
    out = drawn(g, dtype)
    a = footprint(g, 25.3)
    with np.errstate(divide="ignore"):
        # A pixel takes Gaussians until its transmittance is below 1e-4.
        count = np.where(a > 0, np.floor(np.log(1e-4) / np.log1p(-a)) + 1, 0)
    left = (1 - a) ** count
    # A pixel on the border of one more Gaussian differs by 1e-4 a; 2,300 products in float32.
    tolerance = 2e-5 if dtype == np.float32 else 1e-9
    np.testing.assert_allclose(out.alpha, 1 - left, rtol=0, atol=tolerance)
    backward(out)
    k = np.arange(n)[:, None]
    weight = np.where(k < count.ravel(), a.ravel() * (1 - a.ravel()) ** k, 0).sum(axis=1)
    np.testing.assert_allclose(render_backward(out, np.ones_like(out.color)).colors,
                               np.tile(weight[:, None], 3), rtol=0, atol=weight[0] * tolerance)


@both
@pytest.mark.parametrize("s", [1e-3, 1e-2, 1.0, 1e2, 1e3])
def test_scaling_the_scene_scales_lengths_and_nothing_else(dtype: Float, s: float) -> None:
    g = some(20)
    g["means"] *= 20  # from 0.02 at the smallest scale on: past the near plane
    g["scales"] *= 20
    view, far = np.eye(4), np.eye(4)
    view[:3, 3] = [0.5, -0.3, 2.0]
    far[:3, 3] = view[:3, 3] * s
    scaled = {**g, "means": g["means"] * s, "scales": g["scales"] * s}
    out, expected = drawn(scaled, dtype, view=far), drawn(g, np.float64, view=view)
    # float64: rounded products only. float32: asked for; 1.4e-2 is a cosine of 0.9999.
    image_error, gradient_error = (1e-12, 1e-11) if dtype == np.float64 else (1e-3, 1.4e-2)
    for k in (*IMAGES, "median_depth"):
        unit, size = (s, 50) if "depth" in k else (1.0, 1)  # depths are up to 62
        np.testing.assert_allclose(getattr(out, k) / unit, getattr(expected, k), rtol=0,
                                   atol=image_error * size, err_msg=k)
    w = weights(SIDE, SIDE)
    wanted = render_backward(expected, *w.values())
    got = render_backward(out, *(w | {"depth": w["depth"] / s}).values())
    for k in INPUTS:
        value = getattr(got, k) * (s if k in ("means", "scales") else 1)
        error = np.linalg.norm(value - getattr(wanted, k))
        assert error <= gradient_error * np.linalg.norm(getattr(wanted, k)), k


@both
@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (7, 9), (16, 16), (31, 33), (33, 65)])
def test_any_image_size_equals_the_reference(dtype: Float, size: tuple[int, int]) -> None:
    assert_equals_reference(some(12, *size), dtype, *size)
