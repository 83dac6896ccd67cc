"""Gradients of the CPU rasteriser against finite differences; float32 against float64.

A difference along one random direction per input costs two images, so all six inputs of all 1,000
draws are tested, each by itself: a sum over inputs would let a large gradient hide a small one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from render_reference import render_reference

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Gradients, Rendered, render, render_backward

Array = NDArray[np.float64]
Damage = Callable[[str, Array], Array]
pytestmark = pytest.mark.usefixtures("one_numba_thread")
INPUTS = ("means", "quats", "scales", "opacities", "colors", "extra")
IMAGES = ("color", "alpha", "depth", "extra")
DRAWS = 1000
TOLERANCE = 1e-6  # of the gradient along the direction, summed in squares over its elements
# Relative to an input's natural size. Truncation grows with the step's square, roundoff with its
# inverse; both stay below a tenth of the tolerance. The second step is for a jump near the first.
STEPS = (1e-6, 1e-7)
FLOOR = 1e-3  # a loss of about 10, rounded at 1e-15 over a step of 1e-6, shows no slope below 1e-9


@dataclass(frozen=True)
class Kind:
    """How the Gaussians of a draw are chosen; lengths in pixels, so that all depths look alike."""

    count: int = 6
    size: tuple[int, int] = (12, 40)  # image sides: multiples of no tile side
    depth: tuple[float, float] = (1.0, 2.0)
    reach: float = 0.1  # of the image's side outside it
    sigma: float = 2.5
    thin: tuple[float, float] = (0.3, 3.0)  # the second and third axis over the first
    opacity: tuple[float, float] = (0.05, 0.98)


KINDS = {
    "mixed": Kind(),
    "near": Kind(depth=(0.011, 0.05)),  # the near plane is at 0.01
    "offscreen": Kind(reach=1.5, sigma=12.0),  # past the frozen Jacobian at 0.15 of the side
    "needle": Kind(sigma=12.0, thin=(1e-6, 1e-4)),
    "disc": Kind(sigma=4.0, thin=(1e-3, 1.0)),  # what a fit to surfaces consists of
    "covered": Kind(sigma=60.0, opacity=(0.9, 1.0)),  # clamped alpha, pixels that stop
    "opaque": Kind(opacity=(0.97, 1.0)),  # the clamp's border is inside the image
    "faint": Kind(opacity=(0.0045, 0.03)),  # the border at 1 / 255 is near every centre
    "crowd": Kind(count=60, size=(33, 66)),  # several tiles in both directions
    "pixel": Kind(size=(1, 4)),
}


@dataclass(frozen=True)
class Draw:
    """Gaussians, a camera and the weights of a linear loss over all images."""

    inputs: dict[str, Array]
    view: Array
    K: Array
    size: tuple[int, int]
    background: Array
    weights: dict[str, Array]

    def with_inputs(self, **inputs: Array) -> Draw:
        return replace(self, inputs={**self.inputs, **inputs})

    def cast(self, dtype: type[np.floating]) -> Draw:
        return self.with_inputs(**{k: a.astype(dtype) for k, a in self.inputs.items()})

    def render(self) -> Rendered:
        v = self.inputs
        return render(Splats(*(v[k] for k in INPUTS[:-1])), Camera(self.view, self.K, *self.size),
                      extra=v["extra"], background=self.background)

    def backward(self, rendered: Rendered) -> Gradients:
        w = self.weights
        return render_backward(rendered, w["color"], w["alpha"], w["depth"], w["extra"])

    def direction(self, name: str, seed: int) -> Array:
        """Draw a change of an input in its natural size: a few pixels, a factor, or 1."""
        noise: Array = np.random.default_rng(seed).normal(size=self.inputs[name].shape)
        if name == "means":
            z: Array = self.inputs[name] @ self.view[2, :3] + self.view[2, 3]
            return 0.1 * z[:, None] * noise
        return noise * self.inputs[name] if name == "scales" else noise

    def slope(self, name: str, direction: Array) -> float:
        """Central difference of the loss; images are subtracted before the loss rounds them."""
        up, down = (self.with_inputs(**{name: self.inputs[name] + sign * direction}).render()
                    for sign in (1, -1))
        return 0.5 * sum(float(np.sum((getattr(up, k) - getattr(down, k)) * self.weights[k]))
                         for k in IMAGES)


def rotation(rng: np.random.Generator) -> Array:
    q: Array = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return np.asarray(q * np.linalg.det(q))  # no mirror


def weights(rng: np.random.Generator, width: int, height: int) -> dict[str, Array]:
    shape = (height, width)
    return {"color": rng.normal(size=(*shape, 3)), "alpha": rng.normal(size=shape),
            "depth": rng.normal(size=shape), "extra": rng.normal(size=(*shape, 2))}


def draw(kind: Kind, seed: int) -> Draw:
    """Draw a camera anywhere and Gaussians in front of it."""
    rng = np.random.default_rng(seed)
    n, (width, height) = kind.count, rng.integers(*kind.size, 2)
    focal = rng.uniform(0.7, 1.5, 2) * max(int(width), int(height), 15)
    center = rng.uniform(0.3, 0.7, 2) * (width, height)
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = rotation(rng), rng.normal(size=3)
    z = rng.uniform(*kind.depth, n)
    places = rng.uniform(-kind.reach, 1 + kind.reach, (n, 2)) * (width, height)
    points = np.column_stack([(places - center) / focal * z[:, None], z])
    longest = kind.sigma * z / focal.mean() * np.exp(rng.normal(0, 0.5, n))
    low, high = np.log(kind.thin)
    thin = np.exp(rng.uniform(low, high, (n, 2)))
    inputs = {
        "means": (points - view[:3, 3]) @ view[:3, :3], "quats": rng.normal(size=(n, 4)),
        "scales": np.column_stack([longest, longest[:, None] * thin]),
        "opacities": rng.uniform(*kind.opacity, n), "colors": rng.uniform(0, 1, (n, 3)),
        "extra": rng.normal(size=(n, 2))}
    K = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1.0]])
    return Draw(inputs, view, K, (int(width), int(height)), rng.uniform(0, 1, 3),
                weights(rng, width, height))


def difference_error(d: Draw, name: str, gradient: Array, seed: int) -> float:
    """Error of one input's gradient along a random direction, better of two steps."""
    direction = d.direction(name, seed)
    scale = max(float(np.linalg.norm(gradient * direction)), FLOOR)
    best = np.inf
    for step in STEPS:
        slope = d.slope(name, step * direction) / step
        best = min(best, abs(slope - float(np.sum(gradient * direction))) / scale)
        if best < TOLERANCE:
            break
    return best


