"""What hangs in the air is told of, and what a part only hides proves nothing."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from part2gs_robotics.decide.candidate import BORDER, PART, on_base
from part2gs_robotics.decide.judge import Judge, idle
from part2gs_robotics.decide.labelling import NEUTRAL_COST, Unary, label
from part2gs_robotics.decide.loose import HELD, HIDES, bodies_of, hanging, hung, proven, vanished
from part2gs_robotics.evidence.graph import Web
from part2gs_robotics.evidence.landing import FREE_COST
from part2gs_robotics.model.joint import Joint

NEAR = 0.25
SLIDE = Joint("prismatic", np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.3)


def plates(*places, labels=None):
    """Return labels, rows of neighbours and which touch, of plates of 100 points at places."""
    steps = np.linspace(0.0, 1.0, 10)
    plate = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1).reshape(-1, 2)
    points = np.concatenate([[*place, 0.0] + np.c_[plate, np.zeros(100)] for place in places])
    gaps, rows = cKDTree(points).query(points, 9)
    hard = np.repeat(np.arange(1, len(places) + 1) if labels is None else labels, 100)
    return hard, rows[:, 1:].astype(np.int32), gaps[:, 1:] < NEAR


def bodies(hard, rows, touching, met=None):
    return bodies_of(hard, np.full(len(hard), -1) if met is None else met, rows, touching)


def test_bodies_are_the_connected_pieces_of_every_part():
    near, apart = (0.0, 1.1), (5.0, 0.0)  # the second is a step beyond the first's edge
    hard, rows, touching = plates((0.0, 0.0), near, apart, labels=[1, 1, 1])
    body = bodies(hard, rows, touching)
    assert (body[:200] == body[0]).all()
    assert (body[200:] == body[200]).all()
    assert body[0] != body[200]
    assert len(np.unique(bodies(np.repeat([1, 2, 1], 100), rows, touching))) == 3


def test_what_meets_in_the_other_state_is_one_body():
    hard, rows, touching = plates((0.0, 0.0), (5.0, 0.0), labels=[1, 1])
    met = np.full(200, -1)
    assert hanging(hard, bodies(hard, rows, touching, met)).sum() == 100
    met[3] = 150
    assert not hanging(hard, bodies(hard, rows, touching, met)).any()


def test_one_body_of_every_part_hangs_on_nothing():
    """A part of two equal plates has one of them hanging, three parts of a plate each have none."""
    far = [(0.0, 0.0), (5.0, 0.0), (10.0, 0.0)]
    one = plates(*far, labels=[1, 1, 2])
    assert hanging(one[0], bodies(*one)).sum() == 100
    three = plates(*far)
    assert not hanging(three[0], bodies(*three)).any()
    still = plates(*far, labels=[0, 0, 0])
    assert not hanging(still[0], bodies(*still)).any(), "what rests may be anywhere"


@pytest.mark.parametrize(
    ("share", "told"), [(0.0, 0.0), (0.5, 0.0), (0.75, 0.5), (1.0, 1.0), (9.0, 1.0)]
)
def test_a_hanging_body_costs_more_than_a_part_unless_it_is_small(share, told):
    """Shares of the least body that pays a whole price."""
    count = 100_000
    body, loose = np.zeros(count, np.int64), np.arange(count) < round(share * PART / BORDER * count)
    assert hung(loose, body) == pytest.approx(HELD * told, abs=2e-3)


def test_two_bodies_in_one_part_are_dearer_than_two_parts(judge, right):
    """The blocks of two slides, in a state where they do not touch, under one motion."""
    late = np.arange(len(right.labels)) >= len(judge.study.surfels[0])
    one = on_base(right.motions[:1])
    own, both = (np.where(which & ~late, 1, 0) for which in (right.labels == 1, right.labels > 0))
    assert judge.unseen(one, own).parts == pytest.approx(1.0, abs=0.1)
    assert judge.unseen(one, both).parts == pytest.approx(1.0 + HELD, abs=0.1)


@pytest.mark.parametrize("landing", [0, 1, 3, 9, 12])
def test_what_a_part_hides_counts_as_far_as_it_lands(landing):
    """40 surfels seen gone at rest are hidden by a motion; a few more are landed by it."""
    gone, here = 40, np.arange(landing)
    match, target = np.zeros((gone + 2 * landing, 2)), np.full((gone + 2 * landing, 2), -1)
    miss = np.tile([FREE_COST, NEUTRAL_COST], (len(match), 1))
    target[gone + here, 1], target[gone + landing + here, 1] = gone + landing + here, gone + here
    target[gone + landing + here, 0] = gone + landing + here  # rest explains half of them as well
    excess, seen = vanished(Unary(match, target, miss), np.ones(len(match), np.int64))
    saved, found = FREE_COST - NEUTRAL_COST, excess.sum()
    assert excess[0] == 0.0, "what rests"
    assert found == pytest.approx(max(gone * saved - HIDES * landing * FREE_COST, 0.0))
    rests = np.arange(len(match)) < gone
    np.testing.assert_array_equal(seen, np.where(rests & (found > 0), 0, 1))


def test_nothing_vanishes_where_nothing_moves():
    unary = Unary(np.zeros((5, 1)), np.full((5, 1), -1), np.full((5, 1), FREE_COST))
    still = np.zeros(5, np.int64)
    gain, seen = vanished(unary, still)
    assert not gain.any()
    np.testing.assert_array_equal(seen, still)


def wall(gone, landing):
    """Return costs of surfels of one state under rest, a motion that hides all, one that lands.

    The first `gone` are seen gone at rest and hidden by motion 1; motion 2 lands all of them on the
    rest, somewhat off. Motion 1 lands `landing` of them well.
    """
    count = 2 * gone
    match, target = np.zeros((count, 3)), np.full((count, 3), -1)
    miss = np.tile([FREE_COST, NEUTRAL_COST, FREE_COST], (count, 1))
    here, there = np.arange(gone), gone + np.arange(gone)
    target[here, 2], target[there, 2], match[:, 2] = there, here, NEUTRAL_COST + 0.05
    target[:landing, 1] = there[:landing]
    target[there, 0] = there
    return Unary(match, target, miss)


@pytest.mark.parametrize("landing", [0, 3, 6])
def test_at_the_multiplier_of_one_labels_cost_what_they_cost_with_what_vanishes(landing):
    """What a part that proves too little costs is the same: no bound below is lower."""
    unary = wall(40, landing)
    hard = np.ones(80, np.int64)
    hard[40 + landing:] = 0
    excess, _ = vanished(unary, hard)
    assert excess[1] > 0
    cost = proven(unary, excess > 0).own(hard).sum()
    assert cost == pytest.approx(unary.own(hard).sum() + excess.sum())


def test_labels_go_to_what_lands_them_where_hiding_them_proves_nothing():
    """A motion hides a wall for less than another lands it; only what vanishes tells them apart."""
    unary, web = wall(40, 0), no_web(80)
    hides = label(unary, web, np.zeros(80, np.int64))
    assert (hides[:40] == 1).all()
    unproven = vanished(unary, hides)[0] > 0
    np.testing.assert_array_equal(unproven, [False, True, False])
    lands = label(proven(unary, unproven), web, hides)
    assert (lands[:40] == 2).all()
    assert not vanished(unary, lands)[0].any()


def no_web(count):
    nothing = np.zeros(0, np.int32)
    return Web(np.zeros(count + 1, np.int32), nothing, nothing, nothing)


def test_judged_labels_are_sought_again_where_a_part_hides_too_much():
    """Motion 1 hides the wall and lands a plate barely; motion 2 lands the wall dearly."""
    plate, barely = np.arange(30), 0.97
    match, target = np.zeros((60, 3)), np.full((60, 3), -1)
    target[plate, 1], target[30 + plate, 1], match[:, 1] = 110 + plate, 80 + plate, barely
    first = wall(40, 0)
    unary = Unary(np.concatenate([first.match, match]), np.concatenate([first.target, target]),
                  np.concatenate([first.miss, np.full((60, 3), FREE_COST)]))
    judge = SimpleNamespace(_unary=lambda _: unary, study=SimpleNamespace(web=no_web(140)),
                            unseen=lambda _, hard: SimpleNamespace(cost=whole(unary, hard)))
    alone = label(unary.resting, no_web(140), np.zeros(140, np.int64))
    assert (alone[:40] == 1).all()
    judged = Judge._proven(judge, on_base([SLIDE, SLIDE]), alone)
    assert (judged[:40] == 2).all()
    assert (judged[80:] == 1).all()
    assert whole(unary, judged) < whole(unary, alone)


def whole(unary, hard):
    """Return what labels cost with what vanishes."""
    return unary.resting.own(hard).sum() + vanished(unary.resting, hard)[0].sum()


def test_labels_that_leave_a_part_nothing_to_be_refined_on_are_not_taken(judge, look_alikes):
    """A slide twice too long hides a block; to rest it is cheaper, and would end its search."""
    found = on_base([replace(look_alikes.truth[0], value=0.6)])
    alone = judge.sort_out(found).labels
    assert vanished(judge._unary(found.motions).resting, alone)[0].any()
    assert judge.unseen(found, np.zeros_like(alone)).cost < judge.unseen(found, alone).cost
    assert not idle(1, judge.judge(found).labels)
