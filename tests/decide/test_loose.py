"""What hangs in the air is told of, and what a part only hides proves nothing."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from part2gs_robotics.decide.candidate import BORDER, PART, on_base
from part2gs_robotics.decide.labelling import NEUTRAL_COST, Unary
from part2gs_robotics.decide.loose import HELD, HIDES, behind, bodies_of, hanging, hung, vanished
from part2gs_robotics.evidence.landing import FREE_COST

NEAR = 0.25


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
    found, seen = vanished(Unary(match, target, miss), np.ones(len(match), np.int64))
    saved = FREE_COST - NEUTRAL_COST
    assert found == pytest.approx(max(gone * saved - HIDES * landing * FREE_COST, 0.0))
    lands = (np.arange(len(match)) >= gone) & (np.arange(len(match)) < gone + landing)
    np.testing.assert_array_equal(seen, np.where(lands | (found == 0), 1, 0))


@pytest.mark.parametrize("landing", [1, 6])
def test_hiding_what_a_better_proven_part_explains_as_well_gains_nothing(landing):
    """Two motions hide the same 40 surfels; the one that lands more is believed, the other not."""
    gone, lands = 40, landing + 20
    hard = np.repeat([1, 2, 1], [gone, 2 * landing, 2 * lands])
    match, target = np.zeros((len(hard), 3)), np.full((len(hard), 3), -1)
    miss = np.tile([FREE_COST, NEUTRAL_COST, NEUTRAL_COST], (len(hard), 1))
    miss[gone:, 1:] = FREE_COST
    for part, first, count in ((2, gone, landing), (1, gone + 2 * landing, lands)):
        here = first + np.arange(count)
        target[here, part], target[here + count, part] = here + count, here
    assert vanished(Unary(match, target, miss), hard)[0] == 0.0
    taken = np.where(np.arange(len(hard)) < gone, 2, hard)  # the worse one has them now
    found, seen = vanished(Unary(match, target, miss), taken)
    assert found == 0.0, "nothing is gained, so nothing is charged"
    alone = np.where(taken == 1, 0, taken)
    miss[:, 1] = FREE_COST  # without the better one's motion to explain them
    assert vanished(Unary(match, target, miss), alone)[0] == pytest.approx(max(
        gone * (FREE_COST - NEUTRAL_COST) - HIDES * 2 * landing * FREE_COST, 0.0))
    np.testing.assert_array_equal(seen, taken)


def test_photos_see_what_a_part_hides_as_the_best_other_label_has_it():
    """40 surfels hidden by motion 2; motion 1 lands them nearly as well, rest does not."""
    gone, lands = 40, 20
    hard = np.repeat([2, 1], [gone, 2 * lands])
    match, target = np.zeros((len(hard), 3)), np.full((len(hard), 3), -1)
    miss = np.tile([FREE_COST, NEUTRAL_COST + 0.1, NEUTRAL_COST], (len(hard), 1))
    miss[gone:, 1:] = FREE_COST
    here = gone + np.arange(lands)
    target[here, 1], target[here + lands, 1] = here + lands, here
    found, seen = vanished(Unary(match, target, miss), hard)
    assert found == pytest.approx(gone * 0.1), "beyond the better proven one, and nothing landed"
    np.testing.assert_array_equal(seen, 1)


def test_a_motion_that_nothing_has_proves_nothing():
    """40 surfels hidden by motion 2; motion 1 would hide them as well, and nothing moves by it."""
    count = 40
    match, target = np.zeros((count, 3)), np.full((count, 3), -1)
    miss = np.tile([FREE_COST, NEUTRAL_COST, NEUTRAL_COST], (count, 1))
    found, seen = vanished(Unary(match, target, miss), np.full(count, 2))
    assert found == pytest.approx(count * (FREE_COST - NEUTRAL_COST))
    np.testing.assert_array_equal(seen, 0)


def test_what_lands_nothing_is_seen_as_one_other():
    """Rest and motion 1 are each better for a half of what motion 2 hides, motion 1 a little."""
    gone, lands = 40, 20
    hard = np.repeat([2, 1], [gone, 2 * lands])
    match, target = np.zeros((len(hard), 3)), np.full((len(hard), 3), -1)
    miss = np.tile([FREE_COST, FREE_COST, NEUTRAL_COST], (len(hard), 1))
    half = np.arange(gone) < gone // 2
    miss[:gone, 0] = np.where(half, 0.4, 0.9)
    miss[:gone, 1] = np.where(half, 0.8, 0.4)
    here = gone + np.arange(lands)
    target[here, 1], target[here + lands, 1] = here + lands, here
    found, seen = vanished(Unary(match, target, miss), hard)
    assert found == pytest.approx(gone * (0.6 - NEUTRAL_COST)), "0.35 where each half has its own"
    np.testing.assert_array_equal(seen, 1)


def test_nothing_vanishes_where_nothing_moves():
    unary = Unary(np.zeros((5, 1)), np.full((5, 1), -1), np.full((5, 1), FREE_COST))
    still = np.zeros(5, np.int64)
    gain, seen = vanished(unary, still)
    assert gain == 0.0
    np.testing.assert_array_equal(seen, still)


@pytest.mark.parametrize(("place", "axis", "told"), [
    ((0.1, 0.1, 5.0), (0.0, 0.0, 1.0), True), ((0.1, 0.1, 5.0), (0.0, 0.0, -1.0), True),
    ((0.6, 0.6, 5.0), (0.0, 0.0, 1.0), False),  # a quarter of it
    ((0.1, 0.1, 5.0), (1.0, 0.0, 0.0), False), ((0.1, 0.1, 5.0), None, False)])
def test_what_lies_behind_the_front_of_a_slide_hangs_on_it(place, axis, told):
    """A plate of 0.8 behind one of 1; beside it, as it slides, or of a turn, it hangs."""
    steps = np.linspace(0.0, 1.0, 10)
    front = np.stack([*map(np.ravel, np.meshgrid(steps, steps)), np.zeros(100)], 1)
    back = 0.8 * front[:64] + place
    points, hard = np.concatenate([front, back]), np.ones(164, np.int64)
    body = np.repeat([7, 3], [100, 64])
    found = behind(body, hard, points, [None if axis is None else np.array(axis)])
    assert not found[:100].any()
    assert (found[100:] == told).all()
    assert not behind(np.full(164, 7), hard, points, [np.array([0.0, 0, 1])]).any()