def gradient_errors(kind: Kind, seed: int, damage: Damage = lambda _, g: g
                    ) -> tuple[dict[str, float], int]:
    """Error of every input's gradient, best of three points close to each other; points needed.

    The image jumps where alpha crosses 1/255, a pixel stops or two Gaussians change places. A jump
    spoils the difference at one point; a wrong gradient disagrees at every point.
    """
    errors, first = dict.fromkeys(INPUTS, np.inf), draw(kind, seed)
    for attempt in range(3):
        d = first.with_inputs(**{k: first.inputs[k] + 1e-4 * attempt * first.direction(k, attempt)
                                 for k in INPUTS})
        gradients = d.backward(d.render())
        for name in INPUTS:
            if errors[name] >= TOLERANCE:
                gradient = damage(name, getattr(gradients, name))
                errors[name] = min(errors[name], difference_error(d, name, gradient, seed))
        if max(errors.values()) < TOLERANCE:
            break
    return errors, attempt + 1


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_equal_finite_differences(kind: str) -> None:
    draws = DRAWS // len(KINDS)
    moved = 0
    for seed in range(draws):
        errors, points = gradient_errors(KINDS[kind], seed)
        assert max(errors.values()) < TOLERANCE, (kind, seed, errors)
        moved += points > 1
    # Steps of 1e-6 meet a jump in up to 2 % of the draws; a gradient wrong in some draws only
    # must not pass as one.
    assert moved <= 0.05 * draws


