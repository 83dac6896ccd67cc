"""Half turns: of what looks alike after one, the lesser motion; lines in the air cost."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import PART, STRANGE, on_base
from part2gs_robotics.decide.judge import NEAR, Judge
from part2gs_robotics.decide.turn_alternatives import calmed, joint_near
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

TRUTH = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.0, -0.05, 0.0]), -0.9)
MIDDLE = np.array([0.4, -0.03, 0.3])  # of the door
DIAG = 1.2


@pytest.fixture
def steps(caplog):
    """Return a function that tells what the decision has said of the steps it took."""
    caplog.set_level("INFO", logger="part2gs_robotics.decide")
    return lambda: [r.getMessage() for r in caplog.records if ".decide." in r.name]


@pytest.fixture(scope="module")
def judge(toy):
    """A door turned by -0.9 rad about its edge: the judge of the study."""
    base = toy.Box((0, 0, 0), (0.8, 0.6, 0.6), 1)
    door = toy.Box((0, -0.05, 0), (0.8, -0.01, 0.6), 3)
    pair = [toy.gaussians_of([base, replace(door, move=move)], 0.04)[0]
            for move in (np.eye(4), TRUTH.move)]
    eyes = toy.cameras(16, 56, np.array([0.4, 0.1, 0.3]), 1.2)
    scene = toy.scene_of(tuple(toy.drawn(g, *eyes, 56) for g in pair))
    return Judge(toy.study_of(scene, pair))


@pytest.mark.parametrize("angle", [0.2, 1.0, 3.0])
def test_a_turn_is_the_turn_that_it_is(angle):
    axis = np.array([1.0, 2, -0.5]) / np.linalg.norm([1.0, 2, -0.5])
    origin, centre = np.array([0.3, -0.2, 0.4]), np.array([0.1, 0.2, 0.3])
    found = joint_near(se3.screw_motion(axis, origin, angle, 0.0), centre, DIAG)
    assert np.allclose(found.move, se3.screw_motion(axis, origin, angle, 0.0), atol=1e-9)


def test_a_screw_is_no_joint_and_what_hardly_turns_is_a_slide():
    axis, centre = np.array([0.0, 0, 1]), np.zeros(3)
    assert joint_near(se3.screw_motion(axis, centre, 1.0, 0.2 * DIAG), centre, DIAG) is None
    assert joint_near(np.eye(4), centre, DIAG) is None
    slide = joint_near(se3.make(np.eye(3), 0.3 * axis), centre, DIAG)
    assert slide.kind == "prismatic"
    assert np.allclose(slide.move[:3, 3], 0.3 * axis)


def test_a_hinge_in_the_air_costs_more_than_it_leaves(judge):
    right = judge.judge(on_base([TRUTH]))
    assert right.scores.strange == 0.0
    assert right.cost == pytest.approx(right.scores.left + PART)
    wrong = joint_near(TRUTH.move @ se3.screw_motion(TRUTH.axis, MIDDLE, np.pi, 0.0), MIDDLE, 1.0)
    there = judge.judge(on_base([wrong]))
    assert there.scores.strange > 0.8
    assert there.cost >= there.scores.surfels + there.scores.images + 0.8 * STRANGE


@pytest.mark.parametrize(("gap", "air"), [(0.9, 0.0), (1.5, 0.5), (3.0, 1.0)])
def test_the_air_grows_with_the_gap(judge, gap, air):
    """The door before it moves, and a line beside its edge."""
    hard = judge.judge(on_base([TRUTH])).labels.copy()
    hard[len(judge.study.surfels[0]):] = 0
    edge = judge.study.own(hard, 1)[0].points[:, 0].min()
    origin = np.array([edge - gap * NEAR * judge.study.diag, -0.03, 0.0])
    assert judge.air([replace(TRUTH, origin=origin)], hard)[0] == pytest.approx(air, abs=0.15)


def bar_on_a_board(toy, move, plain, high=0.2):
    """A bar that lies on a board and moves, in paint of its own or in one colour."""
    board = toy.Box((0, 0, 0), (1.0, 0.8, 0.1), 1)
    bar = toy.Box((0.1, 0.3, 0.1), (0.5, 0.45, 0.1 + high), 3)
    pair = []
    for at in (np.eye(4), move):
        g, labels = toy.gaussians_of([board, replace(bar, move=at)], 0.035)
        if plain:
            g.sh0[labels == 1] = g.sh0[labels == 1].mean(0)
        pair.append(g)
    eyes = toy.cameras(16, 56, np.array([0.5, 0.4, 0.2]), 1.2)
    scene = toy.scene_of(tuple(toy.drawn(g, *eyes, 56) for g in pair))
    return Judge(toy.study_of(scene, pair))


SLIDE = Joint("prismatic", np.array([1.0, 0, 0]), np.array([0.3, 0.375, 0.2]), 0.35)
HALF_TURN = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.475, 0.375, 0.2]), np.pi)


@pytest.mark.parametrize("pool", [[], [SLIDE]])
def test_a_plain_bar_slides_rather_than_turns_end_for_end(toy, pool, steps):
    judge = bar_on_a_board(toy, SLIDE.move, plain=True)
    turned, slid = judge.judge(on_base([HALF_TURN])), judge.judge(on_base([SLIDE]))
    assert abs(turned.cost - slid.cost) < 0.07 * slid.cost  # the photos hardly tell
    found, = calmed(judge, turned, pool).motions
    assert len(steps()) == 1
    assert found.kind == "prismatic"
    assert np.allclose(found.axis * found.value, SLIDE.axis * SLIDE.value, atol=0.02)


def test_a_bar_whose_paint_shows_that_it_turned_has_turned(toy, steps):
    judge = bar_on_a_board(toy, HALF_TURN.move, plain=False)
    candidate = judge.judge(on_base([HALF_TURN]))
    assert calmed(judge, candidate, [SLIDE]) is candidate
    assert not steps()


def test_a_plain_flap_that_folds_over_has_folded(toy, monkeypatch, steps):
    """Its middle slides as well, but its hinge is at its edge."""
    fold = Joint("revolute", np.array([0.0, 1, 0]), np.array([0.5, 0.375, 0.12]), np.pi)
    judge = bar_on_a_board(toy, fold.move, plain=True, high=0.04)
    candidate = judge.judge(on_base([fold]))
    monkeypatch.setattr(judge, "judge", lambda _found: pytest.fail("nothing is tried"))
    assert calmed(judge, candidate, [SLIDE]) is candidate
    assert not steps()


def test_small_turns_have_no_lesser_way(judge, monkeypatch, steps):
    candidate = judge.judge(on_base([TRUTH]))
    monkeypatch.setattr(judge, "judge", lambda _found: pytest.fail("nothing is tried"))
    assert calmed(judge, candidate, [TRUTH]) is candidate
    assert not steps()
