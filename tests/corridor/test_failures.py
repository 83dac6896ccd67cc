"""The optimiser without a gradient stays put and says so; with a NaN it stops and says where."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from image_measures import ssim
from synth_photos import write_ball_scene

from part2gs_robotics.build import build
from part2gs_robotics.config import ArticulateConfig, resolve
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.fit import fit_state as fit
from part2gs_robotics.fit.depth_smooth import smooth_term
from part2gs_robotics.fit.fit_state import FitConfig, FitRun, fit_state
from part2gs_robotics.fit.image_loss import photometric
from part2gs_robotics.fit.tones import tones_of
from part2gs_robotics.joints.align import AlignmentProblem, align
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.paper.pull import physical_steps
from part2gs_robotics.search.choose_kind import choose_joint

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")
CONFIG = FitConfig(steps=12, half_steps=2, start_gaussians=100, max_gaussians=200,
                   hull_resolution=24)
LEVELS = pytest.mark.parametrize("level", [0, 1, 128, 255])


@pytest.fixture(scope="module")
def photos(toy):
    """Eight small photos of a box, without depth images."""
    state = toy.cast([toy.Box((0, 0, 0), (0.4, 0.4, 0.4), 1)],
                     *toy.cameras(8, 24, np.full(3, 0.2), 0.8), 24)
    return replace(state, depths=None)


@LEVELS
def test_one_color_fits_to_that_color(photos, level):
    state = replace(photos, images=np.full_like(photos.images, level))
    found = fit_state(state, config=CONFIG).gaussians
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh0"):
        assert np.isfinite(getattr(found, name)).all()
    # The even tones stretch a single tone by up to five: one step of 2e-2 is 1.4 levels of them.
    np.testing.assert_allclose(np.median(found.colors, axis=0), level / 255, atol=0.03)


@LEVELS
def test_tones_of_one_color_rise_and_come_back(photos, level):
    tones = tones_of(replace(photos, images=np.full_like(photos.images, level)))
    assert (np.diff(tones.curve) > 0).all()
    assert tones.curve[0] == 0
    assert tones.curve[-1] == 1
    colors = np.linspace(0, 1, 50)
    there = np.interp(colors, np.arange(256) / 255, tones.curve)
    np.testing.assert_allclose(np.interp(there, tones.curve, np.arange(256) / 255), colors,
                               atol=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("color", [0.0, 0.5, 1.0, 17.0])  # 17: as bright as 3000 steps can make it
def test_losses_of_one_color_are_finite_and_known(color, dtype):
    same, other = (np.full((20, 21, 3), c, dtype) for c in (color, color + 0.25))
    loss, grad = photometric(same, same)
    assert abs(loss) < 1e-3 * max(1.0, color)  # float32: 2e-6 * color^2 over C2 = 9e-4
    assert np.isfinite(grad).all()
    loss, grad = photometric(other, same, 0.0)
    assert loss == pytest.approx(0.25, rel=1e-5)
    np.testing.assert_allclose(grad, 1 / grad.size, rtol=1e-5)
    if color <= 1:
        assert ssim(same, same) == pytest.approx(1.0, abs=1e-3)
    flat = SimpleNamespace(depth=np.full((20, 21), 2, dtype), alpha=np.ones((20, 21), dtype))
    loss, by_depth, by_alpha = smooth_term(flat, same, flat.alpha, 1.5, 1.0)
    assert loss == pytest.approx(0.0, abs=1e-9)
    assert not by_depth.any()
    assert not by_alpha.any()


def wall_views(color):
    """Three photos filled by a wall of one colour: neither an edge nor a rim in sight."""
    eyes = np.tile(np.eye(4), (3, 1, 1))
    eyes[:, 2, 3] = [1.0, 1.2, 1.4]
    K = np.array([[40.0, 0, 16], [0, 40, 16], [0, 0, 1]])
    return SmallViews(np.full((3, 32, 32, 3), color, np.float32), np.ones((3, 32, 32), np.float32),
                      np.tile(K, (3, 1, 1)), eyes)


def wall():
    """One Gaussian much larger than all that a camera sees."""
    f32 = np.float32
    return Gaussians(np.zeros((1, 3), f32), np.array([[1, 0, 0, 0]], f32),
                     np.log([[1e4, 1e4, 1e-3]]).astype(f32), np.full(1, 9, f32),
                     np.zeros((1, 3), f32), np.zeros((1, 0, 3), f32))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("seen", ["the same colour", "another colour", "nothing of the part"])
def test_without_a_gradient_a_joint_stays_and_is_known_badly(kind, seen):
    joint = Joint(kind, np.array([0.6, 0, 0.8]), np.array([0.1, 0.2, 0.0]), 0.3)
    views = wall_views(0.495 if seen == "the same colour" else 0.8)
    label = np.zeros(1, np.int64) if seen == "nothing of the part" else np.ones(1, np.int64)
    found, = align(AlignmentProblem((wall(), wall()), (label, label), (views, views), 1.0), [joint])
    np.testing.assert_allclose(found.axis, joint.axis, atol=1e-4)
    np.testing.assert_allclose(found.origin, joint.origin, atol=1e-4)
    assert found.value == pytest.approx(joint.value, abs=1e-4)
    # A uniform value over a whole turn or two diagonals has a deviation of 1.8 rad or 0.6.
    assert found.sigma_axis > 1.8
    assert found.sigma_value > 1.8
    assert kind == "prismatic" or found.sigma_origin > 0.6


def test_a_knob_that_turns_about_its_own_centre_has_a_kind(slid):
    ring = np.stack([np.cos(np.arange(40) * np.pi / 20), np.sin(np.arange(40) * np.pi / 20),
                     np.zeros(40)], 1)
    own = Surfels(np.concatenate([0.1 * ring, -0.1 * ring]), np.tile([0.0, 0, 1], (80, 1)),
                  np.full((80, 3), 0.5), np.full(80, 5))
    none = own.select(np.zeros(0, np.int64))
    lands = slid.states[0].land, slid.states[1].land
    for value in (0.8, np.pi):
        knob = Joint("revolute", np.array([0.0, 0, 1]), own.points.mean(0), value)
        joint = choose_joint(knob, (own, none), lands, 0.03, 1.4, 0.5)
        assert joint.kind == "revolute"
        assert joint.value == pytest.approx(value)
        assert np.isfinite([*joint.bic.values()]).all()
    still = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.0)
    joint = choose_joint(still, (own, none), lands, 0.03, 1.4, 0.5)
    assert np.isfinite([*joint.axis, *joint.origin, joint.value, *joint.bic.values()]).all()


@pytest.mark.parametrize("name", ["means", "quats", "log_scales", "logit_opacities", "sh0"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_bad_parameter_is_named(photos, name, bad):
    run = FitRun(photos, tones_of(photos), start(photos), None, CONFIG, "state 1")
    run.step(1)
    run.params[name].reshape(-1)[7] = bad
    size = run.params[name].size
    with pytest.raises(FitError, match=f"^state 1, step 2: 1 of {size} values of '{name}' are"):
        run.step(2)


def start(photos):
    """Small Gaussians over the box of the photos."""
    rng, f32 = np.random.default_rng(0), np.float32
    return Gaussians(rng.uniform(0, 0.4, (60, 3)).astype(f32), rng.normal(size=(60, 4)).astype(f32),
                     np.full((60, 3), -3, f32), np.zeros(60, f32), np.zeros((60, 3), f32),
                     np.zeros((60, 0, 3), f32))


def test_a_bad_gradient_and_a_bad_image_are_named(photos, monkeypatch):
    true = fit.render_backward, fit.draw
    run = FitRun(photos, tones_of(photos), start(photos), None, CONFIG, "state 0")

    def torn(*args):
        found = true[0](*args)
        found.quats[3, 1] = np.nan
        return found

    def speck(*args):
        found = true[1](*args)
        found.color[5, 5, 1] = np.nan
        return found

    monkeypatch.setattr(fit, "render_backward", torn)
    with pytest.raises(FitError, match=r"state 0, step 1: 1 of 240 .*'gradient of quats'"):
        run.step(1)
    monkeypatch.setattr(fit, "render_backward", true[0])
    monkeypatch.setattr(fit, "draw", speck)
    before = run.params["means"].copy()
    with pytest.raises(FitError, match=r"state 0, step 2: 1 of 1 values of 'image'"):
        run.step(2)
    np.testing.assert_array_equal(run.params["means"], before)  # stopped before the update


def test_a_bad_point_stops_the_physical_steps():
    rng = np.random.default_rng(0)
    points = rng.random((60, 3))
    s = Surfels(points, np.tile([0.0, 0, 1], (60, 1)), np.full((60, 3), 0.5), np.full(60, 5))
    study = SimpleNamespace(surfels=(s, s), diag=1.5, tau=0.02)
    hard = np.tile(np.repeat([0, 1], 30), 2)
    joint = Joint("revolute", np.array([0.0, 0, 1]), np.zeros(3), np.nan)
    with pytest.raises(FitError, match="part 1, step 1: 1 of 7 values of 'joint'"):
        physical_steps(study, [joint], hard, ArticulateConfig())
    study.tau = np.nan
    with pytest.raises(FitError, match=r"part 1, step 1: .*'vector field and contact'"):
        physical_steps(study, [replace(joint, value=0.1)], hard, ArticulateConfig())


def test_a_nan_stops_the_build_and_the_last_good_result_is_named(tmp_path, monkeypatch):
    scene = write_ball_scene(tmp_path / "scene", views=24, side=32)
    out = tmp_path / "out"
    config = resolve({"preset": "draft", "steps": 3, "half_steps": 1, "start_gaussians": 300,
                      "hull_resolution": 32, "out": str(out), "quiet": True, "device": "cpu"})
    true, sick = FitRun.step, ["state 0"]

    def step(self, number):
        if self.name in sick and number == 2:
            self.params["means"][0] = np.nan
        true(self, number)

    monkeypatch.setattr(FitRun, "step", step)
    with pytest.raises(FitError, match=r"fit_0: state 0, step 2: 3 of .* No stage was finished"):
        build(scene, config)
    sick[:] = ["state 1"]
    for _ in range(2):  # the second time fit_0 is loaded
        with pytest.raises(FitError, match=r"fit_1: state 1, step 2: 3 of \d+ values of 'means'"
                                           r".*01_fit_0; the same command") as caught:
            build(scene, config)
    kept = Path(str(caught.value).split("Last good result: ")[1].split(";")[0])
    assert json.loads((kept / "manifest.json").read_text())["key"]
    assert not (out / "stages" / "02_fit_1").exists()
    events = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [e["resumed"] for e in events if e.get("stage") == "fit_0"] == [False, True]
    assert not list(out.rglob("*.tmp-*"))


def test_a_state_whose_gaussians_show_nothing_is_named(toy, photos):
    gone = replace(start(photos), means=start(photos).means + np.float32(1e6))
    scene = Scene(Path("toy"), "toy", (photos, photos))
    with pytest.raises(FitError, match="state 0: the fitted Gaussians show no surface"):
        toy.study_of(scene, (gone, gone))
