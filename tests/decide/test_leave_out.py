"""Parts without which the cost is lower leave, whatever they are; the others stay as they were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.articulate import _with_bodies
from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import PART, Scores, on_base
from part2gs_robotics.decide.leave_out import joint_of, kinds_chosen, least, saved, thinned
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread")


@pytest.fixture(scope="module")
def parts(look_alikes):
    """Both true joints, and one that is nearly the first and saves nothing beside it."""
    first, second = (Joint("prismatic", h.axis, h.origin, h.value) for h in look_alikes.truth)
    return first, second, replace(first, value=1.01 * first.value)


def judged(judge, *joints, parents=None):
    """Return the judged candidate of some joints."""
    found = on_base(joints)
    return judge.judge(replace(found, parents=parents) if parents else found)


def test_a_copy_leaves_and_true_parts_stay(judge, parts):
    first, second, copy = parts
    found = judged(judge, first, second, copy)
    left = thinned(judge, found)
    assert len(left) == 2
    assert left.cost < found.cost
    assert thinned(judge, left) is left
    sure = judged(judge, first, second)
    assert thinned(judge, sure) is sure


def test_a_part_leaves_that_only_makes_up_for_joints_off_by_a_little(judge, parts):
    """The first joint is a little short, and a false part makes up for that."""
    first, second, _ = parts
    short = replace(first, value=0.985 * first.value)
    found = judged(judge, short, second, replace(first, value=1.005 * first.value))
    left = least(judge, found)
    assert len(left) == 2
    assert left.cost <= min(found.cost, thinned(judge, found).cost)
    assert min(abs(h.value - first.value) for h in left.motions) < 0.01 * first.value
    sure = judged(judge, first, second)
    assert least(judge, sure) is sure


class Grain:
    """A cost that polishing lowers by as much whatever the set; each lost part makes it dearer."""

    def __init__(self, gain, loss):
        self.gain, self.loss = gain, loss

    def judge(self, found, polish=0.0):
        lost = self.loss * (2 - len(found))
        return replace(found, judged=Scores(0.5 + lost - polish, 0.0))

    def polished(self, found):
        return self.judge(found, self.gain)


@pytest.mark.parametrize(("gain", "loss"), [(0.9, 0.6), (0.9, -0.1), (0.1, 0.6)])
def test_a_part_stays_that_pays_with_joints_of_one_kind(parts, gain, loss):
    """All joints gain by being polished; a small part saves less than that, or nothing."""
    judge = Grain(gain * PART, loss * PART)
    found = judge.judge(on_base(parts[:2]))
    left = least(judge, found)
    assert left is found if loss > 0 else len(left) == 1


def test_numbers_follow_what_leaves(judge, parts):
    first, second, _ = parts
    still = replace(first, value=0.0)
    left = thinned(judge, judged(judge, first, still, second))
    assert left.motions == (first, second)
    assert left.known == (1, 3)


def test_several_leave_one_after_another_and_one_must_stay(judge, parts):
    first, _, _ = parts
    still = [replace(first, value=0.0), replace(first, value=1e-4), replace(first, value=2e-4)]
    assert len(thinned(judge, judged(judge, *still))) == 1
    assert thinned(judge, judged(judge, first, *still)).motions == (first,)


def test_what_carries_a_part_stays(judge, parts):
    first, second, copy = parts
    found = judged(judge, first, second, copy, parents=(0, 0, 2))
    assert any(h is second for h in thinned(judge, found).motions)


def test_what_a_part_saves_is_the_gap_to_the_set_without_it(judge, parts):
    first, second, copy = parts
    both = judged(judge, first, second)
    gaps = saved(judge, both)
    assert gaps[0] == pytest.approx((judged(judge, second).cost - both.cost) / PART)
    assert min(gaps) > 1.0, "true parts pay their price"
    assert min(saved(judge, on_base([first, second, copy]))) <= 0.0
    assert saved(judge, on_base([first]))[0] == pytest.approx(
        (judge.judge(on_base([])).cost - judged(judge, first).cost) / PART)
    carrier = saved(judge, replace(on_base([second, first, copy]), parents=(0, 0, 2)))
    assert np.isnan(carrier[1])
    assert np.isfinite([carrier[0], carrier[2]]).all()


def test_only_what_came_anew_has_its_kind_chosen(judge, right, look_alikes):
    first, second = look_alikes.truth
    old = judge.judge(on_base([first]))
    found = kinds_chosen(judge, right, old)
    assert found.motions[0] is first
    assert found.motions[1] is not second
    assert found.motions[1].kind == "prismatic"
    assert found.motions[1].value == pytest.approx(second.value, abs=0.005)
    assert np.isfinite(found.motions[1].confidence)


def test_a_motion_that_no_surfel_has_keeps_its_kind_and_leaves_with_the_last_labels(judge, parts):
    first, second, _ = parts
    nowhere = replace(first, origin=first.origin + 50.0, value=50.0)  # nothing lands so far off
    found = judged(judge, first, nowhere, second)
    assert not (found.labels == 2).any()
    assert joint_of(judge, found, 1) is nowhere
    left = _with_bodies(judge, found, ArticulateConfig())
    assert left.motions == (first, second)
    assert set(np.unique(left.labels)) == {0, 1, 2}
    asked = _with_bodies(judge, found, ArticulateConfig(parts=3))
    assert len(asked) == 3
