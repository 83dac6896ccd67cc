"""No answer of a room depends on the unit or the place; what is drawn, through the frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.landing import build_landing
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.fit.fit_state import FitConfig, FitRun
from part2gs_robotics.fit.hull import carve
from part2gs_robotics.fit.tones import tones_of
from part2gs_robotics.joints.align import FINE, AlignmentProblem, align
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.scene_frame import frame_of, internal, joint_in_scene
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.paper.identity import refine_identities
from part2gs_robotics.paper.pull import part_diagnostics, physical_steps
from part2gs_robotics.search.choose_kind import choose_joint
from part2gs_robotics.search.patches import Aim, search_patch
from part2gs_robotics.search.refine import refine

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")
SCALES = pytest.mark.parametrize("scale", [1e-3, 1e3])
TURN = se3.rotation_from_rotvec(np.array([0.7, -1.1, 0.4]))
SHIFT = np.array([3.0, -2.0, 5.0])
CLOSE = 1e-4  # relative, what the answers may change by


def world_of(scale, rigid):
    return se3.make(TURN, scale * SHIFT) if rigid else np.eye(4)


def placed(points, scale, move):
    return se3.apply(move, scale * np.asarray(points, float))


def cameras_placed(viewmats, scale, move):
    scaled = viewmats.copy()
    scaled[:, :3, 3] *= scale
    return scaled @ se3.inverse(move)


def seen_through_the_frame(states, scale, move):
    """Return the frame of placed photos, the photos, the scale and the move inside it."""
    scene = Scene(Path("toy"), "toy", tuple(
        replace(s, viewmats=cameras_placed(s.viewmats, scale, move),
                depths=None if s.depths is None else s.depths * np.float32(scale)) for s in states))
    frame = frame_of(scene)
    inside = se3.make(move[:3, :3], (move[:3, 3] - frame.centre) / frame.unit)
    return frame, internal(scene, frame).states, scale / frame.unit, inside


def surfels_placed(s, scale, move):
    return Surfels(placed(s.points, scale, move), s.normals @ move[:3, :3].T, s.colors, s.views)


def gaussians_placed(g, scale, move):
    quats = se3.quat_multiply(se3.quat_from_rotation(move[:3, :3]), g.quats)
    return replace(g, means=placed(g.means, scale, move).astype(np.float32),
                   quats=quats.astype(np.float32),
                   log_scales=g.log_scales + np.float32(np.log(scale)))


def joint_placed(j, scale, move):
    return replace(j, axis=move[:3, :3] @ j.axis, origin=placed(j.origin, scale, move),
                   value=j.value * (scale if j.kind == "prismatic" else 1.0))


def assert_same_joint(found, expected, scale, at):
    """Compare two joints: axis, value, and where the axis passes a point of the part."""
    np.testing.assert_allclose(found.axis, expected.axis, atol=CLOSE)
    assert found.value == pytest.approx(expected.value, rel=CLOSE)
    if expected.kind == "revolute":
        gaps = [np.cross(at - j.origin, j.axis) for j in (found, expected)]
        np.testing.assert_allclose(gaps[0] / scale, gaps[1] / scale, atol=2 * CLOSE)
    assert found.bic == pytest.approx(expected.bic, rel=1e-3)
    # Deviations are estimated on patches of a grid that does not turn with the world.
    assert found.sigma_axis == pytest.approx(expected.sigma_axis, rel=0.2, nan_ok=True)


def scaled_world(world, scale):
    """The surfels of both states and their landing grids in another unit."""
    lands, sets = [], []
    for seen in world.states:
        maps = DepthMaps(seen.maps.depths * np.float32(scale), seen.maps.alphas, seen.maps.Ks,
                         cameras_placed(seen.maps.viewmats, scale, np.eye(4)))
        s = surfels_placed(seen.surfels, scale, np.eye(4))
        box = np.full(3, -0.8 * scale), np.full(3, 1.5 * scale)
        lands.append(build_landing(s, np.zeros(len(s)), maps, box, 0.02 * scale, 0.1 * scale))
        lo, hi = np.array(world.block.lo) - 0.005, np.array(world.block.hi) + 0.005
        sets.append(s.select(((s.points > scale * lo) & (s.points < scale * hi)).all(1)))
    return (sets[0], sets[1]), (lands[0], lands[1])


def guess_of(world, scale):
    if hasattr(world, "origin"):
        return Joint("revolute", world.axis, scale * (world.origin + 0.01), world.value * 1.03)
    return Joint("prismatic", world.axis, scale * np.full(3, 0.3), scale * world.value * 1.03)


@pytest.mark.parametrize("name", ["slid", "turned"])
def test_search_refinement_and_choice_do_not_know_the_unit(name, request):
    world = request.getfixturevalue(name)
    found = []
    for unit in (1.0, 1e-3, 1e3):
        own, lands = scaled_world(world, unit)
        fine = refine(guess_of(world, unit), own, lands, (0.05 * unit, 0.03 * unit), 3)
        joint = choose_joint(guess_of(world, unit), own, lands, 0.03 * unit, 1.4 * unit, 0.5)
        patch = own[0].select(np.arange(0, len(own[0]), len(own[0]) // 20))
        box = np.full(3, -0.1 * unit), np.full(3, 0.9 * unit)
        aim = Aim(lands[1], box, 1.7 * unit, 0.05 * unit, True)
        best = search_patch(patch, aim, np.eye(3)[[0, 2]], keep=3)
        length = 1.0 if fine.turns else unit
        found.append((unit, joint, fine.axis, fine.value / length, [cost for cost, _ in best]))
    for unit, joint, *rest in found[1:]:
        assert_same_joint(joint, joint_placed(found[0][1], unit, np.eye(4)), unit, np.zeros(3))
        for got, expected in zip(rest, found[0][2:], strict=True):
            np.testing.assert_allclose(got, expected, atol=CLOSE)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_alignment_does_not_know_unit_or_place(toy, scale, rigid):
    truth = Joint("revolute", np.array([0.0, 0, -1]), np.array([0.0, -0.05, 0.3]), 0.8)
    boxes = [toy.Box((0, 0, 0), (0.8, 0.5, 0.6), 1), toy.Box((0, -0.05, 0), (0.8, -0.02, 0.6), 2)]
    states = [boxes, [boxes[0], replace(boxes[1], move=truth.state1_from_0)]]
    (g0, labels), (g1, _) = (toy.gaussians_of(b, 0.08) for b in states)
    Ks, eyes = toy.cameras(4, 64, np.array([0.4, 0.1, 0.3]), 1.3)
    photos = [toy.drawn(g, Ks, eyes, 64) for g in (g0, g1)]
    start = replace(truth, value=0.78, origin=truth.origin + 0.01)
    joints = []
    for world in ((1.0, np.eye(4)), (scale, world_of(scale, rigid))):
        frame, seen, *inside = seen_through_the_frame(photos, *world)
        views = tuple(SmallViews(p.images.astype(np.float32) / 255, p.alphas / np.float32(255), Ks,
                                 p.viewmats) for p in seen)
        both = tuple(gaussians_placed(g, *inside) for g in (g0, g1))
        problem = AlignmentProblem(both, (labels, labels), views, 1.2 * inside[0])
        found = align(problem, [joint_placed(start, *inside)], FINE)
        joints += [joint_in_scene(joint, frame) for joint in found]
    expected = joint_placed(joints[0], scale, world_of(scale, rigid))
    at = placed(truth.origin, scale, world_of(scale, rigid))
    assert_same_joint(joints[1], expected, scale, at)
    assert joints[0].value != pytest.approx(0.78, abs=1e-3)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_field_and_identities_do_not_know_unit_or_place(toy, load, scale, rigid):
    boxes = [toy.Box((0, 0, 0), (0.8, 0.5, 0.6), 1), toy.Box((0, -0.1, 0), (0.8, -0.02, 0.6), 2)]
    joint = Joint("prismatic", np.array([0.0, -1, 0]), np.zeros(3), 0.3)
    pair = [toy.gaussians_of(b, 0.07)[0] for b in (
        boxes, [boxes[0], replace(boxes[1], move=joint.state1_from_0)])]
    rng, found = np.random.default_rng(0), []
    for g in pair:  # on a regular grid neighbours tie, and rounding picks among them
        g.means[:] += 0.01 * rng.normal(size=g.means.shape).astype(np.float32)
    costs = rng.random((len(pair[0]), 2)), rng.random((len(pair[1]), 2))
    for unit, move in ((1.0, np.eye(4)), (scale, world_of(scale, rigid))):
        both = gaussians_placed(pair[0], unit, move), gaussians_placed(pair[1], unit, move)
        field = load("averaged_field").canonical_field(*both, num_matches=50)
        probs = refine_identities(*costs, both, [joint_placed(joint, unit, move)])
        found.append((np.array(field.richness) / unit, field.richness_weight, probs))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=CLOSE)
    assert found[1][1] == pytest.approx(found[0][1], rel=CLOSE)
    for a, b in zip(found[0][2], found[1][2], strict=True):
        np.testing.assert_allclose(b, a, atol=CLOSE)


@SCALES
def test_physical_steps_do_not_know_the_unit(scale):
    rng, joints, rows = np.random.default_rng(0), [], []
    floor, low = rng.random((400, 3)) * [1, 1, 0.0], rng.random((300, 3)) * [0.5, 0.4, 0.01]
    low += [0.2, 0.2, -0.022]  # a little inside the floor, and often beside its few points
    for unit in (1.0, scale):
        states = [Surfels(unit * np.concatenate([floor, low + up]), np.tile([0.0, 0, 1], (700, 1)),
                          np.full((700, 3), 0.5), np.full(700, 5)) for up in (0, [0, 0, 0.3])]
        study = SimpleNamespace(surfels=states, diag=1.5 * unit, tau=0.02 * unit)
        hard = np.tile(np.repeat([0, 1], [400, 300]), 2)
        start = Joint("prismatic", np.array([0.02, 0, 1.0]) / 1.0002**0.5, np.zeros(3), 0.29 * unit)
        joints += physical_steps(study, [start], hard, ArticulateConfig())
        rows += part_diagnostics(study, joints[-1:], hard, False)[0]
    assert_same_joint(joints[1], joint_placed(joints[0], scale, np.eye(4)), scale, np.zeros(3))
    powers = {"contact_loss": 2, "velocity_loss": 2, "motion_residual": 1, "repel_gradient": 1}
    assert rows[0]["repel_gradient"] != 0
    assert rows[0]["contact_loss"] > 0
    for name, value in rows[0].items():
        expected = value * scale ** powers.get(name, 0)
        assert rows[1][name] == pytest.approx(expected, rel=1e-3, abs=1e-12), name


@pytest.fixture(scope="module")
def photos(toy):
    return toy.cast([toy.Box((0, 0, 0), (0.4, 0.4, 0.4), 1)],
                    *toy.cameras(8, 32, np.full(3, 0.2), 0.8), 32)


@SCALES
def test_hulls_do_not_know_the_unit(photos, scale):
    one = carve(photos, resolution=24)
    eyes = cameras_placed(photos.viewmats, scale, np.eye(4))
    two = carve(replace(photos, viewmats=eyes), resolution=24)
    np.testing.assert_allclose(two.lo / scale, one.lo, atol=CLOSE)
    assert two.voxel / scale == pytest.approx(one.voxel, rel=CLOSE)
    np.testing.assert_allclose(two.values / scale, one.values, atol=CLOSE * one.voxel)


@pytest.mark.parametrize("rigid", [False, True])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_step_of_the_fit_does_not_know_unit_or_place(toy, photos, scale, rigid):
    first, _ = toy.gaussians_of([toy.Box((0.02, 0, 0), (0.4, 0.38, 0.4), 3)], 0.05)
    config = FitConfig(steps=4, half_steps=0)
    moments = []
    for world in ((1.0, np.eye(4)), (scale, world_of(scale, rigid))):
        _, (state, _), unit, move = seen_through_the_frame((photos, photos), *world)
        run = FitRun(state, tones_of(state), gaussians_placed(first, unit, move), None, config, "s")
        run.diagonal = 0.7 * unit  # the box of the centres turns with the world, the hull's not
        run.step(1)
        grads = {name: value.copy() for name, value in run.adam.first.items()}
        grads["means"] = grads["means"] @ move[:3, :3]
        moments.append(grads)
    for name in ("means", "log_scales", "logit_opacities", "sh0"):
        size = np.abs(moments[0][name]).max()
        np.testing.assert_allclose(moments[1][name], moments[0][name], atol=CLOSE * size)
