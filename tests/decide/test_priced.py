"""Decision by a judge that knows what every set of motions leaves: which changes are taken."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import PART, Scores, on_base
from part2gs_robotics.decide.grow import _counted, decide, lowered
from part2gs_robotics.decide.split import NEAR
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.joint import Joint

X, Y, Z = np.eye(3)


def slide(axis, value):
    return Joint("prismatic", axis, np.array([0.2, 0.4, 0.4]), value)


class Tolerant(dict[frozenset[float], float]):
    """What sets leave, whatever rounding did to values; any other set leaves what none does."""

    def __missing__(self, asked):
        return next((left for known, left in self.items() if len(known) == len(asked)
                     and np.allclose(sorted(known), sorted(asked), atol=1e-9)), 1.0)


class Priced:
    """A judge that knows what every set of motions leaves, by their values."""

    nothing = Surfels(*(np.zeros((0, 3)) for _ in range(3)), np.zeros(0, np.int64))
    study = SimpleNamespace(diag=1.0, own=lambda *_: (Priced.nothing, Priced.nothing))

    def __init__(self, left):
        self.left = Tolerant(left)

    def judge(self, found):
        left = self.left[frozenset(h.value for h in found.motions)]
        return replace(found, labels=np.zeros(0, np.int64),
                       judged=Scores(left, 0.0, parts=len(found)))

    def best_of(self, sets, shown=2):
        return min(map(self.judge, sets), key=lambda c: c.cost)

    def polished(self, found):
        return found


def test_a_part_that_new_labels_leave_idle_is_left_out(monkeypatch):
    """Labels from another start, with which another part explains all: its price is not paid."""
    one, two = (Joint("prismatic", X, np.zeros(3), value) for value in (0.3, 0.2))
    before = {frozenset(): 1.0, frozenset({0.3}): 0.6, frozenset({0.2}): 0.7}
    judge = Priced(before | {frozenset({0.3, 0.2}): 0.5})
    anew = Priced(before | {frozenset({0.3, 0.2}): 0.4, frozenset({0.3}): 0.4})

    def renewed(found):
        judge.left = anew.left
        return judge.judge(found)

    monkeypatch.setattr(judge, "renewed", renewed, raising=False)
    monkeypatch.setattr("part2gs_robotics.decide.grow.risen", lambda _judge, found, _pool: found)
    assert [h.value for h in decide(judge, [one, two], None)[0].motions] == [0.3]
    assert len(decide(judge, [one, two], 2)[0]) == 2


@pytest.mark.parametrize(("both", "count"), [(0.5, 2), (1.0 - 1.9 * PART, 0)])
def test_two_are_found_where_neither_pays_alone(both, count):
    """What one alone shows the photos worse, the other makes up for."""
    one, two = (Joint("revolute", axis, np.zeros(3), value) for axis, value in ((X, 0.3), (Y, 0.2)))
    judge = Priced({frozenset(): 1.0, frozenset({0.3}): 1.05, frozenset({0.2}): 1.1,
                    frozenset({0.3, 0.2}): both})
    found = lowered(judge, judge.judge(on_base([])), [one, two])
    assert len(found) == count


@pytest.mark.parametrize(("both", "count"), [(0.6 - 1.1 * PART, 2), (0.6 - 0.9 * PART, 1)])
def test_a_slide_nearly_as_another_is_found_without_being_proposed(both, count):
    """Two drawers opened nearly alike: one slide lands both, and nothing proposes a second."""
    one, longer, shorter = 0.3, 0.3 + NEAR, 0.3 - NEAR
    judge = Priced({frozenset(): 1.0, frozenset({one}): 0.6, frozenset({one, longer}): both,
                    frozenset({one, shorter}): 0.6})
    found = lowered(judge, judge.judge(on_base([])), [slide(X, one)])
    assert len(found) == count


@pytest.mark.parametrize(("count", "values", "short"), [
    (1, {0.3}, True), (2, {0.3, 0.2}, False), (3, {0.3, 0.2, 0.25}, False)])
def test_a_given_number_begins_from_what_is_found_without_it(count, values, short):
    """Alone, a motion between two explains most; of the two that were found one stays."""
    one, two, between = (Joint("prismatic", X, np.zeros(3), value) for value in (0.3, 0.2, 0.25))
    judge = Priced({frozenset(): 1.0, frozenset({0.25}): 0.5, frozenset({0.3}): 0.6,
                    frozenset({0.2}): 0.7, frozenset({0.3, 0.2}): 0.1,
                    frozenset({0.3, 0.25}): 0.4, frozenset({0.2, 0.25}): 0.4,
                    frozenset({0.3, 0.2, 0.25}): 0.1})
    free = judge.judge(on_base([one, two]))
    found, more = _counted(judge, free, [between, one, two], count)
    assert ({h.value for h in found.motions}, more) == (values, short)
