"""Labels of a set of motions are the cheapest, whatever set it was made from."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from part2gs_robotics.decide.candidate import PART, STRANGE, Scores, on_base
from part2gs_robotics.decide.grow import neared
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.labelling import Unary, energy_of, label
from part2gs_robotics.decide.made_joints import way_over
from part2gs_robotics.evidence.graph import Graph, build_graph, touching, ways_along, web_of
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
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
    judge.study = SimpleNamespace(diag=1.0, web=web_of(graph, np.zeros((3, 1), np.float32)))
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


TURN = Joint("revolute", np.array([0.0, 0, 1]), np.zeros(3), np.deg2rad(30.0))


def sheet(points):
    """Return surfels that look up."""
    return Surfels(points, np.tile([0.0, 0, 1], (len(points), 1)), np.zeros_like(points),
                   np.full(len(points), 9))


def patch(at, wide, deep):
    """Return [n, 3] spots of a level patch, 0.02 apart."""
    spots = np.indices((wide, deep)).reshape(2, -1).T * 0.02 + at
    return np.column_stack([spots, np.zeros(len(spots))])


def faucet(waves, firm=0.0):
    """Return a judge of a lever beside a cap, flat but for waves, with three patches about them.

    What a motion carries to where nothing is costs 1. firm: bonds across the rim of the cap, from
    which a fringe hangs down that a turn would carry elsewhere.
    """
    radius, azimuth = (spot.ravel() for spot in np.meshgrid(
        np.arange(0.02, 0.2, 0.02), np.deg2rad(np.arange(0, 360, 6))))
    still = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth),
                      waves * np.cos(3 * azimuth)], 1)
    fringe = np.concatenate([[[0.2 * np.cos(a), 0.2 * np.sin(a), -0.02 * n] for n in range(1, 4)]
                             for a in np.deg2rad(np.arange(15, 345, 12.7))])
    corners = np.concatenate([fringe if firm else patch((0.6, 0.1), 5, 5),
                              patch((-0.7, 0.2), 5, 5), patch((-0.2, -0.7), 5, 5)])
    lever = patch((0.2, -0.02), 18, 3)
    states = tuple(sheet(np.concatenate([still, corners, own]))
                   for own in (lever, se3.apply(TURN.move, lever)))
    graph, trees = build_graph(states), [cKDTree(s.points) for s in states]
    first = len(states[0])
    columns = []
    for move in (np.eye(4), TURN.move):
        met = [trees[1].query(se3.apply(move, states[0].points)),
               trees[0].query(se3.apply(se3.inverse(move), states[1].points))]
        gaps, rows = np.concatenate([m[0] for m in met]), np.concatenate([met[0][1] + first,
                                                                          met[1][1]])
        columns.append((np.where(gaps < 0.015, 0.0, 1.0), np.where(gaps < 0.015, rows, -1)))
    match, target = (np.stack(c, 1) for c in zip(*columns, strict=True))
    judge = object.__new__(Judge)
    judge._points, judge._normals = (np.concatenate([getattr(s, name) for s in states])
                                     for name in ("points", "normals"))
    judge._late, judge._square = np.arange(len(match)) >= first, np.zeros((0, 3))
    kinds = np.tile(np.repeat([0, 1, 2], [len(still), len(corners), len(lever)]), 2)
    rim = kinds[graph.neighbors] + kinds[:, None] == 1
    bonds = np.where(rim, firm, 0.0).astype(np.float32)
    judge.study = SimpleNamespace(
        surfels=states, graph=graph, bonds=bonds, web=web_of(graph, bonds), diag=1.5,
        ways=ways_along(states, graph), touching=touching(states, graph),
        own=lambda hard, part: tuple(s.select(h == part) for s, h in zip(
            states, np.split(hard, [first]), strict=True)))
    judge._unary = lambda motions: Unary(match, target, np.ones_like(match))
    return judge, kinds


def test_a_cap_round_about_the_line_goes_with_its_lever():
    judge, kinds = faucet(0.0)
    alone = label(judge._unary(()).resting, judge.study.web, np.zeros(len(kinds), np.int64))
    np.testing.assert_array_equal(alone == 1, kinds == 2)  # surfels alone leave the cap at rest
    found = on_base([TURN])
    assert judge.air(found.motions, alone)[0] == 1.0
    hard = judge.sort_out(found).labels
    np.testing.assert_array_equal(hard == 1, kinds != 1)
    assert judge.air(found.motions, hard)[0] == 0.0
    assert judge.unseen(found, hard).cost < judge.unseen(found, alone).cost


def test_a_cap_that_a_turn_would_carry_elsewhere_stays():
    judge, kinds = faucet(0.1)
    found = on_base([TURN])
    hard = judge.sort_out(found).labels
    np.testing.assert_array_equal(hard == 1, kinds == 2)
    assert judge.air(found.motions, hard)[0] == 1.0


def test_a_stripe_of_a_cap_that_is_held_does_not_go_with_the_lever():
    judge, kinds = faucet(0.0, 1.0)
    hard = judge.sort_out(on_base([TURN])).labels
    np.testing.assert_array_equal(hard == 1, kinds == 2)


def test_the_shortest_way_to_either_end_keeps_to_what_is_like_the_part():
    """Nodes 0 .. 6 in a row, 7 a way round; 8 apart from all."""
    gaps = np.zeros((9, 9))
    for a, b, far in ((0, 1, 1), (1, 2, 1), (2, 3, 1), (3, 4, 1), (4, 5, 1), (5, 6, 1), (1, 7, 5),
                      (7, 4, 5)):
        gaps[a, b] = gaps[b, a] = far
    own, end, apart = np.zeros((3, 9), bool)
    own[:2], end[[4, 6]], apart[8] = True, True, True
    alike = ~own
    assert way_over(csr_matrix(gaps), own, alike, (end, apart)).tolist() == [1, 2, 3, 4]
    alike[2] = False
    assert way_over(csr_matrix(gaps), own, alike, (end, apart)).tolist() == [1, 4, 7]
    alike[7] = False
    assert not len(way_over(csr_matrix(gaps), own, alike, (end, apart)))


@pytest.mark.parametrize("off", [0.0, 0.03, 0.05])
def test_a_motion_off_its_place_is_refined_from_afar_before_it_competes(judge, look_alikes, off):
    """By shares of the diagonal: refined in the usual way alone it stays where it is."""
    true, diag = look_alikes.truth[0], judge.study.diag
    start = replace(true, value=true.value + off * diag)
    alone = on_base([])
    near, = neared(judge, alone, [start])
    assert abs(near.value - true.value) < 1e-3 * diag
    assert judge.judge(on_base([near])).cost < judge.judge(on_base([start])).cost + PART / 2
    usual = judge.polished(judge.judge(on_base([start]))).motions[0]
    assert (abs(usual.value - true.value) > 0.02 * diag) == (off != 0.0)


def test_a_motion_that_nothing_refined_beats_stays_as_it_is(judge, look_alikes, monkeypatch):
    """What comes of it is compared by surfels, beside the set; what is no cheaper is not taken."""
    far = replace(look_alikes.truth[0], value=0.5)
    monkeypatch.setattr("part2gs_robotics.decide.judge.refine", lambda *_: far)
    one, two = look_alikes.truth
    best = judge.judge(on_base([one]))
    assert neared(judge, best, [two]) == [two]
    assert neared(judge, best, []) == []
