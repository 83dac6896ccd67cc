"""Decision: true motions win, copies and impossible ones do not, look-alikes are told apart."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import MIN_MET, on_base
from part2gs_robotics.decide.grow import NEARLY, _further, _otherwise, _two_at_once, decide
from part2gs_robotics.decide.judge import (
    MIN_SURFELS,
    PART_PRICE,
    PART_SHARE,
    SLOW_SHARE,
    Judge,
)
from part2gs_robotics.evidence.graph import build_graph
from part2gs_robotics.evidence.guides import guides_of
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread")
X, Y, Z = np.eye(3)


def slide(axis, value):
    return Joint("prismatic", axis, np.array([0.2, 0.4, 0.4]), value)


def rescored(found, **scores):
    """Return a judged candidate with other scores."""
    return replace(found, judged=replace(found.scores, **scores))


WRONG = {
    "across": slide(Y, 0.3), "up": slide(Z, 0.3), "backwards": slide(X, -0.3),
    "between": slide(X, 0.25), "still": slide(X, 0.0),
    "turn": Joint("revolute", Z, np.array([0.45, 0.4, 0.4]), np.pi),
}


@pytest.fixture(scope="module")
def best_alone(judge, look_alikes):
    """The lower cost of one true motion: the longer way leaves less unexplained."""
    return min(judge.judge(on_base([h])).cost for h in look_alikes.truth)


@pytest.mark.parametrize("world", ["slid", "turned"])
def test_no_wrong_motion_explains_surfels_as_well_as_the_true_one(world, request):
    seen = request.getfixturevalue(world)
    states = tuple(s.surfels for s in seen.states)
    judge = Judge(SimpleNamespace(surfels=states, lands=tuple(s.land for s in seen.states),
                                  graph=build_graph(states), tau=0.03,
                                  straight=guides_of([])))
    turning = world == "turned"
    origin = seen.origin if turning else np.array([0.2, 0.3, 0.4])
    truth = Joint("revolute" if turning else "prismatic", seen.axis, origin, seen.value)
    hard, best = judge.sort_out([truth])
    assert judge.met([truth], hard)[0] >= MIN_MET
    tilt = se3.rotation_from_rotvec(np.deg2rad(15) * Y) @ seen.axis
    others = [replace(truth, value=f * seen.value) for f in (-1.0, 0.7, 1.3)]
    others += [replace(truth, axis=tilt),
               replace(truth, kind="prismatic" if turning else "revolute")]
    for other in others:
        assert judge.sort_out([other])[1] > best + PART_PRICE, other
    assert judge.sort_out([])[1] > best + 10 * PART_PRICE


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_motion_beats_no_true_one(judge, right, best_alone, look_alikes, name):
    assert judge.judge(on_base([WRONG[name]])).cost > best_alone + PART_PRICE
    assert judge.judge(on_base([look_alikes.truth[0], WRONG[name]])).cost > right.cost + PART_PRICE
    assert judge.judge(right.plus(WRONG[name])).cost > right.cost - PART_PRICE


def test_both_true_motions_carry_their_own_blocks(judge, right, look_alikes):
    assert right.coherent
    found = judge.study.gaussian_labels(right.labels)
    for labels, owner, g in zip(found, look_alikes.owners, judge.study.gaussians, strict=True):
        away = g.means[:, 2] > 0.3  # the seam between block and base may go either way
        assert (labels == owner)[away].mean() > 0.97
        assert (labels == owner).mean() > 0.9
    assert right.cost == pytest.approx(right.scores.surfels + right.scores.images)
    assert all(judge.confidence(right, k) > 0.5 for k in (0, 1))


def test_a_copy_does_not_pay_and_nobody_needs_it(judge, right, look_alikes):
    twice = judge.judge(right.plus(replace(look_alikes.truth[0])))
    assert twice.cost > right.cost - PART_PRICE
    own = [(twice.labels == label).sum() for label in (1, 3)]
    assert min(own) < 0.05 * max(own), "copies do not share a block"
    assert max(judge.confidence(twice, k) for k in (0, 2)) < 0.05


def test_a_part_carries_its_own_surfels_of_one_state_onto_those_of_the_other(judge, right):
    n0, motions = len(judge.study.surfels[0]), right.motions
    one_way = np.where((np.arange(len(right.labels)) >= n0) & (right.labels == 1), 0, right.labels)
    assert judge.met(motions, one_way)[0] == 0.0, "seen in one state alone"
    assert judge.met(motions, one_way)[1] >= MIN_MET
    crossed = right.labels.copy()
    crossed[n0:] = np.array([0, 2, 1])[right.labels[n0:]]
    assert (judge.met(motions, crossed) < MIN_MET).all(), "one block becomes the other"
    own = np.flatnonzero(right.labels[:n0] == 1)
    top = np.array([0.225, 0.21, 0.5])  # middle of the block's upper face, seen by every view
    own = own[np.linalg.norm(judge.study.surfels[0].points[own] - top, axis=1).argsort()]
    for count in (5, 60):
        few = right.labels.copy()
        few[own[count:]] = 0
        assert (judge.met(motions, few)[0] > 0.0) == (count > MIN_SURFELS), "a floater is no part"
    assert judge.met([], np.zeros_like(right.labels)).shape == (0,)


def test_a_motion_without_a_body_leaves_and_the_others_stay(judge, right):
    """What stands still carries nothing that the base does not."""
    crowd = judge.judge(on_base([right.motions[0], WRONG["still"], right.motions[1]]))
    hard = crowd.labels.copy()
    hard[hard == 2] = 0  # nothing carries the label of the one that stands still
    crowd = rescored(replace(crowd, labels=hard), met=0.0)
    left = judge.bodies(crowd)
    assert [h.value for h in left.motions] == pytest.approx([h.value for h in right.motions])
    assert left.coherent
    assert left.cost == pytest.approx(right.cost, abs=PART_PRICE)
    assert judge.bodies(right) is right


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
    assert found.coherent
    assert caplog.messages[0].startswith("decide: nothing moves: cost")
    assert caplog.messages[-1].startswith("tune:")


def test_what_pays_but_is_spoken_against_is_taken_with_one_more(judge, right, look_alikes):
    none = judge.judge(on_base([]))
    first = judge.judge(on_base([look_alikes.truth[0]]))
    found = _further(judge, none, first, look_alikes.truth, True)
    assert len(found.motions) == 2
    assert found.improves(none)
    cheap = rescored(right, images=right.scores.images - 0.5)
    assert _further(judge, cheap, first, look_alikes.truth, True) is cheap


@pytest.mark.parametrize(("paid", "taken"), [(NEARLY + 0.1, 2), (NEARLY - 0.1, 0)])
def test_of_two_look_alikes_the_first_need_only_nearly_pay(judge, look_alikes, monkeypatch, paid,
                                                          taken):
    """The first hides most of what both leave; what the second saves is the proof of both."""
    first = judge.judge(on_base([look_alikes.truth[0]]))
    saved = paid * judge.price(first, first.cost)
    best = replace(first, motions=(), parents=(), known=())
    best = rescored(best, images=first.scores.images + saved)
    monkeypatch.setattr("part2gs_robotics.decide.grow.split", lambda _judge, found, *_: found)
    found = _otherwise(judge, best, first, look_alikes.truth, True, paid)
    assert len(found.motions) == taken
    assert taken == 0 or found.improves(best)


def test_two_slides_are_found_where_one_between_them_does_not_pay(judge, right, look_alikes,
                                                                  monkeypatch):
    none = judge.judge(on_base([]))
    axis, origin = look_alikes.truth[0].axis, look_alikes.truth[0].origin
    between = judge.judge(on_base([Joint("prismatic", axis, origin, 0.25)]))
    pool = [*look_alikes.truth, *between.motions]
    found = _two_at_once(judge, none, between, pool)
    assert sorted(h.value for h in found.motions) == pytest.approx([0.2, 0.3], abs=0.01)
    assert found.improves(none)
    cheap = rescored(right, images=right.scores.images - 1e-4)
    assert _two_at_once(judge, cheap, between, pool) is cheap, "two must pay"
    assert _two_at_once(judge, none, right, pool) is none, "bodies are not split"
    monkeypatch.setattr("part2gs_robotics.decide.candidate.MIN_MET", 2.0)
    assert _two_at_once(judge, none, between, pool) is none, "both must be bodies"


def test_one_part_by_order_is_one_part(judge, look_alikes):
    found, _ = decide(judge, [WRONG["across"], *look_alikes.truth], 1)
    motion, = found.motions
    assert motion.value == pytest.approx(0.3, abs=0.005)


def test_without_hypotheses_or_with_wrong_ones_alone_nothing_moves(judge):
    for pool, parts in (([], None), ([], 2), ([WRONG["across"], WRONG["up"]], None)):
        assert decide(judge, pool, parts)[0].motions == ()


def test_sets_that_help_both_come_first(judge, look_alikes, right):
    wrong = on_base([look_alikes.truth[0], WRONG["turn"]])
    assert not judge.judge(wrong).improves(right)
    best = judge.best_of([wrong, on_base(look_alikes.truth)], judge.judge(on_base([])))
    assert best.motions == tuple(look_alikes.truth)


def test_a_part_that_hardly_moves_must_save_more(judge, look_alikes, right):
    fast = judge.price(right, 1.0)
    crawl = [slide(X, 0.02 * look_alikes.study.diag), look_alikes.truth[1]]
    slow = replace(right, motions=tuple(crawl))
    assert fast == pytest.approx(PART_SHARE)
    assert judge.price(slow, 1.0) == pytest.approx(SLOW_SHARE)
    assert judge.price(right, 0.0) == PART_PRICE


def test_fewer_parts_than_move_are_said_to_be_too_few(judge, look_alikes, caplog):
    pool = [*look_alikes.truth, *WRONG.values()]
    with caplog.at_level("INFO", logger="part2gs_robotics.decide"):
        assert decide(judge, pool, 1)[1]
    assert "one part more than asked for" in "".join(caplog.messages[-3:])
    assert not decide(judge, pool, 2)[1]
    assert not decide(judge, pool, None)[1]