def flip_one(gradient: Array) -> Array:
    """Change the sign of the element of median size."""
    flipped = gradient.copy()
    flipped.flat[np.argsort(np.abs(gradient), axis=None)[gradient.size // 2]] *= -1
    return flipped


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("change", [lambda g: g * 1.00001, flip_one], ids=["scaled", "flipped"])
def test_wrong_gradient_fails_the_difference_test(change: Callable[[Array], Array],
                                                  name: str) -> None:
    def damage(which: str, gradient: Array) -> Array:
        return change(gradient) if which == name else gradient

    errors = [gradient_errors(KINDS["mixed"], seed, damage)[0][name] for seed in range(20)]
    # A random slope is a normal number times the norm: below a tenth of it in 8 % of the draws.
    assert sum(error >= TOLERANCE for error in errors) >= 15


SCENES = {
    "cloud": Kind(3000, (64, 129), (1, 3), sigma=1.5),
    "surface": Kind(5000, (64, 129), (1.5, 2), sigma=1.5, thin=(0.02, 1.0), opacity=(0.6, 0.99)),
    "start": Kind(2000, (64, 129), (1, 3), sigma=4, opacity=(0.1, 0.101)),  # of a fit
}


def rounded(d: Draw) -> Draw:
    """Float64 inputs that float32 holds exactly, so that only the arithmetic is compared."""
    return d.cast(np.float32).cast(np.float64)


def box_scene(toy: SimpleNamespace) -> Draw:
    """Two boxes of flat, nearly opaque Gaussians: what a fit ends with, 128 pixels wide."""
    boxes = [toy.Box((0, 0, 0), (0.8, 0.6, 0.25)), toy.Box((0.05, 0.1, 0.25), (0.4, 0.5, 0.5), 2)]
    g, _ = toy.gaussians_of(boxes, 0.02)
    Ks, views = toy.cameras(3, 128, np.array([0.4, 0.3, 0.25]), 1.0)
    rng = np.random.default_rng(0)
    inputs = {"means": g.means, "quats": g.quats, "scales": g.scales, "opacities": g.opacities,
              "colors": g.colors, "extra": rng.normal(size=(len(g.means), 2))}
    return Draw(inputs, views[1], Ks[1], (128, 128), rng.uniform(0, 1, 3), weights(rng, 128, 128))


def scenes(toy: SimpleNamespace, name: str) -> list[Draw]:
    drawn = [box_scene(toy)] if name == "boxes" else [draw(SCENES[name], s) for s in range(3)]
    return [rounded(d) for d in drawn]


def cosine(a: Array, b: Array) -> float:
    a, b = a.astype(np.float64), b.astype(np.float64)
    return float(np.sum(a * b) / (np.linalg.norm(a) * np.linalg.norm(b)))


@pytest.mark.parametrize("name", [*SCENES, "boxes"])
def test_float32_equals_float64(toy: SimpleNamespace, name: str) -> None:
    for truth in scenes(toy, name):
        fast = truth.cast(np.float32)
        image, expected = fast.render(), truth.render()
        assert np.count_nonzero(expected.visible) > 1000
        for k in IMAGES:
            error = np.abs(getattr(image, k) - getattr(expected, k)).reshape(image.alpha.size, -1)
            # One alpha in 1e6 rounds across 1/255: a pixel or two may miss that Gaussian, whose
            # values, and those of what it hides, are at most `largest`.
            largest = max(3.0, float(np.abs(truth.inputs["extra"]).max()))  # 3: the depth
            assert np.count_nonzero(error.max(axis=1) > 1e-3) <= 2, k
            assert error.max() < 1e-3 + 2 * largest / 255, k
        gradients, exact = fast.backward(image), truth.backward(expected)
        for k in INPUTS:
            assert getattr(gradients, k).dtype == np.float32
            assert cosine(getattr(gradients, k), getattr(exact, k)) > 0.9999, k


def test_many_gaussians_equal_the_reference() -> None:
    d = draw(Kind(600, (60, 64), (1, 3), sigma=2.5), 0)
    t = {k: torch.tensor(a, requires_grad=True) for k, a in d.inputs.items()}
    truth = render_reference(t["means"], t["quats"], t["scales"], t["opacities"], t["colors"],
                             torch.tensor(d.view), torch.tensor(d.K), *d.size, extra=t["extra"],
                             background=torch.tensor(d.background))
    loss = torch.stack([(getattr(truth, k) * torch.tensor(d.weights[k])).sum() for k in IMAGES])
    slopes = dict(zip(t, torch.autograd.grad(loss.sum(), list(t.values())), strict=True))
    rendered = d.render()
    gradients = d.backward(rendered)
    # Sums of 600 terms in another order, and 1 / (1 - alpha) <= 100 on the smallest of them.
    for k in (*IMAGES, "median_depth"):
        np.testing.assert_allclose(getattr(rendered, k), getattr(truth, k).detach().numpy(),
                                   rtol=0, atol=1e-10)
    for k in INPUTS:
        error = np.linalg.norm(getattr(gradients, k) - slopes[k].numpy())
        assert error <= 1e-9 * np.linalg.norm(slopes[k].numpy()), k
