"""Laws of the CPU rasteriser: the reference, permutations, crops, input that is not finite."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from render_reference import render_reference

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Gradients, Rendered, render, render_backward
from part2gs_robotics.render.rendered import Near

Array = NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("one_numba_thread")
INPUTS = ("means", "quats", "scales", "opacities", "colors", "extra")
IMAGES = ("color", "alpha", "depth", "extra")
WIDTH, HEIGHT = 21, 38  # multiples of neither tile side; more than one tile in both directions
BACKGROUND = np.array([0.2, 0.5, 0.7])


def _camera() -> tuple[Array, Array]:
    """A camera at distance 1.5, turned about two axes, with an off-centre principal point."""
    a, b = 0.3, -0.2
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    viewmat = np.eye(4)
    viewmat[:3, :3] = pitch @ yaw
    viewmat[2, 3] = 1.5
    return viewmat, np.array([[30.0, 0, 9.0], [0, 33.0, 21.0], [0, 0, 1]])


VIEWMAT, INTRINSICS = _camera()
CAMERA = Camera(VIEWMAT, INTRINSICS, WIDTH, HEIGHT)


def _world(camera_points: Array) -> Array:
    return (camera_points - VIEWMAT[:3, 3]) @ VIEWMAT[:3, :3]


def _draw(kind: str, seed: int, n: int = 6) -> dict[str, Array]:
    """Random Gaussians of one kind; positions are chosen in the camera frame."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1.0, 2.0, n)
    reach = 0.35
    scales = np.exp(rng.normal(-2.3, 0.6, (n, 3)))
    opacities = rng.uniform(0.05, 0.98, n)
    if kind == "near":
        z = rng.uniform(0.1, 0.4, n)
        scales *= z[:, None]
    elif kind == "offscreen":
        reach = 1.2
        scales *= 3
    elif kind == "needle":
        scales = np.stack([rng.uniform(0.2, 0.8, n), *rng.uniform(1e-5, 1e-3, (2, n))], axis=1)
    elif kind == "covered":
        scales += 0.5
        opacities = rng.uniform(0.9, 1.0, n)
    xy = rng.uniform(-reach, reach, (n, 2)) * z[:, None]
    return {"means": _world(np.column_stack([xy, z])), "quats": rng.normal(size=(n, 4)),
            "scales": scales, "opacities": opacities, "colors": rng.uniform(0, 1, (n, 3)),
            "extra": rng.normal(size=(n, 2))}


def _splats(g: dict[str, Array]) -> Splats:
    return Splats(*(g[k] for k in INPUTS[:-1]))


def _render(g: dict[str, Array], dtype: type[np.floating] = np.float64) -> Rendered:
    v = {k: a.astype(dtype) for k, a in g.items()}
    return render(_splats(v), CAMERA, extra=v["extra"], background=BACKGROUND)


def _weights(seed: int) -> dict[str, Array]:
    """Random linear loss over all images."""
    rng = np.random.default_rng(seed + 10_000)
    shape = (HEIGHT, WIDTH)
    return {"color": rng.normal(size=(*shape, 3)), "alpha": rng.normal(size=shape),
            "depth": rng.normal(size=shape), "extra": rng.normal(size=(*shape, 2))}


def _loss(rendered: Rendered, weights: dict[str, Array]) -> float:
    return sum(float(np.sum(getattr(rendered, k) * weights[k])) for k in IMAGES)


def _backward(rendered: Rendered, w: dict[str, Array]) -> Gradients:
    return render_backward(rendered, w["color"], w["alpha"], w["depth"], w["extra"])


def _reference(g: dict[str, Array], weights: dict[str, Array]) -> tuple[Rendered, dict[str, Array]]:
    t = {k: torch.tensor(a, requires_grad=True) for k, a in g.items()}
    out = render_reference(t["means"], t["quats"], t["scales"], t["opacities"], t["colors"],
                           torch.tensor(VIEWMAT), torch.tensor(INTRINSICS), WIDTH, HEIGHT,
                           extra=t["extra"], background=torch.tensor(BACKGROUND))
    loss = sum((getattr(out, k) * torch.tensor(weights[k])).sum() for k in IMAGES)
    assert isinstance(loss, torch.Tensor)
    loss.backward()
    gradients = {k: a.grad.numpy() for k, a in t.items() if a.grad is not None}
    return out, gradients  # type: ignore[return-value]


@pytest.mark.parametrize("kind", ["mixed", "near", "offscreen", "needle", "covered"])
@pytest.mark.parametrize(("dtype", "value_error", "gradient_error"), [
    # float64 differs by the order of sums and by the inverse's conditioning (needles: 1e6).
    (np.float64, 1e-9, 1e-8),
    # float32: an image's slope of up to 20 per pixel times centres rounded at 4e-6 px; gradients
    # add 1 / (1 - alpha) <= 100 on their smallest terms.
    (np.float32, 1e-4, 2e-3)])
def test_images_and_gradients_equal_reference(kind: str, dtype: type[np.floating],
                                              value_error: float, gradient_error: float) -> None:
    for seed in range(2):
        g, weights = _draw(kind, seed), _weights(seed)
        g = {k: a.astype(np.float32).astype(np.float64) for k, a in g.items()}
        fast = _render(g, dtype)
        truth, truth_gradients = _reference(g, weights)
        for name in (*IMAGES, "median_depth"):
            expected = getattr(truth, name).detach().numpy()
            np.testing.assert_allclose(getattr(fast, name), expected, rtol=0, atol=value_error)
        gradients = _backward(fast, weights)
        for name, expected in truth_gradients.items():
            error = np.linalg.norm(getattr(gradients, name) - expected)
            assert error <= gradient_error * np.linalg.norm(expected) + 1e-9, (seed, name)


