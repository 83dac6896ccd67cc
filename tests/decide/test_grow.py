"""Decision: true motions win, copies and impossible ones do not, look-alikes are told apart."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.decide.candidate import PART, on_base
from part2gs_robotics.decide.grow import decide, lowered
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.labelling import energy_of
from part2gs_robotics.evidence.graph import build_graph, touching, ways_along, web_of
from part2gs_robotics.evidence.guides import guides_of
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.pool import find_more
from part2gs_robotics.search.refine import refine

pytestmark = pytest.mark.usefixtures("one_numba_thread")
X, Y, Z = np.eye(3)


def slide(axis, value):
    return Joint("prismatic", axis, np.array([0.2, 0.4, 0.4]), value)


WRONG = {
    "across": slide(Y, 0.3), "up": slide(Z, 0.3), "backwards": slide(X, -0.3),
    "between": slide(X, 0.25), "still": slide(X, 0.0),
    "turn": Joint("revolute", Z, np.array([0.45, 0.4, 0.4]), np.pi),
}


def no_bonds(states):
    return np.zeros(build_graph(states).weights.shape, np.float32)


def unseen(judge, *motions):
    """Return what surfels of a set cost."""
    found = judge.sort_out(on_base(motions))
    unary = judge._unary(motions).resting
    return energy_of(unary, judge.study.graph, found.labels) / len(found.labels)


@pytest.fixture(scope="module")
def best_alone(judge, look_alikes):
    """The lower cost of one true motion: the longer way leaves less unexplained."""
    return min(judge.judge(on_base([h])).cost for h in look_alikes.truth)


@pytest.mark.parametrize("world", ["slid", "turned"])
def test_no_wrong_motion_explains_surfels_as_well_as_the_true_one(world, request):
    seen = request.getfixturevalue(world)
    states = tuple(s.surfels for s in seen.states)
    first, graph = len(states[0]), build_graph(states)
    judge = Judge(SimpleNamespace(
        surfels=states, lands=tuple(s.land for s in seen.states), graph=graph, tau=0.03,
        bonds=no_bonds(states), web=web_of(graph, no_bonds(states)), straight=guides_of([]),
        diag=1.0, ways=ways_along(states, graph), touching=touching(states, graph),
        own=lambda hard, part: tuple(s.select(h == part) for s, h in zip(
            states, np.split(hard, [first]), strict=True))))
    turning = world == "turned"
    origin = seen.origin if turning else np.array([0.2, 0.3, 0.4])
    truth = Joint("revolute" if turning else "prismatic", seen.axis, origin, seen.value)
    best = unseen(judge, truth)
    tilt = se3.rotation_from_rotvec(np.deg2rad(15) * Y) @ seen.axis
    others = [replace(truth, value=f * seen.value) for f in (-1.0, 0.7, 1.3)]
    others += [replace(truth, axis=tilt),
               replace(truth, kind="prismatic" if turning else "revolute")]
    for other in others:
        assert unseen(judge, other) > best + PART, other
    assert unseen(judge) > best + 10 * PART


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_motion_beats_no_true_one(judge, right, best_alone, look_alikes, name):
    assert judge.judge(on_base([WRONG[name]])).cost > best_alone + PART
    assert judge.judge(on_base([look_alikes.truth[0], WRONG[name]])).cost > right.cost + PART
    assert judge.judge(right.plus(WRONG[name])).cost > right.cost - PART


def test_both_true_motions_carry_their_own_blocks(judge, right, look_alikes):
    found = judge.study.gaussian_labels(right.labels)
    for labels, owner, g in zip(found, look_alikes.owners, judge.study.gaussians, strict=True):
        away = g.means[:, 2] > 0.3  # the seam between block and base may go either way
        assert (labels == owner)[away].mean() > 0.97
        assert (labels == owner).mean() > 0.89
    assert right.cost == pytest.approx(right.scores.left + 2 * PART)
    assert all(judge.confidence(right, k) > 0.5 for k in (0, 1))


def test_a_copy_does_not_pay_and_nobody_needs_it(judge, right, look_alikes):
    twice = judge.judge(right.plus(replace(look_alikes.truth[0])))
    assert twice.cost > right.cost - PART
    own = [(twice.labels == label).sum() for label in (1, 3)]
    assert min(own) < 0.05 * max(own), "copies do not share a block"
    assert max(judge.confidence(twice, k) for k in (0, 2)) < 0.05


def test_the_best_of_sets_is_the_cheapest_in_any_order(judge, right, look_alikes):
    sets = [on_base(motions) for motions in ([WRONG["between"]], look_alikes.truth,
                                             [look_alikes.truth[0]])]
    for order in (sets, sets[::-1]):
        best = judge.best_of(order)
        assert best.motions == right.motions
        assert best.cost == right.cost


def test_polishing_never_costs(judge, look_alikes):
    rough = judge.judge(on_base([slide(X, 0.31), look_alikes.truth[1]]))
    fine = judge.polished(rough)
    assert fine.cost <= rough.cost
    assert abs(fine.motions[0].value - 0.3) < 0.01


def test_as_many_parts_are_found_as_pay(judge, look_alikes, caplog):
    first, second = look_alikes.truth
    pool = [WRONG["across"], first, replace(first), second]
    with caplog.at_level("INFO", logger="part2gs_robotics.decide"):
        found, _ = decide(judge, pool, None)
    assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.005)
    assert caplog.messages[0].startswith("decide: nothing moves: cost")
    assert caplog.messages[-1].startswith("decide: one more:")


def test_the_search_goes_on_from_any_set(judge, right, look_alikes):
    """From too few parts, from too many, from one between two and from a false one beside."""
    first, second = look_alikes.truth
    pool = [*WRONG.values(), first, second]
    for start in ([first], [first, second, WRONG["up"]], [WRONG["between"]], [WRONG["across"]]):
        found = lowered(judge, judge.judge(on_base(start)), pool)
        assert found.cost == pytest.approx(right.cost, abs=PART), start
        assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.01)
    assert lowered(judge, right, pool) is right
    assert lowered(judge, right, []) is right


def test_a_change_that_calming_takes_back_is_none(judge, look_alikes, monkeypatch):
    """Else a turn and its lesser likeness, which is a little dearer, take turns for ever."""
    start, asked = judge.judge(on_base(look_alikes.truth[:1])), []

    def back(_judge, new, _pool):
        asked.append(new)
        assert len(asked) < 9
        return start

    monkeypatch.setattr("part2gs_robotics.decide.grow.calmed", back)
    assert lowered(judge, start, list(look_alikes.truth)) is start
    assert asked


def test_what_a_set_leaves_is_searched_again(judge, right, look_alikes):
    asked = []

    def again(left):
        asked.append(left)
        return list(look_alikes.truth)

    found, _ = decide(judge, [WRONG["between"]], None, again=again)
    assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.005)
    assert found.cost == pytest.approx(right.cost, abs=PART)
    assert len(asked) == 2, "once with one motion more, between refined to the other; once in vain"


def test_what_nothing_explains_is_what_moved(judge, right):
    none = judge.judge(on_base([]))
    left, less = judge.unexplained(none), judge.unexplained(right)
    moved = [judge.study.own(np.minimum(right.labels, 1), 1)[s].points for s in (0, 1)]
    for own, rest, points in zip(left.sets, less.sets, moved, strict=True):
        assert len(own) > 20
        assert len(rest) < 0.3 * len(own)
        gaps = np.linalg.norm(own.points[:, None] - points[None], axis=2).min(1)
        assert (gaps < 1e-9).mean() > 0.8


def test_more_is_found_in_what_is_left(judge, look_alikes):
    left = judge.unexplained(judge.judge(on_base([])))
    more = find_more(judge.study, left, np.random.default_rng(0), SearchConfig())
    slides = [h.move[:3, 3] for h in more if not h.turns]
    for true in look_alikes.truth:
        assert min(np.linalg.norm(way - true.move[:3, 3]) for way in slides) < 0.02
    none = type(left)(*(s.select(np.zeros(0, np.int64)) for s in left.sets))
    assert find_more(judge.study, none, np.random.default_rng(0), SearchConfig()) == []


def test_one_part_by_order_is_one_part(judge, look_alikes):
    found, _ = decide(judge, [WRONG["across"], *look_alikes.truth], 1)
    motion, = found.motions
    assert motion.value == pytest.approx(0.3, abs=0.005)


def test_without_hypotheses_or_with_wrong_ones_alone_nothing_moves(judge):
    for pool, parts in (([], None), ([], 2), ([WRONG["backwards"], WRONG["still"]], None)):
        assert decide(judge, pool, parts)[0].motions == ()


def test_fewer_parts_than_move_are_said_to_be_too_few(judge, look_alikes, caplog):
    pool = [*look_alikes.truth, *WRONG.values()]
    with caplog.at_level("INFO", logger="part2gs_robotics.decide"):
        assert decide(judge, pool, 1)[1]
    assert "one part more than asked for" in caplog.messages[-1]
    assert not decide(judge, pool, 2)[1]
    assert not decide(judge, pool, None)[1]


def test_what_refinement_leaves_in_its_place_is_not_judged_again(judge, right, monkeypatch):
    """It looks the same, and photos cost far more time than the refinement."""
    fine = right
    for _ in range(8):
        fine = judge.judge(on_base([
            refine(h, judge.study.own(fine.labels, k + 1), judge.lands, judge.study.taus)
            for k, h in enumerate(fine.motions)]))
    asked = []
    true = judge.judge
    monkeypatch.setattr(judge, "judge", lambda found: asked.append(found) or true(found))
    assert judge.polished(fine) is fine
    assert not asked
    moved = replace(fine.motions[0], value=fine.motions[0].value + 0.01)
    rough = true(fine.swapped(0, moved))
    assert judge.polished(rough).cost < rough.cost
    assert asked
