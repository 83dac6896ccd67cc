"""Labels of a set of motions are the cheapest, whatever set it was made from."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import STRANGE, Scores, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.labelling import Unary, energy_of, label
from part2gs_robotics.evidence.graph import Graph, web_of
from part2gs_robotics.model.joint import Joint

STUCK, CHEAPEST = np.array([2, 0, 2]), np.array([1, 1, 0])


@pytest.fixture
def three():
    """Landing of three surfels and their neighbours, no bonds.

    A and C meet each other under motion 2; A is better off with B under motion 1, C at rest. A's
    leaving makes C dearer by more than A and B save, until C leaves as well.
    """
    match = np.array([[1.0, 0.0, 0.1], [0.2, 0.0, 1.0], [0.3, 1.0, 0.1]])
    target = np.array([[-1, 1, 2], [-1, 0, -1], [-1, -1, 0]])
    graph = Graph(np.array([[1], [0], [0]], np.int32), np.zeros((3, 1), np.float32))
    return Unary(match, target, np.where(target < 0, match, 1.0)), graph


def judged(monkeypatch, three, start, photos):
    """Return two slides judged from a start, by surfels and by what photos say of labels."""
    unary, graph = three
    judge = object.__new__(Judge)
    judge.study = SimpleNamespace(web=web_of(graph, np.zeros((3, 1), np.float32)))
    judge._judged = {}
    monkeypatch.setattr(judge, "_unary", lambda motions: SimpleNamespace(resting=unary),
                        raising=False)
    monkeypatch.setattr(judge, "scores", lambda found, hard: Scores(
        energy_of(unary, graph, hard), photos(hard)), raising=False)
    slides = [Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.1) for _ in range(2)]
    renewed = judge.renewed(judge.judge(on_base(slides, start)))
    return judge.judge(renewed)  # asked for again, it is as it was renewed


@pytest.mark.parametrize("start", [STUCK, CHEAPEST])
def test_labels_do_not_stay_where_no_exchange_of_one_makes_them_cheaper(monkeypatch, three, start):
    unary, graph = three
    web = web_of(graph, np.zeros((3, 1), np.float32))
    np.testing.assert_array_equal(label(unary, web, STUCK), STUCK)
    assert energy_of(unary, graph, CHEAPEST) < energy_of(unary, graph, STUCK) - 0.05
    found = judged(monkeypatch, three, start, lambda hard: 0.0)
    np.testing.assert_array_equal(found.labels, CHEAPEST)
    assert found.cost == pytest.approx(0.3)


def test_photos_choose_between_labels_that_surfels_can_hardly_tell(monkeypatch, three):
    found = judged(monkeypatch, three, STUCK, lambda hard: 0.2 * (hard == CHEAPEST).all())
    np.testing.assert_array_equal(found.labels, STUCK)
    assert found.cost == pytest.approx(0.4)


def slide(way, direction=(0.0, 1.0, 0.0)):
    return Joint("prismatic", np.array(direction), np.zeros(3), way)


@pytest.mark.parametrize(("told", "best"), [((0, 0, 0), 0), ((1, 0, 0), 1), ((1, 1, 0), 2),
                                            ((0.02, 0, 0), 0), ((1, 1, 1), 0)])
def test_photos_see_the_cheapest_once_ways_have_their_cost(monkeypatch, told, best):
    """As were all ways looked at; those are dear to look at, so that few are."""
    costs, asked = [0.20, 0.21, 0.22], []
    sets = [on_base([slide(0.1 * (n + 1))], np.full(1, n)) for n in range(3)]
    judge = object.__new__(Judge)

    def through(found, _hard):
        asked.append(int(found.labels[0]))
        return np.array([told[asked[-1]]])

    stubs = {"_column": lambda motion: motion, "judge": lambda one: one.__class__(
        one.motions, one.labels, Scores(0.0, 0.0), one.parents, one.known),
        "_likely": lambda one: (costs[int(one.labels[0])], one), "through": through}
    for name, stub in stubs.items():
        monkeypatch.setattr(judge, name, stub, raising=False)
    assert int(judge.best_of(sets, 1).labels[0]) == best
    every = [c + STRANGE * t for c, t in zip(costs, told, strict=True)]
    assert every[best] == min(every)
    assert len(asked) == len(set(asked)) <= 1 + sum(c < every[best] for c in costs[1:]) + (
        told[0] == 1)


def test_what_goes_through_another_is_told_in_the_cost(judge, right, monkeypatch):
    """A block that goes down through the base it stands on, and one that is lifted off."""
    monkeypatch.setattr(judge, "costs", lambda _motions, hard: np.zeros(len(hard)))
    early = np.arange(len(right.labels)) < len(judge.study.surfels[0])
    hard = np.where((right.labels == 1) & early, 1, 0)
    for way, told in ((-0.6, 1.0), (0.6, 0.0)):
        found = on_base([slide(way, (0.0, 0.0, 1.0))], hard)
        assert judge.through(found, hard)[0] == pytest.approx(told)
        with_it, without = judge.given(found).scores, judge.unseen(found, hard)
        assert with_it.strange - without.strange == pytest.approx(told)
