"""The kind of joint is chosen by evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.landing import build_landing
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.choose_kind import choose_joint, hinge_price

TAU, DIAG = 0.03, 1.4


def noisy(world, sigma, seed):
    """Surfels of the part and landing grids with points displaced along their normals."""
    rng = np.random.default_rng(seed)
    hinge = hasattr(world, "origin")
    pitch = getattr(world, "pitch", 0.0)
    truth = (Joint("screw" if pitch else "revolute", world.axis, world.origin, world.value, pitch)
             if hinge else Joint("prismatic", world.axis, np.array([0.2, 0.3, 0.4]), world.value))
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    grid = np.full(3, -0.8), np.full(3, 1.5)
    own, lands = [], []
    for state, back in ((0, np.eye(4)), (1, se3.inverse(truth.move))):
        seen = world.states[state]
        points = se3.apply(back, seen.surfels.points)
        mine = ((points > lo - 0.005) & (points < hi + 0.005)).all(1)
        off = rng.normal(scale=sigma, size=(len(points), 1)) * seen.surfels.normals
        s = replace(seen.surfels, points=seen.surfels.points + off)
        own.append(s.select(mine))
        lands.append(build_landing(s, np.zeros(len(s)), seen.maps, grid, 0.02, 0.1))
    return truth, (own[0], own[1]), (lands[0], lands[1])


@pytest.mark.parametrize(("name", "kind"), [
    ("slid", "prismatic"), ("turned", "revolute"), ("screwed", "screw")])
def test_the_kind_is_right_under_noise_and_from_either_start(name, kind, request):
    world = request.getfixturevalue(name)
    truth, own, lands = noisy(world, 0.003, 0)
    joint = choose_joint(truth, own, lands, TAU, DIAG, 0.8)
    assert joint.kind == kind
    assert joint.confidence == 0.8
    tried = {"fixed", "revolute", "prismatic"} | ({"screw"} if truth.turns else set())
    assert set(joint.bic) == tried
    assert joint.pitch == pytest.approx(truth.pitch, rel=0.1)
    assert min(joint.bic, key=joint.bic.get) == kind
    assert joint.value > 0
    sign = np.sign(truth.value)
    assert np.degrees(np.arccos(min(1.0, sign * joint.axis @ truth.axis))) < 1.5
    assert joint.value == pytest.approx(abs(truth.value), rel=0.03)


def test_a_carried_part_is_no_screw(screwed):
    truth, own, lands = noisy(screwed, 0.003, 0)
    turn = replace(truth, kind="revolute", pitch=0.0, carrier=np.eye(4))
    joint = choose_joint(turn, own, lands, TAU, DIAG, 0.8)
    assert joint.kind != "screw"
    assert "screw" not in joint.bic


def test_a_slide_found_as_a_small_far_turn_becomes_a_slide(slid):
    """About a line 6 units away, 0.05 rad move the block by 0.3 like the slide does."""
    _, own, lands = noisy(slid, 0.002, 1)
    centre = own[0].points.mean(0)
    far = Joint("revolute", np.array([0.0, 0, -1]), centre + np.array([0.0, -6.0, 0]), 0.05)
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
