"""Splitting: one motion that hides two parts is left for one motion of each, bodies stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.split import NEAR, _parallel, beside, halved, tune
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread")
X, Y, Z = np.eye(3)


def slide(axis, value):
    return Joint("prismatic", axis, np.array([0.2, 0.4, 0.4]), value)


BETWEEN = slide(X, 0.25)
TURN = Joint("revolute", Z, np.array([0.45, 0.4, 0.4]), np.pi)


def test_one_slide_between_two_blocks_is_two(judge, right, look_alikes):
    """A set that stopped at a compromise is left for the two slides it lies between."""
    between = judge.judge(on_base([BETWEEN]))
    sets = halved(judge, between, [slide(Z, 0.3), *look_alikes.truth, TURN])
    assert [len(c) for c in sets] == [2]
    assert judge.best_of(sets).cost == pytest.approx(right.cost, abs=1e-3)
    assert right.cost < between.cost
    assert halved(judge, between, [slide(Z, 0.3), look_alikes.truth[0]]) == []
    assert halved(judge, judge.judge(on_base([TURN])), look_alikes.truth) == [], "kinds stay"


def test_what_carries_or_is_carried_is_not_split(judge, right, look_alikes):
    carrying = replace(right, parents=(0, 1))
    assert halved(judge, carrying, look_alikes.truth) == []


def test_numbers_of_parts_that_stay_are_kept(judge, right, look_alikes):
    sets = halved(judge, replace(right, known=(4, 7)), look_alikes.truth)
    assert {c.known for c in sets} == {(4, 7, 0)}


def test_a_slide_has_a_little_longer_and_a_shorter_one_beside_it(judge, right, look_alikes):
    sets, step = beside(judge, right), NEAR * judge.study.diag
    assert all(c.motions[:2] == right.motions for c in sets)
    assert [c.motions[2].value for c in sets] == pytest.approx(
        [0.3 - step, 0.3 + step, 0.2 - step, 0.2 + step])
    assert beside(judge, on_base([TURN])) == [], "what turns beside it has a line of its own"
    carried = replace(right, parents=(0, 1))
    assert len(beside(judge, carried)) == 2, "what another part carries is hung later"
    assert min(judge.judge(c).cost for c in sets) > right.cost, "no third part is among them"


def test_parallel_motions_are_paired_by_kind_whichever_way_their_axes_point():
    one, two = slide(X, 0.2), slide(-X, -0.3)
    door, other = (Joint("revolute", axis, np.zeros(3), 1.0) for axis in (Z, -Z))
    pool = [one, door, slide(Y, 0.3), two, slide(X, 0.201), other]
    assert _parallel(pool, False, 0.05) == [(one, two), (two, pool[4])]
    assert _parallel(pool, True, 0.05) == [(door, other)]


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
