"""gsplat's images and gradients are those of the reference; skipped where CUDA is not ready."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from render_reference import render_reference

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.render import cuda as render_cuda
from part2gs_robotics.render.dispatch import render, render_backward
from part2gs_robotics.render.pick_device import why_not_cuda
from part2gs_robotics.render.rendered import Rendered
from part2gs_robotics.runtime.device import rendering_on

Array = NDArray[np.floating]
INPUTS = ("means", "quats", "scales", "opacities", "colors", "extra")
IMAGES = ("color", "alpha", "depth", "extra")
KINDS = ("mixed", "near", "offscreen", "large", "turned")
SEEDS = range(3)
WIDTH, HEIGHT = 37, 45  # multiples of no tile side; several of gsplat's tiles of 16 pixels
BACKGROUND = np.array([0.2, 0.5, 0.7])
INTRINSICS = np.array([[40.0, 0, 17.0], [0, 43.0, 24.0], [0, 0, 1]])
# Six Gaussians of at most 0.75 leave 0.25^6 = 2.4e-4 of the light: no pixel stops (1e-4), where
# gsplat leaves the last Gaussian out, and no alpha is clamped (0.99).
COUNT, OPACITY_MAX = 6, 0.75


@pytest.fixture(autouse=True)
def _ready(request: pytest.FixtureRequest) -> None:
    missing = why_not_cuda()
    if missing is not None:
        pytest.skip(missing)
    request.getfixturevalue("one_numba_thread")


def _viewmat() -> Array:
    """A camera at distance 1.5, turned about two axes."""
    a, b = 0.3, -0.2
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[2, 3] = pitch @ yaw, 1.5
    return viewmat


VIEWMAT = _viewmat()
CAMERA = Camera(VIEWMAT, INTRINSICS, WIDTH, HEIGHT)


def _draw(kind: str, seed: int, n: int = COUNT) -> dict[str, Array]:
    """Random float32 Gaussians of one kind; positions are chosen in the camera frame."""
    rng = np.random.default_rng(seed)
    z, reach = rng.uniform(1.0, 2.0, n), 0.35
    scales = np.exp(rng.normal(-2.3, 0.6, (n, 3)))
    if kind == "near":
        z = rng.uniform(0.1, 0.4, n)
        scales *= z[:, None]
    elif kind == "offscreen":  # centres beyond the limits of the Jacobian's direction
        reach, scales = 1.2, 3 * scales
    elif kind == "large":
        scales += 0.5
    elif kind == "turned":  # flat discs, as a fit makes of surfaces
        scales[:, 0] *= 0.05
    xyz = np.column_stack([rng.uniform(-reach, reach, (n, 2)) * z[:, None], z])
    g = {"means": (xyz - VIEWMAT[:3, 3]) @ VIEWMAT[:3, :3], "quats": rng.normal(size=(n, 4)),
         "scales": scales, "opacities": rng.uniform(0.05, OPACITY_MAX, n),
         "colors": rng.uniform(0, 1, (n, 3)), "extra": rng.normal(size=(n, 2))}
    return {name: values.astype(np.float32) for name, values in g.items()}


def _weights(seed: int) -> dict[str, Array]:
    """Random linear loss over all images."""
    rng = np.random.default_rng(seed + 10_000)
    shape = (HEIGHT, WIDTH)
    return {"color": rng.normal(size=(*shape, 3)), "alpha": rng.normal(size=shape),
            "depth": rng.normal(size=shape), "extra": rng.normal(size=(*shape, 2))}


def _render(g: dict[str, Array], device: str = "cuda") -> Rendered:
    with rendering_on("cuda" if device == "cuda" else "cpu"):
        return render(Splats(*(g[name] for name in INPUTS[:-1])), CAMERA, extra=g["extra"],
                      background=BACKGROUND)


def _backward(rendered: Rendered, w: dict[str, Array]) -> dict[str, Array]:
    gradients = render_backward(rendered, w["color"], w["alpha"], w["depth"], w["extra"])
    return {name: getattr(gradients, name) for name in (*INPUTS, "means2d_abs", "visible")}


def _truth(g: dict[str, Array], w: dict[str, Array]) -> tuple[dict[str, Array], dict[str, Array]]:
    """Images and gradients of the float64 reference."""
    t = {name: torch.tensor(a, dtype=torch.float64, requires_grad=True) for name, a in g.items()}
    out = render_reference(*(t[name] for name in INPUTS[:-1]), torch.tensor(VIEWMAT),
                           torch.tensor(INTRINSICS), WIDTH, HEIGHT, extra=t["extra"],
                           background=torch.tensor(BACKGROUND))
    images = [getattr(out, name) for name in IMAGES]
    gradients = torch.autograd.grad(images, list(t.values()),
                                    [torch.tensor(w[name]) for name in IMAGES])
    return ({name: image.detach().numpy() for name, image in zip(IMAGES, images, strict=True)},
            {name: a.numpy() for name, a in zip(t, gradients, strict=True)})


def _cosine(a: Array, b: Array) -> float:
    return float(np.sum(a * b) / (np.linalg.norm(a) * np.linalg.norm(b)))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_images_equal_the_reference(kind: str, seed: int) -> None:
    g = _draw(kind, seed)
    images, _ = _truth(g, _weights(seed))
    drawn = _render(g)
    for name in IMAGES:
        error = np.abs(getattr(drawn, name) - images[name])
        # Rounding decides whether an alpha of 1/255 is drawn: seldom, and by no more than that
        # alpha times the channel's range.
        assert np.mean(error > 1e-3) < 2e-3, name
        assert error.max() < 4 / 255, name


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_gradients_point_where_the_reference_points(kind: str, seed: int) -> None:
    g, w = _draw(kind, seed), _weights(seed)
    _, expected = _truth(g, w)
    gradients = _backward(_render(g), w)
    for name in INPUTS:
        assert _cosine(gradients[name], expected[name]) > 0.9999, name
        assert np.linalg.norm(gradients[name]) == pytest.approx(np.linalg.norm(expected[name]),
                                                                rel=0.01), name


@pytest.mark.parametrize("kind", KINDS)
def test_what_densification_and_part_maps_read_equals_the_cpu(kind: str) -> None:
    g, w = _draw(kind, 5), _weights(5)
    cuda, cpu = _render(g), _render(g, "cpu")
    assert isinstance(cuda.saved, render_cuda.Saved)
    assert isinstance(cpu.saved, render_cpu.Saved)
    # gsplat rounds an ellipse's half axes up to whole pixels: it may count a neighbour as visible.
    assert not (cpu.visible & ~cuda.visible).any()
    ours, theirs = _backward(cpu, w)["means2d_abs"], _backward(cuda, w)["means2d_abs"]
    np.testing.assert_allclose(theirs, ours, rtol=0.01, atol=0.01 * ours.max())
    np.testing.assert_allclose(cuda.median_depth, cpu.median_depth, atol=1e-5)


def test_opaque_surfaces_differ_by_a_few_hundredths_at_most() -> None:
    # Opacities above 0.99 are drawn as 0.99, and the Gaussian that would end a pixel is left out:
    # each moves a pixel by a hundredth of the contrast, and depth by a hundredth of its 2 units.
    for seed in SEEDS:
        g = _draw("large", seed)
        g["opacities"] = np.random.default_rng(seed).uniform(0.9, 1.0, COUNT).astype(np.float32)
        cuda, cpu = _render(g), _render(g, "cpu")
        for name, limit in (("color", 0.03), ("alpha", 0.02), ("depth", 0.05)):
            assert np.abs(getattr(cuda, name) - getattr(cpu, name)).max() < limit, name


def test_at_most_a_hundredth_of_the_light_passes_opaque_surfaces() -> None:
    # 0.95 leaves 0.05 at the common centre; with 0.999 behind it, gsplat would stop there.
    g = _draw("large", 0, n=4)
    g["means"] = (np.array([[0, 0, 1.0 + 0.1 * i] for i in range(4)]) - VIEWMAT[:3, 3]
                  ).astype(np.float32) @ VIEWMAT[:3, :3].astype(np.float32)
    g["opacities"] = np.array([0.95, 1, 1, 1], np.float32)
    g["scales"][:] = 0.5
    column, row = INTRINSICS[:2, 2].astype(int)
    assert _render(g).alpha[row - 1:row + 1, column - 1:column + 1].min() > 0.99


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_gaussian_that_is_not_finite_is_left_out(name: str, value: float) -> None:
    g, w = _draw("mixed", 4), _weights(4)
    broken = {key: a.copy() for key, a in g.items()}
    broken[name][2] = value
    expected = _render({key: np.delete(a, 2, axis=0) for key, a in g.items()})
    drawn = _render(broken)
    np.testing.assert_allclose(drawn.color, expected.color, atol=1e-6)
    gradients = _backward(drawn, w)
    assert not drawn.visible[2]
    assert all(np.isfinite(gradients[key]).all() and not gradients[key][2].any() for key in INPUTS)


def test_nothing_in_sight_shows_the_background() -> None:
    g = _draw("mixed", 0)
    behind = {**g, "means": g["means"] - 10 * VIEWMAT[2, :3].astype(np.float32)}
    for case in (behind, {name: a[:0] for name, a in g.items()}):
        drawn = _render(case)
        np.testing.assert_allclose(drawn.color, np.broadcast_to(BACKGROUND, drawn.color.shape),
                                   rtol=1e-6)
        assert not drawn.visible.any()
        assert not drawn.alpha.any()
        assert not drawn.median_depth.any()
        assert not _backward(drawn, _weights(0))["means"].any()


def test_float64_is_drawn_in_float32_and_inputs_stay_as_they_are() -> None:
    g = {name: a.astype(np.float64) for name, a in _draw("mixed", 1).items()}
    g["opacities"][0] = 1.0
    before = {name: a.copy() for name, a in g.items()}
    drawn = _render(g)
    gradients = _backward(drawn, _weights(1))
    arrays = [getattr(drawn, name) for name in IMAGES]
    arrays += [gradients[name] for name in (*INPUTS, "means2d_abs")]
    assert {a.dtype for a in arrays} == {np.dtype(np.float32)}
    assert all(a.flags.c_contiguous for a in arrays)
    assert all(np.array_equal(before[name], g[name]) for name in INPUTS)


@pytest.mark.parametrize("channels", [1, 7, 40])
def test_any_number_of_extra_channels_is_blended(channels: int) -> None:
    g = _draw("mixed", 2)
    extra = np.random.default_rng(0).uniform(size=(COUNT, channels)).astype(np.float32)
    cuda, cpu = (_render({**g, "extra": extra}, device) for device in ("cuda", "cpu"))
    np.testing.assert_allclose(cuda.extra, cpu.extra, atol=4 / 255)
    np.testing.assert_allclose(cuda.depth, cpu.depth, atol=4 / 255)
    ones = np.ones_like(cuda.extra)
    a, b = (render_backward(out, None, d_extra=ones) for out in (cuda, cpu))
    assert _cosine(a.extra, b.extra) > 0.9999
    assert _cosine(a.means, b.means) > 0.9999