@pytest.mark.parametrize("reach", [0, 7])
def test_near_some_gaussians_the_image_is_whole_and_elsewhere_it_may_be_empty(reach: int) -> None:
    camera = Camera(VIEWMAT, np.array([[90.0, 0, 60.0], [0, 90.0, 70.0], [0, 0, 1]]), 128, 150)
    g = {k: a.astype(np.float32) for k, a in _draw("mixed", 5, n=300).items()}
    g["scales"] *= 0.2
    own = np.zeros(300, bool)
    own[:3] = True
    whole, cut = (render(_splats(g), camera, extra=g["extra"], near=near)
                  for near in (None, Near(own, reach)))
    share = render(_splats(g), camera, extra=own[:, None].astype(np.float32)).extra[..., 0]
    around = np.ones((2 * reach + 1,) * 2, np.uint8)
    asked = cv2.dilate((share > 0).astype(np.uint8), around) > 0
    assert 0.0 < asked.mean() < 0.5
    for name in IMAGES:
        np.testing.assert_array_equal(getattr(cut, name)[asked], getattr(whole, name)[asked])
    assert ((cut.alpha == 0) & (whole.alpha > 0)).mean() > 0.1
    assert cut.visible.sum() < whole.visible.sum()


def test_results_outlive_later_renderings_and_gradients() -> None:
    first, weights = _render(_draw("mixed", 3, n=40)), _weights(3)
    gradients = _backward(first, weights)
    results = [(out, k, getattr(out, k).copy()) for out, names in
               ((first, (*IMAGES, "median_depth", "visible")), (gradients, INPUTS)) for k in names]
    _backward(_render(_draw("mixed", 4, n=40)), _weights(4))
    _backward(first, _weights(4))
    for out, k, before in results:
        np.testing.assert_array_equal(getattr(out, k), before, err_msg=k)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", IMAGES)
def test_image_that_the_loss_does_not_use_counts_as_zero(name: str, dtype: type[np.floating]
                                                         ) -> None:
    rendered, weights = _render(_draw("mixed", 3), dtype), _weights(3)
    zero = _backward(rendered, {**weights, name: np.zeros_like(weights[name])})
    expected = {k: getattr(zero, k).copy() for k in INPUTS}
    unused = {f"d_{k}": None if k == name else w for k, w in weights.items()}
    gradients = render_backward(rendered, **unused)
    for k in INPUTS:
        np.testing.assert_array_equal(getattr(gradients, k), expected[k])


def test_permuting_gaussians_permutes_gradients() -> None:
    g, weights = _draw("mixed", 3, n=40), _weights(3)
    order = np.random.default_rng(0).permutation(40)
    shuffled = {k: a[order] for k, a in g.items()}
    one, two = _render(g), _render(shuffled)
    np.testing.assert_array_equal(one.color, two.color)
    for name in INPUTS:
        np.testing.assert_array_equal(getattr(_backward(one, weights), name)[order],
                                      getattr(_backward(two, weights), name))


@pytest.mark.parametrize("size", [(21, 38), (24, 64), (25, 65), (33, 40)])
def test_any_image_size_is_a_crop_of_a_larger_one(size: tuple[int, int]) -> None:
    # From 21 x 38 on, no Gaussian is outside the field of view, where the Jacobian depends on it.
    g = _draw("mixed", 1, n=20)
    small = render(_splats(g), Camera(VIEWMAT, INTRINSICS, *size))
    large = render(_splats(g), Camera(VIEWMAT, INTRINSICS, 70, 70))
    width, height = size
    np.testing.assert_allclose(small.color, large.color[:height, :width], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(small.median_depth, large.median_depth[:height, :width])


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_gaussian_that_is_not_finite_is_left_out(name: str, value: float,
                                                 dtype: type[np.floating]) -> None:
    g = _draw("mixed", 4)
    broken = {k: a.copy() for k, a in g.items()}
    broken[name][2] = value
    expected = _render({k: np.delete(a, 2, axis=0) for k, a in g.items()}, dtype)
    rendered = _render(broken, dtype)
    np.testing.assert_array_equal(rendered.color, expected.color)
    gradients = _backward(rendered, _weights(4))
    assert all(np.isfinite(getattr(gradients, k)).all() for k in INPUTS)
    assert not gradients.means[2].any()


def test_screen_gradient_is_the_slope_of_a_shift() -> None:
    g = {k: a[:1] for k, a in _draw("mixed", 6).items()}
    weights = _weights(6)
    shifted = []
    for axis in (0, 1):
        for sign in (1, -1):
            K = INTRINSICS.copy()
            K[axis, 2] += sign * 1e-6
            out = render(_splats(g), Camera(VIEWMAT, K, WIDTH, HEIGHT))
            shifted.append(float(np.sum(out.color * weights["color"])))
    slope = np.array([shifted[0] - shifted[1], shifted[2] - shifted[3]]) / 2e-6
    out = render(_splats(g), CAMERA)
    measured = render_backward(out, weights["color"]).means2d_abs[0]
    assert measured == pytest.approx(np.linalg.norm(slope), rel=1e-6)
