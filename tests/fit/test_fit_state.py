"""The fit of one state: closed forms of Adam and of the loss terms, and small whole fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from part2gs_robotics.errors import FitError
from part2gs_robotics.fit.brightness import evened
from part2gs_robotics.fit.density import Density
from part2gs_robotics.fit.fit_state import FitConfig, fit_state
from part2gs_robotics.fit.start import quats_from_normals
from part2gs_robotics.fit.step import alpha_term, depth_term, gaussians_of, opacity_term, params_of
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.scene import Camera, StateViews
from part2gs_robotics.model.se3 import rotation_from_quats
from part2gs_robotics.render.cpu import render
from part2gs_robotics.runtime.adam import Adam, require_finite

TINY = FitConfig(steps=60, half_steps=20, start_gaussians=250, max_gaussians=400,
                 hull_resolution=32)


def ball_of_gaussians(count: int = 300) -> Gaussians:
    rng = np.random.default_rng(0)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    f32 = np.float32
    color = 0.5 + 0.4 * np.sin(4 * way)
    return Gaussians((0.5 * way).astype(f32), quats_from_normals(way).astype(f32),
                     np.log(np.tile([0.06, 0.06, 0.01], (count, 1))).astype(f32),
                     np.full(count, 4.0, f32), ((color - 0.5) / SH_C0).astype(f32),
                     np.zeros((count, 0, 3), f32))


def camera(eye: NDArray[np.float64]) -> NDArray[np.float64]:
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.1, 1.0])
    right /= np.linalg.norm(right)
    rot = np.stack([right, np.cross(forward, right), forward])
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rot, -rot @ eye
    return out


@pytest.fixture(scope="module")
def tiny() -> StateViews:
    return photos_of_ball(40)


def photos_of_ball(size: int) -> StateViews:
    views = 16
    g = ball_of_gaussians()
    intrinsics = np.array([[1.3 * size, 0, size / 2], [0, 1.3 * size, size / 2], [0, 0, 1.0]])
    images, alphas, mats, depths = [], [], [], []
    for v in range(views):
        z, turn = 1 - 2 * (v + 0.5) / views, 2.399963 * v
        root = np.sqrt(1 - z * z)
        mats.append(camera(2.2 * np.array([root * np.cos(turn), root * np.sin(turn), z])))
        drawn = render(g.splats, Camera(mats[-1], intrinsics, size, size))
        alpha = np.clip(drawn.alpha, 0, 1)
        images.append(np.clip(drawn.color / np.maximum(alpha, 1e-3)[..., None], 0, 1) * 255)
        alphas.append(alpha * 255)
        depths.append(drawn.median_depth)
    held_out = np.zeros(views, bool)
    held_out[::8] = True
    return StateViews(np.array(images).round().astype(np.uint8),
                      np.array(alphas).round().astype(np.uint8),
                      np.repeat(intrinsics[None], views, 0), np.array(mats), np.array(depths),
                      tuple(f"{v:04d}.png" for v in range(views)), held_out)


def without_depth(state: StateViews) -> StateViews:
    return replace(state, depths=None)


def test_adam_follows_its_closed_form() -> None:
    rng = np.random.default_rng(0)
    value, grads = rng.normal(size=(5, 3)), rng.normal(size=(4, 5, 3))
    params, adam = {"x": value.copy()}, Adam({"x": 0.1})
    first, second = np.zeros_like(value), np.zeros_like(value)
    for t, grad in enumerate(grads, 1):
        adam.step(params, {"x": grad})
        first, second = 0.9 * first + 0.1 * grad, 0.999 * second + 0.001 * grad**2
        value = value - 0.1 * (first / (1 - 0.9**t)) / (np.sqrt(second / (1 - 0.999**t)) + 1e-15)
    np.testing.assert_allclose(params["x"], value, rtol=1e-12)


def test_adam_updates_arrays_of_any_layout() -> None:
    rng = np.random.default_rng(0)
    value, grads = rng.normal(size=(5, 3)), rng.normal(size=(4, 5, 3))
    plain, turned = {"x": value.copy()}, {"x": np.asfortranarray(value)}
    one, two = Adam({"x": 0.1}), Adam({"x": 0.1})
    for grad in grads:
        one.step(plain, {"x": grad})
        two.step(turned, {"x": np.asfortranarray(grad)})
    np.testing.assert_array_equal(turned["x"], plain["x"])


def test_adam_rows_follow_their_gaussians() -> None:
    params, adam = {"x": np.zeros((3, 2))}, Adam({"x": 0.1})
    adam.step(params, {"x": np.array([[1.0, 2], [3, 4], [5, 6]])})
    adam.select(np.array([True, False, True]))
    adam.append(1)
    np.testing.assert_allclose(adam.first["x"], [[0.1, 0.2], [0.5, 0.6], [0, 0]])
    assert adam.second["x"].shape == (3, 2)


@pytest.mark.parametrize("term", ["opacity", "alpha"])
def test_loss_terms_match_finite_differences(term: str) -> None:
    rng = np.random.default_rng(0)
    x, target = rng.normal(size=40), rng.random(40)

    def value(x: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        return opacity_term(x, 0.7) if term == "opacity" else alpha_term(x, target, 0.7)  # type: ignore[arg-type, return-value]

    grad = value(x)[1]
    for i in range(40):
        step = np.zeros(40)
        step[i] = 1e-6
        numeric = (value(x + step)[0] - value(x - step)[0]) / 2e-6
        # The weights are float32: 6e-8 relative; differences: 1e-16 / 1e-6.
        assert numeric == pytest.approx(float(grad[i]), rel=1e-5, abs=1e-9)


def test_depth_gradient_matches_finite_differences() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(1, 2, (6, 5))
    truth[0] = 0  # without depth: no loss

    class Drawn:
        def __init__(self, depth: NDArray[np.float64], alpha: NDArray[np.float64]) -> None:
            self.depth, self.alpha = depth, alpha

    depth, alpha = rng.uniform(1, 2, (6, 5)), rng.uniform(0.6, 1, (6, 5))
    _, by_depth, by_alpha = depth_term(Drawn(depth, alpha), truth, 2.0, 1.0)  # type: ignore[arg-type]
    for grad, which in ((by_depth, 0), (by_alpha, 1)):
        move = rng.normal(size=(6, 5)) * 1e-6
        high = depth_term(Drawn(depth + move * (1 - which), alpha + move * which), truth, 2.0, 1.0)  # type: ignore[arg-type]
        low = depth_term(Drawn(depth - move * (1 - which), alpha - move * which), truth, 2.0, 1.0)  # type: ignore[arg-type]
        # The gradients come back as float32.
        assert (high[0] - low[0]) / 2 == pytest.approx(float((grad * move).sum()), rel=1e-4)


def test_discs_face_along_their_normals() -> None:
    normals = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [0.6, -0.8, 0], [0.36, 0.48, -0.8]])
    axes = rotation_from_quats(quats_from_normals(normals))[:, :, 2]
    np.testing.assert_allclose(axes, normals, atol=1e-12)


def test_split_keeps_the_cap_and_prune_drops_the_faint() -> None:
    params, adam = params_of(ball_of_gaussians(50)), Adam({})
    params["logit_opacities"][:5] = -9
    density = Density(None, 60)
    density.add(np.arange(50, dtype=np.float32), np.ones(50, bool))
    before = params["means"][-1].copy()
    params = density.change(params, adam, 60)
    assert len(params["means"]) == 45 + 11  # a quarter of 45 at most
    # The Gaussian with the largest gradient became two around its old centre.
    np.testing.assert_allclose((params["means"][44] + params["means"][-1]) / 2, before, atol=1e-6)
    full = Density(None, 50)
    full.add(np.ones(56, np.float32), np.ones(56, bool))
    assert len(full.change(params, adam, 100)["means"]) == 56


def test_fit_improves_unseen_views_and_reports_it(tiny: StateViews) -> None:
    calls: list[tuple[int, int, float]] = []
    result = fit_state(without_depth(tiny), config=TINY, progress=lambda *a: calls.append(a))
    seconds, scores, counts = zip(*result.curve, strict=True)
    assert scores[-1] > scores[0] + 1.5
    assert scores[-1] > 24
    assert list(seconds) == sorted(seconds)
    assert max(counts) <= TINY.max_gaussians
    assert [c[0] for c in calls] == list(range(1, TINY.steps + 1))
    assert result.hull is not None
    g = result.gaussians
    np.testing.assert_allclose(np.linalg.norm(g.quats, axis=1), 1, atol=1e-5)
    assert all(a.dtype == np.float32 for a in params_of(g).values())


def test_fit_is_deterministic_and_the_seed_matters(tiny: StateViews) -> None:
    short = replace(TINY, steps=12, half_steps=4)
    a, b = (fit_state(without_depth(tiny), config=short).gaussians for _ in range(2))
    for name, value in params_of(a).items():
        np.testing.assert_array_equal(value, params_of(b)[name])
    other = fit_state(without_depth(tiny), config=replace(short, seed=1)).gaussians
    assert not np.array_equal(a.means[:50], other.means[:50])


def test_depth_images_improve_depth(tiny: StateViews) -> None:
    def error(state: StateViews) -> float:
        g = fit_state(state, config=replace(TINY, depth_weight=2.0)).gaussians
        total = []
        for v in np.flatnonzero(tiny.held_out):
            drawn = render(g.splats, tiny.camera(v))
            both = (drawn.alpha > 0.9) & (tiny.alphas[v] > 230)
            assert tiny.depths is not None
            total.append(np.abs(drawn.depth / np.maximum(drawn.alpha, 0.9) - tiny.depths[v])[both])
        return float(np.concatenate(total).mean())

    assert error(tiny) < error(without_depth(tiny))


def test_fit_goes_on_from_given_gaussians(tiny: StateViews) -> None:
    result = fit_state(without_depth(tiny), ball_of_gaussians(),
                       replace(TINY, steps=4, half_steps=0))
    assert result.hull is None
    assert result.curve[0][1] > 33  # it starts at the truth; 8-bit images leave 2e-3 of error


def test_nan_stops_with_state_step_and_term(tiny: StateViews) -> None:
    broken = ball_of_gaussians()
    broken.sh0[3, 1] = np.nan
    with pytest.raises(FitError, match=r"state 1, step 1: .*NaN"):
        fit_state(without_depth(tiny), broken, replace(TINY, steps=3), name="state 1")
    with pytest.raises(FitError, match="state 0, step 7: 1 of 1 values of 'mask'"):
        require_finite({"image": 0.5, "mask": float("nan")}, "state 0", 7)


def test_parameters_survive_the_round_trip() -> None:
    g = ball_of_gaussians(20)
    back = gaussians_of(params_of(g))
    np.testing.assert_allclose(back.quats, g.quats, atol=1e-6)
    np.testing.assert_array_equal(back.means, g.means)


def test_exposure_of_every_photo_its_own_costs_a_fit_little(
        monkeypatch: pytest.MonkeyPatch) -> None:
    state = without_depth(photos_of_ball(80))
    stops = np.random.default_rng(3).choice([-0.5, 0.0, 0.5], (len(state), 1))
    taken = evened(state, 2.0**stops * np.ones(3))
    longer = replace(TINY, steps=160, half_steps=50)
    plain, made = (fit_state(one, config=longer) for one in (state, taken))
    monkeypatch.setattr("part2gs_robotics.fit.fit_state.WHEN", ())  # never looked at
    blind = fit_state(taken, config=longer)
    assert plain.gains is None
    assert made.gains is not None
    off = -np.log2(made.gains.mean(1)) - (stops - np.median(stops))[:, 0]
    assert np.sqrt(np.mean(off**2)) < 0.15  # of half a stop
    scores = [run.curve[-1][1] for run in (plain, made, blind)]
    assert scores[1] > scores[2] + 5.0  # 7.9 dB; the exposures cost 9.7 dB otherwise
