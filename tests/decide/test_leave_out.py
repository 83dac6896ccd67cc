"""Parts leave again that no longer pay, or that images do not hold and that save little."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.decide import leave_out
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.leave_out import (
    FEW,
    FIRM,
    LOOSE,
    MUCH,
    SHARED,
    _gain,
    _two_in_one,
    held,
    hopeful,
    pruned,
    regrown,
    unpaid,
)
from part2gs_robotics.model.joint import Joint

SIGMAS = pytest.mark.parametrize("sigma", [0.1, np.inf, np.nan])


@pytest.fixture(scope="module")
def parts(look_alikes):
    """Both true joints, and one that is nearly the first and saves nothing beside it."""
    first, second = (Joint("prismatic", h.axis, h.origin, h.value, sigma_axis=0.5 * LOOSE,
                           seen=(0.5 * LOOSE, 1e-3)) for h in look_alikes.truth)
    return first, second, replace(first, value=1.01 * first.value)


def settled(right, *joints):
    """Return joints on the base with the labels of the true ones."""
    return on_base(joints, right.labels)


@SIGMAS
def test_a_part_that_images_do_not_hold_and_that_saves_little_is_left_out(
        judge, right, parts, sigma):
    first, second, copy = parts
    loose = replace(copy, seen=(sigma, 1e-3))
    left = held(judge, settled(right, first, second, loose))
    assert (left.motions, left.parents, left.known) == ((first, second), (0, 0), (1, 2))
    np.testing.assert_array_equal(left.labels, right.labels)


def test_a_part_whose_way_images_do_not_show_is_not_held(judge, right, parts):
    first, second, copy = parts
    loose = replace(copy, seen=(0.5 * LOOSE, np.inf))
    assert held(judge, settled(right, first, second, loose)).motions == (first, second)


@pytest.mark.parametrize("seen", [(np.inf, np.inf), (np.inf, 1e-3), (0.1, 1e-3)])
@pytest.mark.parametrize(("share", "saved", "against", "stays"), [
    (1.1 * SHARED, 0.5 * MUCH, 0.5, True), (0.9 * SHARED, 0.5 * MUCH, 0.5, False),
    (0.9 * SHARED, 2.0 * MUCH, 0.5, True), (1.1 * SHARED, 2.0 * MUCH, 2.0, False),
    (1.1 * SHARED, 1.1 * FEW, 0.5, True), (1.1 * SHARED, 0.9 * FEW, 0.5, False)])
def test_a_part_whose_axis_is_firm_stays_where_both_states_show_it_and_it_saves_a_little(
        judge, right, parts, share, saved, against, stays, seen, monkeypatch):
    """Images do not show its axis, or its way neither; along an edge it may lie by chance.

    Its line may lie in the air: then the whole cost may be lower without it, whatever it saves.
    """
    first, second, copy = parts
    found = settled(right, first, second,
                    replace(copy, sigma_axis=0.9 * FIRM, seen=seen))
    monkeypatch.setattr(judge, "shared", lambda *_: np.array([1.0, 1.0, share]))
    price = 0.01
    monkeypatch.setattr(leave_out, "_gain", lambda _, now, k: (
        SimpleNamespace(cost=now.cost - against * price), saved * price, price))
    assert (held(judge, found) is found) == stays


def test_a_true_part_is_shared_and_one_that_a_state_hides_is_not(judge, look_alikes, right):
    n0, hard = len(judge.study.surfels[0]), right.labels.copy()
    both = judge.shared(look_alikes.truth, hard)
    assert (both > 2 * SHARED).all()
    rows = np.flatnonzero(hard == 2)
    hard[rows[rows >= n0][int(0.1 * (rows < n0).sum()):]] = 0
    hidden = judge.shared(look_alikes.truth, hard)
    assert hidden[0] == pytest.approx(both[0])
    assert hidden[1] < SHARED
    assert (judge.shared(look_alikes.truth, np.zeros_like(hard)) == 0).all()


@SIGMAS
def test_what_saves_much_stays_and_what_is_held(judge, right, parts, sigma):
    first, second, copy = parts
    for joints in ((first, replace(second, seen=(sigma, 1e-3))), (first, second, copy)):
        found = settled(right, *joints)
        assert held(judge, found) is found


@SIGMAS
def test_carriers_stay_and_numbers_follow(judge, right, parts, sigma):
    first, second, copy = parts
    loose = replace(copy, seen=(sigma, 1e-3))
    carrier = replace(settled(right, first, loose, second), parents=(0, 0, 2))
    assert held(judge, carrier) is carrier
    beside = replace(settled(right, loose, first, second), parents=(0, 0, 2))
    assert held(judge, beside).parents == (0, 1)


def test_one_part_must_stay(judge, right, parts):
    first, _, copy = parts
    both = settled(right, *(replace(j, seen=(np.inf, np.inf)) for j in (first, copy)))
    assert len(held(judge, both)) >= 1
    assert len(pruned(judge, settled(right, first))) == 1


def test_parts_that_save_too_little_are_told_by_number(judge, right, parts):
    first, second, copy = parts
    assert unpaid(judge, settled(right, first, second)) == []
    assert unpaid(judge, settled(right, first, second, copy)) in ([1, 3], [3])
    assert unpaid(judge, settled(right, copy)) == [], "the last one moves"
    carrier = replace(settled(right, second, first, copy), parents=(0, 0, 2))
    assert 2 not in unpaid(judge, carrier)


def test_a_copy_no_longer_pays(judge, right, parts):
    first, second, copy = parts
    left = pruned(judge, settled(right, first, second, copy))
    assert left.motions == (first, second)


@pytest.mark.parametrize(("share", "stays"), [(0.9, True), (1.8, True), (2.2, False)])
def test_a_part_without_which_one_motion_would_carry_what_nothing_joins_pays_half(
        judge, right, parts, share, stays, monkeypatch):
    """Beside `between`, the second block's own slide saves 1 / share of a part's price."""
    _, second, _ = parts
    between = replace(second, value=0.25)
    found = settled(right, between, second)
    now = judge.judge(found)
    rest, gain, _ = _gain(judge, now, 1)
    assert _two_in_one(judge, now, rest)
    assert not _two_in_one(judge, now, now)
    monkeypatch.setattr(Judge, "price", lambda *_: share * gain)
    assert (len(pruned(judge, found)) == 2) is stays
    monkeypatch.setattr("part2gs_robotics.decide.leave_out._two_in_one", lambda *_: False)
    assert (len(pruned(judge, found)) == 2) is (share < 1.0)


def test_a_part_that_saves_nothing_leaves_before_anything_is_settled(judge, right, parts):
    first, second, copy = parts
    found = settled(right, first, second, copy)
    left = hopeful(judge, found)
    assert (left.motions, left.known) == ((first, second), (1, 2))
    np.testing.assert_array_equal(left.labels, right.labels)
    assert hopeful(judge, left) is left, "true parts stay"
    still = replace(first, value=0.0)
    assert hopeful(judge, settled(right, still)).motions == (still,), "the last one too"


@pytest.mark.parametrize(("parent", "stays"), [(0, True), (1, False)])
def test_a_carried_part_without_an_axis_is_left_out_whatever_it_saves(
        judge, right, parts, parent, stays):
    first, second, _ = parts
    blind = replace(second, sigma_axis=np.inf, seen=(np.inf, np.inf))
    found = replace(settled(right, first, blind), parents=(0, parent))
    assert (len(held(judge, found)) == 2) is stays
    shown = replace(found, motions=(first, replace(blind, sigma_axis=2 * FIRM)))
    assert held(judge, shown) is shown, "it saves much"


def test_another_motion_has_the_place_of_a_part_that_left(judge, right, look_alikes, parts):
    first, second, _ = parts
    false = replace(second, axis=np.array([0.0, 1, 0]))
    before = settled(right, first, false)
    after = on_base([first], judge.judge(on_base(look_alikes.truth[:1])).labels)
    pool = [false, *look_alikes.truth]
    found = regrown(judge, before, after, pool)
    assert found.motions[0] is first
    assert found.motions[1].value == pytest.approx(second.value, abs=0.005)
    assert (found.parents, found.known) == ((0, 0), (1, 0))
    np.testing.assert_array_equal(found.labels, judge.judge(found).labels)
    assert regrown(judge, before, after, pool[:2]) is after, "what is there or false is not taken"
    assert regrown(judge, before, after, []) is after
    assert regrown(judge, after, after, pool) is after, "where nothing left nothing is sought"
    gone = settled(right, first, second)
    assert regrown(judge, gone, after, pool) is after, "nor is what left"
