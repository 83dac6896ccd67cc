"""Parts leave again that no longer pay, or that images do not hold and that save little."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide import leave_out as prune
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
from part2gs_robotics.joints.carried import _proven
from part2gs_robotics.joints.tree import flat
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.hypothesis import hypothesis_of

SIGMAS = pytest.mark.parametrize("sigma", [0.1, np.inf, np.nan])


@pytest.fixture(scope="module")
def parts(look_alikes):
    """Both true joints, and one that is nearly the first and saves nothing beside it."""
    first, second = (Joint("prismatic", h.axis, h.origin, h.value, sigma_axis=0.5 * LOOSE,
                           seen=(0.5 * LOOSE, 1e-3)) for h in look_alikes.truth)
    return first, second, replace(first, value=1.01 * first.value)


def tree_of(judge, look_alikes, *joints):
    return flat(list(joints), judge.judge(look_alikes.truth).hard)


@SIGMAS
def test_a_part_that_images_do_not_hold_and_that_saves_little_is_left_out(
        judge, look_alikes, parts, sigma):
    first, second, copy = parts
    loose = replace(copy, seen=(sigma, 1e-3))
    left = held(judge, tree_of(judge, look_alikes, first, second, loose))
    assert (left.joints, left.parents, left.known) == ([first, second], (0, 0), (1, 2))
    np.testing.assert_array_equal(left.hard, judge.judge(look_alikes.truth).hard)


def test_a_part_whose_way_images_do_not_show_is_not_held(judge, look_alikes, parts):
    first, second, copy = parts
    loose = replace(copy, seen=(0.5 * LOOSE, np.inf))
    assert held(judge, tree_of(judge, look_alikes, first, second, loose)).joints == [first, second]


@pytest.mark.parametrize("seen", [(np.inf, np.inf), (np.inf, 1e-3), (0.1, 1e-3)])
@pytest.mark.parametrize(("share", "saved", "against", "stays"), [
    (1.1 * SHARED, 0.5 * MUCH, 0.5, True), (0.9 * SHARED, 0.5 * MUCH, 0.5, False),
    (0.9 * SHARED, 2.0 * MUCH, 0.5, True), (1.1 * SHARED, 2.0 * MUCH, 2.0, False),
    (1.1 * SHARED, 1.1 * FEW, 0.5, True), (1.1 * SHARED, 0.9 * FEW, 0.5, False)])
def test_a_part_whose_axis_is_firm_stays_where_both_states_show_it_and_it_saves_a_little(
        judge, look_alikes, parts, share, saved, against, stays, seen, monkeypatch):
    """Images do not show its axis, or its way neither; along an edge it may lie by chance.

    Its line may lie in the air: then the whole cost may be lower without it, whatever it saves.
    """
    first, second, copy = parts
    tree = tree_of(judge, look_alikes, first, second,
                   replace(copy, sigma_axis=0.9 * FIRM, seen=seen))
    monkeypatch.setattr(judge, "shared", lambda *_: np.array([1.0, 1.0, share]))
    price = 0.01
    monkeypatch.setattr(prune, "_gain", lambda _, now, k: (
        SimpleNamespace(cost=now.cost - against * price), saved * price, price))
    assert (held(judge, tree) is tree) == stays


def test_a_true_part_is_shared_and_one_that_a_state_hides_is_not(judge, look_alikes, right):
    n0, hard = len(judge.study.surfels[0]), right.hard.copy()
    both = judge.shared(look_alikes.truth, hard)
    assert (both > 2 * SHARED).all()
    rows = np.flatnonzero(hard == 2)
    hard[rows[rows >= n0][int(0.1 * (rows < n0).sum()):]] = 0
    hidden = judge.shared(look_alikes.truth, hard)
    assert hidden[0] == pytest.approx(both[0])
    assert hidden[1] < SHARED
    assert (judge.shared(look_alikes.truth, np.zeros_like(hard)) == 0).all()


@SIGMAS
def test_what_saves_much_stays_and_what_is_held(judge, look_alikes, parts, sigma):
    first, second, copy = parts
    for joints in ((first, replace(second, seen=(sigma, 1e-3))), (first, second, copy)):
        tree = tree_of(judge, look_alikes, *joints)
        assert held(judge, tree) is tree


@SIGMAS
def test_carriers_stay_and_numbers_follow(judge, look_alikes, parts, sigma):
    first, second, copy = parts
    loose = replace(copy, seen=(sigma, 1e-3))
    carrier = replace(tree_of(judge, look_alikes, first, loose, second), parents=(0, 0, 2))
    assert held(judge, carrier) is carrier
    beside = replace(tree_of(judge, look_alikes, loose, first, second), parents=(0, 0, 2))
    assert held(judge, beside).parents == (0, 1)


def test_one_part_must_stay(judge, look_alikes, parts):
    first, _, copy = parts
    both = tree_of(judge, look_alikes, *(replace(j, seen=(np.inf, np.inf)) for j in (first, copy)))
    assert len(held(judge, both).joints) >= 1
    assert len(pruned(judge, tree_of(judge, look_alikes, first)).joints) == 1


def test_parts_that_save_too_little_are_told_by_number(judge, look_alikes, parts):
    first, second, copy = parts
    assert unpaid(judge, tree_of(judge, look_alikes, first, second)) == []
    assert unpaid(judge, tree_of(judge, look_alikes, first, second, copy)) in ([1, 3], [3])
    assert unpaid(judge, tree_of(judge, look_alikes, copy)) == [], "the last one moves"
    carrier = replace(tree_of(judge, look_alikes, second, first, copy), parents=(0, 0, 2))
    assert 2 not in unpaid(judge, carrier)


def test_a_copy_no_longer_pays(judge, look_alikes, parts):
    first, second, copy = parts
    left = pruned(judge, tree_of(judge, look_alikes, first, second, copy))
    assert left.joints == [first, second]


@pytest.mark.parametrize(("share", "stays"), [(0.9, True), (1.8, True), (2.2, False)])
def test_a_part_without_which_one_motion_would_carry_what_nothing_joins_pays_half(
        judge, look_alikes, parts, share, stays, monkeypatch):
    """Beside `between`, the second block's own slide saves 1 / share of a part's price."""
    _, second, _ = parts
    between = replace(second, value=0.25)
    tree = tree_of(judge, look_alikes, between, second)
    now = judge.judge([hypothesis_of(j) for j in tree.joints])
    rest, gain, _ = _gain(judge, now, 1)
    assert _two_in_one(judge, now, rest)
    assert not _two_in_one(judge, now, now)
    monkeypatch.setattr(Judge, "price", lambda *_: share * gain)
    assert (len(pruned(judge, tree).joints) == 2) is stays
    monkeypatch.setattr("part2gs_robotics.decide.leave_out._two_in_one", lambda *_: False)
    assert (len(pruned(judge, tree).joints) == 2) is (share < 1.0)


def test_a_part_that_saves_nothing_leaves_before_anything_is_settled(judge, look_alikes, parts):
    first, second, copy = parts
    tree = tree_of(judge, look_alikes, first, second, copy)
    left = hopeful(judge, tree)
    assert (left.joints, left.known) == ([first, second], (1, 2))
    np.testing.assert_array_equal(left.hard, judge.judge(look_alikes.truth).hard)
    assert hopeful(judge, left) is left, "true parts stay"
    still = replace(first, value=0.0)
    assert hopeful(judge, tree_of(judge, look_alikes, still)).joints == [still], "the last one too"


@pytest.mark.parametrize(("parent", "stays"), [(0, True), (1, False)])
def test_a_carried_part_without_an_axis_is_left_out_whatever_it_saves(
        judge, look_alikes, parts, parent, stays):
    first, second, _ = parts
    blind = replace(second, sigma_axis=np.inf, seen=(np.inf, np.inf))
    tree = replace(tree_of(judge, look_alikes, first, blind), parents=(0, parent))
    assert (len(held(judge, tree).joints) == 2) is stays
    shown = replace(tree, joints=[first, replace(blind, sigma_axis=2 * FIRM)])
    assert held(judge, shown) is shown, "it saves much"


def test_another_motion_has_the_place_of_a_part_that_left(judge, look_alikes, parts):
    first, second, _ = parts
    false = replace(second, axis=np.array([0.0, 1, 0]))
    before = tree_of(judge, look_alikes, first, false)
    after = replace(flat([first], judge.judge(look_alikes.truth[:1]).hard), known=(1,))
    pool = [hypothesis_of(false), *look_alikes.truth]
    found = regrown(judge, before, after, pool)
    assert found.joints[0] is first
    assert found.joints[1].value == pytest.approx(second.value, abs=0.005)
    assert (found.parents, found.known) == ((0, 0), (1, 0))
    np.testing.assert_array_equal(found.hard, judge.judge(
        [hypothesis_of(j) for j in found.joints]).hard)
    assert regrown(judge, before, after, pool[:2]) is after, "what is there or false is not taken"
    assert regrown(judge, before, after, []) is after
    assert regrown(judge, after, after, pool) is after, "where nothing left nothing is sought"
    gone = tree_of(judge, look_alikes, first, second)
    assert regrown(judge, gone, after, pool) is after, "nor is what left"


@pytest.mark.parametrize("known", [True, False])
def test_a_settled_tree_is_proven_until_nothing_leaves(judge, look_alikes, parts, known,
                                                       monkeypatch):
    """A loose false part leaves, the true one has its place, and all settle once for that."""
    first, second, _ = parts
    false = replace(second, axis=np.array([0.0, 1, 0]), seen=(0.1, 1e-3))
    settled = []

    def settle(_judge, joints, hard, *_views_and_config):
        settled.append(len(joints))
        return [replace(j, seen=(0.5 * LOOSE, 1e-3)) for j in joints], hard

    monkeypatch.setattr("part2gs_robotics.joints.carried.settle", settle)
    tree = tree_of(judge, look_alikes, first, false)
    pool = look_alikes.truth if known else [hypothesis_of(false)]
    found = _proven(judge, tree, ArticulateConfig(), ((), ()), pool)
    ways = [0.3, 0.2] if known else [0.3]
    assert [j.value for j in found.joints] == pytest.approx(ways, abs=5e-3)
    assert settled == [len(found.joints)]
    sound = tree_of(judge, look_alikes, first, second)
    assert _proven(judge, sound, ArticulateConfig(), ((), ()), pool) is sound
    assert len(settled) == 1
