"""The kind of joint is chosen by evidence; its parameters are coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.landing import build_landing
from part2gs_robotics.joints.align_system import parameters, perturbed
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint, move_of
from part2gs_robotics.search.choose_kind import choose_joint, hinge_price
from part2gs_robotics.search.hypothesis import Hypothesis, rise_of

TAU, DIAG = 0.03, 1.4
TILT = np.array([1.0, 2, -0.5]) / np.linalg.norm([1.0, 2, -0.5])
JOINTS = [Joint("prismatic", TILT, np.array([0.1, 0.2, 0.3]), 0.4),
          Joint("revolute", TILT, np.array([0.1, 0.2, 0.3]), 1.1),
          Joint("screw", TILT, np.array([0.1, 0.2, 0.3]), 1.1, 0.2)]


@pytest.mark.parametrize("joint", JOINTS, ids=["prismatic", "revolute", "screw"])
def test_every_parameter_moves_the_part_in_its_own_way(joint):
    count = len(parameters(joint))
    assert not parameters(joint).any()
    assert np.allclose(move_of(perturbed(joint, np.zeros(count), DIAG)), move_of(joint))
    step, eye = 1e-5, np.eye(count)
    rates = np.stack([
        (move_of(perturbed(joint, step * e, DIAG)) - move_of(perturbed(joint, -step * e, DIAG)))
        / (2 * step) for e in eye])
    flat = rates[:, :3].reshape(count, -1)
    assert np.linalg.matrix_rank(flat, tol=1e-3) == count
    both = (move_of(perturbed(joint, step * (eye[0] + eye[2]), DIAG)) - move_of(joint)) / step
    assert np.allclose(both, rates[0] + rates[2], atol=1e-3)  # linear to first order


@pytest.mark.parametrize("joint", JOINTS, ids=["prismatic", "revolute", "screw"])
def test_tilts_are_radians_across_the_axis_and_offsets_diagonals(joint):
    for i in (0, 1):
        tilted = perturbed(joint, 1e-4 * np.eye(len(parameters(joint)))[i], DIAG)
        assert np.arccos(np.clip(tilted.axis @ joint.axis, -1, 1)) == pytest.approx(1e-4, rel=1e-3)
    value = perturbed(joint, 0.01 * np.eye(len(parameters(joint)))[2], DIAG).value - joint.value
    assert value == pytest.approx(0.01 * DIAG if joint.kind == "prismatic" else 0.01)
    if joint.kind != "prismatic":
        for i in (3, 4):
            step = 0.01 * np.eye(len(parameters(joint)))[i]
            shift = perturbed(joint, step, DIAG).origin - joint.origin
            assert np.linalg.norm(shift) == pytest.approx(0.01 * DIAG)
            assert shift @ joint.axis == pytest.approx(0.0, abs=1e-12)


def test_a_screw_turned_further_rises_as_far_and_its_rise_is_a_length():
    joint = JOINTS[2]
    for i, more in ((2, 0.0), (5, 0.01 * DIAG)):
        new = perturbed(joint, 0.01 * np.eye(6)[i], DIAG)
        assert rise_of(new) == pytest.approx(rise_of(joint) + more)


def noisy(world, sigma, seed):
    """Surfels of the part and landing grids with points displaced along their normals."""
    rng = np.random.default_rng(seed)
    hinge = hasattr(world, "origin")
    pitch = getattr(world, "pitch", 0.0)
    truth = (Hypothesis(2 if pitch else 1, world.axis, world.origin, world.value, None, pitch)
             if hinge else Hypothesis(0, world.axis, np.array([0.2, 0.3, 0.4]), world.value))
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    own, lands = [], []
    for state, back in ((0, np.eye(4)), (1, se3.inverse(truth.move))):
        seen = world.states[state]
        points = se3.apply(back, seen.surfels.points)
        mine = ((points > lo - 0.005) & (points < hi + 0.005)).all(1)
        off = rng.normal(scale=sigma, size=(len(points), 1)) * seen.surfels.normals
        s = replace(seen.surfels, points=seen.surfels.points + off)
        own.append(s.select(mine))
        lands.append(build_landing(s, np.zeros(len(s)), seen.maps, np.full(3, -0.8),
                                   np.full(3, 1.5), 0.02, 0.1))
    return truth, (own[0], own[1]), (lands[0], lands[1])


@pytest.mark.parametrize(("name", "kind"), [
    ("slid", "prismatic"), ("turned", "revolute"), ("screwed", "screw")])
def test_the_kind_is_right_under_noise_and_from_either_start(name, kind, request):
    world = request.getfixturevalue(name)
    truth, own, lands = noisy(world, 0.003, 0)
    joint = choose_joint(truth, own, lands, TAU, DIAG, 0.8)
    assert joint.kind == kind
    assert joint.confidence == 0.8
    tried = {"fixed", "revolute", "prismatic"} | ({"screw"} if truth.kind else set())
    assert set(joint.bic) == tried
    assert joint.pitch == pytest.approx(truth.pitch, rel=0.1)
    assert min(joint.bic, key=joint.bic.get) == kind
    assert joint.value > 0
    sign = np.sign(truth.value)
    assert np.degrees(np.arccos(min(1.0, sign * joint.axis @ truth.axis))) < 1.5
    assert joint.value == pytest.approx(abs(truth.value), rel=0.03)


def test_a_carried_part_is_no_screw(screwed):
    truth, own, lands = noisy(screwed, 0.003, 0)
    turn = replace(truth, kind=1, pitch=0.0, carrier=np.eye(4))
    joint = choose_joint(turn, own, lands, TAU, DIAG, 0.8)
    assert joint.kind != "screw"
    assert "screw" not in joint.bic


def test_a_slide_found_as_a_small_far_turn_becomes_a_slide(slid):
    """About a line 6 units away, 0.05 rad move the block by 0.3 like the slide does."""
    _, own, lands = noisy(slid, 0.002, 1)
    centre = own[0].points.mean(0)
    far = Hypothesis(1, np.array([0.0, 0, -1]), centre + np.array([0.0, -6.0, 0]), 0.05)
    way = se3.apply(far.move, centre) - centre
    assert np.allclose(way, slid.axis * slid.value, atol=0.01)
    joint = choose_joint(far, own, lands, TAU, DIAG, 0.5)
    assert joint.kind == "prismatic"
    assert np.degrees(np.arccos(min(1.0, joint.axis @ slid.axis))) < 2.0


@pytest.mark.parametrize("share", [0.9, 0.95, 1.05])
def test_a_slide_of_nearly_the_right_length_stays_a_slide(slid, share):
    """A turn about a far line is refined from it: the slide is compared at its best as well."""
    truth, own, lands = noisy(slid, 0.002, 1)
    joint = choose_joint(replace(truth, value=share * truth.value), own, lands, TAU, DIAG, 0.5)
    right = choose_joint(truth, own, lands, TAU, DIAG, 0.5)
    assert joint.kind == "prismatic"
    assert joint.value == pytest.approx(abs(share * slid.value))  # the images' length, for now
    assert joint.bic["prismatic"] == pytest.approx(right.bic["prismatic"], rel=0.2)


@pytest.mark.parametrize(("arm", "angle", "saved", "wins"), [
    (0.0, 1.0, 0.05, True),  # a line at the part, a large turn: a hinge
    (0.0, 0.05, 0.05, True),  # 50 of 1000: more than the price of a small turn
    (2.0, 0.05, 0.05, False),  # far away: bent depth saves as much
    (2.0, 0.05, 0.45, True),
])
def test_a_far_hinge_must_explain_a_share_of_what_a_slide_leaves(arm, angle, saved, wins):
    slide = 1000.0
    turn = slide * (1 - saved) + hinge_price(arm * DIAG, angle, slide, DIAG)
    assert (turn < slide) is wins
