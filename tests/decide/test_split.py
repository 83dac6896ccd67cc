"""Splitting: one motion that hides two parts is left for one motion of each, bodies stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import MORE_MET, on_base
from part2gs_robotics.decide.split import TORN, WHOLE, _parallel, parted, split, torn
from part2gs_robotics.decide.tune_slides import tune
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread")
X, Y, Z = np.eye(3)


def slide(axis, value):
    return Joint("prismatic", axis, np.array([0.2, 0.4, 0.4]), value)


BETWEEN = slide(X, 0.25)
TURN = Joint("revolute", Z, np.array([0.45, 0.4, 0.4]), np.pi)


def rescored(found, **scores):
    """Return a judged candidate with other scores."""
    return replace(found, judged=replace(found.scores, **scores))


def test_one_slide_between_two_blocks_is_two(judge, right, look_alikes, monkeypatch):
    """A set that stopped at a compromise is left for the two slides it lies between."""
    compromise = judge.judge(on_base([BETWEEN]))
    assert compromise.scores.met < WHOLE
    pool = [slide(Z, 0.3), *look_alikes.truth, TURN]
    found = split(judge, compromise, pool)
    assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.005)
    assert split(judge, compromise, [slide(Z, 0.3), look_alikes.truth[0]]) is compromise
    assert split(judge, right, pool) is right, "bodies are not split"
    monkeypatch.setattr("part2gs_robotics.decide.split.WHOLE", 2.0)
    assert split(judge, right, pool) is right, "not even when asked: it does not pay"


@pytest.mark.parametrize(("saved", "met", "is_split"), [
    (0.7 * TORN, 1.0, False), (1.2 * TORN, 1.0, True), (1.2 * TORN, 0.5 * MORE_MET, False),
    (1.2, 0.5 * MORE_MET, True)])
def test_two_bodies_that_meet_more_than_the_one_between_pay_half(
        judge, look_alikes, monkeypatch, saved, met, is_split):
    """Two doors that change places look like one that swung across, and save little beside it."""
    compromise, price = judge.judge(on_base([BETWEEN])), 0.01
    old = compromise.scores
    two = rescored(judge.judge(on_base(look_alikes.truth)), met=old.met + met,
                   images=old.images, air=old.air, askew=old.askew)
    dearer = two.cost - (compromise.cost - saved * price)
    two = rescored(two, surfels=two.scores.surfels - dearer)
    monkeypatch.setattr("part2gs_robotics.decide.split._best", lambda *_: (two, price))
    leaning = rescored(two, askew=two.scores.askew + 0.3)
    found = split(judge, compromise, [slide(Z, 0.3), *look_alikes.truth])
    assert found is (two if is_split else compromise)
    monkeypatch.setattr("part2gs_robotics.decide.split._best", lambda *_: (leaning, price))
    excused = split(judge, compromise, [slide(Z, 0.3), *look_alikes.truth])
    assert excused is (leaning if is_split else compromise), "to look a little askew is no fault"
    off = rescored(two, askew=1.0)
    monkeypatch.setattr("part2gs_robotics.decide.split._best", lambda *_: (off, price))
    assert split(judge, compromise, look_alikes.truth) is compromise, "to be off is"


def test_parallel_motions_are_paired_by_kind_whichever_way_their_axes_point():
    one, two = slide(X, 0.2), slide(-X, -0.3)
    door, other = (Joint("revolute", axis, np.zeros(3), 1.0) for axis in (Z, -Z))
    pool = [one, door, slide(Y, 0.3), two, slide(X, 0.201), other]
    assert _parallel(pool, False, 0.05) == [(one, two), (two, pool[4])]
    assert _parallel(pool, True, 0.05) == [(door, other)]


def test_pieces_of_one_motion_become_motions_of_their_own(judge, right, monkeypatch, caplog):
    """One slide between two blocks' carries both, in two pieces; each piece has its own."""
    between = judge.judge(on_base([BETWEEN]))
    with caplog.at_level("INFO", logger="part2gs_robotics"):
        found = parted(judge, between)
    assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.01)
    assert found.cost < between.cost
    assert "on their own" in caplog.messages[-1]
    assert parted(judge, right) is right, "bodies in one piece stay"
    with monkeypatch.context() as patch:
        patch.setattr("part2gs_robotics.decide.split.NEAR", 1.0)
        assert parted(judge, between) is between, "as pieces must move differently"
    slower = 0.25 / judge.study.diag  # between both ways
    monkeypatch.setattr("part2gs_robotics.decide.split.SLOW", slower)
    assert parted(judge, between) is between, "a piece that stays behind is no part"


def test_tuning_repairs_lengths_that_are_off_by_a_hundredth(judge, right, look_alikes):
    off = 0.01 * judge.study.diag
    wrong = judge.judge(on_base([slide(X, 0.3 - off), slide(X, 0.2 + off)]))
    assert wrong.cost > right.cost + 0.01
    found = tune(judge, wrong)
    assert found.cost == pytest.approx(right.cost, abs=1e-3)
    assert [h.value for h in found.motions] == pytest.approx([0.3, 0.2], abs=0.003)
    assert (found.labels == right.labels).mean() > 0.99


def test_tuning_leaves_one_motion_and_turns_alone(judge, look_alikes):
    one = judge.judge(on_base([slide(X, 0.28)]))
    assert tune(judge, one) is one
    turns = judge.judge(on_base([TURN, replace(TURN, value=1.0)]))
    assert tune(judge, turns) is turns


def test_what_nothing_joins_under_one_motion_is_counted(look_alikes):
    grid = np.stack([c.ravel() for c in np.meshgrid(*[np.linspace(0.0, 0.2, 15)] * 2, [0.5])], 1)
    far = grid + np.array([0.0, 0.5, 0.0])

    def seen(*patches):
        points = np.concatenate(patches)
        up, grey = np.tile(Z, (len(points), 1)), np.full_like(points, 0.5)
        return Surfels(points, up, grey, np.ones(len(points), np.int64))

    both = seen(grid, far), seen(grid + 0.25 * X, far + 0.25 * X)
    study = replace(look_alikes.study, surfels=both)
    one = on_base([BETWEEN], np.ones(4 * len(grid), np.int64))
    each = np.tile(np.repeat([1, 2], len(grid)), 2)
    assert torn(study, one) == 1
    assert torn(study, on_base([BETWEEN, BETWEEN], each)) == 0
    assert torn(study, replace(one, labels=0 * one.labels)) == 0
