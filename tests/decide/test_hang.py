"""Hanging: a part that another part carries is found on it, and turns about its own axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.hang import _beside, _polished, _rehung, _swaps_sides, hang
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.leave_out import joint_of
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.joints.settle import aligned
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import part_motions
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.search.refine import refine

pytestmark = pytest.mark.usefixtures("one_numba_thread")
DOOR = Joint("revolute", np.array([0.0, 0, -1]), np.array([0.0, -0.05, 0.3]), 0.8)
# A flap on the outside of the door that folds up about an axis along the door.
FLAP = Joint("revolute", np.array([-1.0, 0, 0]), np.array([0.5, -0.07, 0.35]), 1.1)


BASE = ((0, 0, 0), (0.8, 0.5, 0.6), 1)
PANEL = ((0, -0.05, 0), (0.8, -0.02, 0.6), 2)
NOTHING = Surfels(*(np.zeros((0, 3)) for _ in range(3)), np.zeros(0, np.int64))
NOBODY = NOTHING, NOTHING
PLATE = ((0.3, -0.09, 0.05), (0.7, -0.05, 0.35), 3)


def carrying(joint):
    return replace(joint, carrier=DOOR.state1_from_0)


def photographed(toy, *plates):
    """Return the judge of a door and plates on joints of their own, and photos of both states."""
    before = [toy.Box(*BASE), toy.Box(*PANEL), *(toy.Box(*PLATE) for _ in plates)]
    after = [toy.Box(*BASE), toy.Box(*PANEL, DOOR.state1_from_0),
             *(toy.Box(*PLATE, joint.state1_from_0) for joint in plates)]
    pair = [toy.gaussians_of(boxes, 0.04)[0] for boxes in (before, after)]
    eyes = toy.cameras(20, 64, np.array([0.3, -0.1, 0.3]), 1.3)
    scene = toy.scene_of(tuple(toy.drawn(g, *eyes, 64) for g in pair))
    return Judge(toy.study_of(scene, pair)), tuple(small_views(s, 8, 64) for s in scene.states)


@pytest.fixture(scope="module")
def chained(toy):
    return photographed(toy, carrying(FLAP))


def both_judged(judge):
    """Return the door and the flap on it, judged."""
    return judge.judge(on_base([DOOR]).plus(carrying(FLAP), 1))


def assert_flap(found, axis, way):
    """The found joint turns the flap as the true one does: its corners end in the same place."""
    corners = np.array(PLATE[:2])[[[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
                                  [[0, 1, 2]]]
    true = carrying(FLAP).state1_from_0
    gaps = se3.apply(found.state1_from_0, corners) - se3.apply(true, corners)
    assert found.kind == "revolute"
    assert np.degrees(np.arccos(min(1.0, abs(found.axis @ FLAP.axis)))) < axis
    assert np.linalg.norm(gaps, axis=1).max() < way


def test_a_flap_on_a_door_is_found_and_hangs_on_the_door(chained):
    judge, views = chained
    found = hang(judge, judge.judge(on_base([DOOR])), None, np.random.default_rng(0))
    assert found.parents == (0, 1)
    assert found.known == (1, 0)
    assert_flap(found.motions[1], 4.0, 0.05)
    end = aligned(judge, found, views)
    assert_flap(end.motions[1], 1.0, 0.012)
    door = end.motions[0]
    assert np.degrees(np.arccos(min(1.0, abs(door.axis @ DOOR.axis)))) < 0.5
    np.testing.assert_allclose(end.motions[1].carrier, door.state1_from_0)
    moves = part_motions([replace(j, carrier=None) for j in end.motions], end.parents)
    np.testing.assert_allclose(moves[2], end.motions[1].state1_from_0, atol=1e-9)


@pytest.mark.parametrize("off", [(0, 0, 0.05), (0, 0.07, 0), (0, 0.06, -0.06)])
def test_a_carried_part_found_beside_its_line_is_brought_onto_it(chained, off):
    judge, _ = chained
    true = carrying(FLAP)
    corners = np.array(np.meshgrid(*zip(*PLATE[:2], strict=True))).reshape(3, -1).T

    def gap(h):
        return np.linalg.norm(se3.apply(h.move, corners) - se3.apply(true.move, corners), axis=1)

    start = judge.judge(on_base([DOOR]).plus(replace(true, origin=true.origin + off), 1))
    own = judge.study.own(start.labels, 2)
    once = refine(start.motions[1], own, judge.lands, judge.study.taus)
    assert gap(once).max() > 0.024
    assert gap(_polished(judge, start).motions[1]).max() < 0.02


@pytest.mark.parametrize(("share", "parents"), [(1.1, (0,)), (0.9, (0, 1))])
def test_a_carried_part_must_save_its_price_and_its_carriers(chained, monkeypatch, share, parents):
    judge, _ = chained
    alone, both = judge.judge(on_base([DOOR])), both_judged(judge)
    saved = alone.scores.left - both.scores.left
    monkeypatch.setattr("part2gs_robotics.decide.candidate.PART", share * saved / 2)
    monkeypatch.setattr("part2gs_robotics.decide.candidate.BORDER", 1e9)  # a whole price each
    assert hang(judge, alone, None, np.random.default_rng(0)).parents == parents


def test_a_door_without_a_flap_stays_alone(toy):
    judge, _ = photographed(toy)
    found = hang(judge, judge.judge(on_base([DOOR])), None, np.random.default_rng(0))
    assert found.parents == (0,)
    assert found.motions == (DOOR,)


def test_a_given_number_of_parts_is_not_exceeded(chained):
    judge, _ = chained
    alone = judge.judge(on_base([DOOR]))
    assert hang(judge, alone, 1, np.random.default_rng(0)).parents == (0,)


def test_a_part_taken_for_one_of_the_base_is_hung_where_it_turns(chained):
    """Door and flap together move the flap like a screw; one turn about the base fits it badly."""
    judge, _ = chained
    whole = carrying(FLAP).state1_from_0
    turn = se3.rotvec_from_rotation(whole[:3, :3])
    angle = float(np.linalg.norm(turn))
    wrong = replace(_beside(carrying(FLAP), np.eye(4), NOBODY), carrier=None)
    assert wrong.kind == "revolute"
    assert wrong.value == pytest.approx(angle)
    start = on_base([wrong, DOOR], _swapped(both_judged(judge).labels))
    found = hang(judge, start, 2, np.random.default_rng(0))
    assert found.parents == (0, 1)  # the carrier comes first
    assert found.known == (2, 1)
    assert_flap(found.motions[1], 4.0, 0.05)


def _swapped(hard):
    return np.array([0, 2, 1])[hard]


@pytest.mark.parametrize("angle", [0.3, -1.2, 2.9])
def test_the_nearest_joint_on_a_carrier_is_exact_where_there_is_one(angle):
    carrier = se3.screw_motion(np.array([0, 0.6, 0.8]), np.array([0.1, 0.2, 0.3]), 0.7, 0.1)
    joint = Joint("revolute", np.array([0.6, 0, 0.8]), np.array([0.5, -0.1, 0.2]), angle,
                  carrier=carrier)
    found = _beside(joint, carrier, NOBODY)
    np.testing.assert_allclose(found.move, joint.move, atol=1e-12)
    slide = Joint("prismatic", joint.axis, joint.origin, 0.4, carrier=carrier)
    found = _beside(slide, carrier, NOBODY)
    assert found.kind == "prismatic"
    np.testing.assert_allclose(found.move, slide.move, atol=1e-12)


def plate(rng, lo, hi):
    return rng.uniform(lo, hi, (400, 3))


@pytest.mark.parametrize(("angle", "swaps"), [(180.0, True), (150.0, True), (120.0, False)])
def test_half_a_turn_of_a_lid_within_itself_only_swaps_its_sides(angle, swaps):
    """Of a lid one state shows the top, the other the underside; both lie in one place."""
    rng = np.random.default_rng(0)
    top, under = plate(rng, (0, 0, 0.02), (0.6, 0.1, 0.02)), plate(rng, (0, 0, 0), (0.6, 0.1, 0))
    h = Joint("revolute", np.array([1.0, 0, 0]), np.array([0.3, 0.05, 0.01]), np.deg2rad(angle),
              carrier=DOOR.state1_from_0)
    assert _swaps_sides(h, under, top, 0.03) == swaps
    assert not _swaps_sides(replace(h, kind="prismatic"), under, top, 0.03)
    assert not _swaps_sides(h, under, top[:0], 0.03)


def test_a_leaf_that_folds_over_does_not_stay_in_its_carriers_place():
    rng = np.random.default_rng(0)
    table, leaf = plate(rng, (0, 0, 0), (0.6, 0.4, 0)), plate(rng, (0.6, 0, 0), (1.2, 0.4, 0))
    folded = Joint("revolute", np.array([0.0, 1, 0]), np.array([0.6, 0, 0]), np.pi,
                   carrier=DOOR.state1_from_0)
    assert not _swaps_sides(folded, leaf, table, 0.03)


def test_a_slide_is_not_asked_whether_it_hangs_on_a_slide(look_alikes, caplog) -> None:
    """Both states look the same either way: the base carries both, and nothing is compared."""
    judge = Judge(look_alikes.study)
    decided = judge.judge(on_base(look_alikes.truth))
    found = on_base([joint_of(judge, decided, k) for k in (0, 1)], decided.labels)
    with caplog.at_level("INFO"):
        assert _rehung(judge, found) is found
    assert "nested:" not in caplog.text


def test_what_slides_beside_a_door_does_not_turn_on_it_and_back(toy, monkeypatch) -> None:
    """A turn that takes the door's back explains a slide as well, and is no slide askew."""
    line = DOOR.origin + np.array([0.385, -0.023, 0])
    way = se3.apply(DOOR.state1_from_0, line) - line
    slide = float(np.linalg.norm(way))
    drawer = Joint("prismatic", way / slide, line, slide)
    judge, _ = photographed(toy, drawer)
    monkeypatch.setattr(judge, "leans", lambda motions, _: np.array([0.5 * (not h.turns)
                                                                     for h in motions]))
    found = judge.judge(on_base([DOOR, drawer]))
    assert _rehung(judge, found) is found
