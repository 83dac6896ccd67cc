"""Candidate: parents, numbers and carriers stay true whatever changes, and what a set costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import PART, STRANGE, Candidate, Scores, on_base, price
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread")
X, Y, Z = np.eye(3)
DOOR = Joint("revolute", -Z, np.array([0.0, -0.05, 0.3]), 0.8)
FLAP = Joint("revolute", -X, np.array([0.5, -0.07, 0.35]), 1.1)
SCORES = Scores(0.1, 0.2)
# Parents of four parts, carriers first or last, and one that is carried by a carried one.
PARENTS = [(0, 0, 0, 0), (3, 0, 0, 2), (0, 1, 1, 0), (2, 0, 1, 0), (0, 0, 4, 0)]


def tree(parents):
    """Return a judged candidate of four parts, each with a value, a number and surfels of its own.

    Surfel n, and n + 5, belongs to part n.
    """
    motions = tuple(replace(FLAP, value=0.1 * (k + 1)) for k in range(4))
    return Candidate(motions, np.tile(np.arange(5), 2), SCORES, parents, (4, 1, 0, 2))


def family(found):
    """Return, by the value of every part, that of its carrier, its number and its surfels."""
    carriers = [None, *(h.value for h in found.motions)]
    return {h.value: (carriers[parent], known, tuple(np.flatnonzero(found.labels == k + 1)))
            for k, (h, parent, known) in enumerate(zip(found.motions, found.parents, found.known,
                                                       strict=True))}


def kinship(found):
    """Return, by the value of every part, that of its carrier and its number."""
    return {value: row[:2] for value, row in family(found).items()}


def test_parts_on_the_base_are_numbered_in_order_and_not_judged():
    found = on_base([DOOR, FLAP])
    assert (found.motions, found.parents, found.known) == ((DOOR, FLAP), (0, 0), (1, 2))
    assert len(found) == 2
    assert found.labels.shape == (0,)
    assert found.judged is None


@pytest.mark.parametrize("parents", PARENTS)
@pytest.mark.parametrize("carrier", [0, 3])
def test_one_more_changes_nothing_of_the_others(parents, carrier):
    before = tree(parents)
    after = before.plus(DOOR, carrier)
    assert after.motions == (*before.motions, DOOR)
    assert (after.parents, after.known) == ((*parents, carrier), (*before.known, 0))
    back = after.without(4)
    assert (back.motions, back.parents, back.known) == (before.motions, parents, before.known)


@pytest.mark.parametrize("parents", PARENTS)
def test_those_that_stay_keep_their_carriers_and_numbers(parents):
    before = tree(parents)
    for k in range(4):
        if k + 1 in parents:
            continue  # it carries one
        expected = kinship(before)
        del expected[before.motions[k].value]
        assert kinship(before.without(k)) == expected


@pytest.mark.parametrize("parents", PARENTS)
def test_another_motion_has_the_place_of_one_and_may_hang_elsewhere(parents):
    before = tree(parents)
    for k in range(4):
        after = before.swapped(k, DOOR)
        assert after.motions[k] is DOOR
        assert after.without(k).motions == before.without(k).motions
        assert (after.parents, after.known) == (parents, before.known)
        for parent in {0, 1, 2, 3, 4} - {k + 1}:
            moved = before.swapped(k, DOOR, parent)
            assert moved.parents == (*parents[:k], parent, *parents[k + 1:])


@pytest.mark.parametrize("parents", PARENTS)
def test_sorting_carriers_first_renumbers_and_says_the_same(parents):
    before = tree(parents)
    after = before.carriers_first()
    assert family(after) == family(before)
    assert all(parent <= k for k, parent in enumerate(after.parents))
    assert after.scores is SCORES


def test_carriers_come_before_what_they_carry():
    joints = tuple(replace(FLAP, value=float(k)) for k in range(4))
    found = Candidate(joints, np.array([0, 1, 2, 3, 4]), None, (3, 0, 0, 2), (1, 2, 3, 0))
    out = found.carriers_first()
    assert [j.value for j in out.motions] == [1.0, 2.0, 0.0, 3.0]
    assert out.parents == (0, 0, 2, 1)
    assert out.labels.tolist() == [0, 3, 1, 2, 4]
    assert out.known == (2, 3, 1, 0)


def test_carriers_motions_follow_their_joints():
    found = on_base([DOOR]).plus(replace(FLAP, carrier=np.eye(4)), 1)
    found = found.with_motions(found.motions)
    np.testing.assert_array_equal(found.motions[1].carrier, DOOR.state1_from_0)


@pytest.mark.parametrize("parents", PARENTS)
def test_every_carried_part_goes_where_its_carrier_takes_it_now(parents):
    """Also where what carries it is carried: a key in the lock of a door."""
    before = tree(parents).carriers_first()
    new = [replace(DOOR, value=h.value + 0.05) for h in before.motions]
    after = before.with_motions(iter(new))
    assert (after.parents, after.known) == (before.parents, before.known)
    np.testing.assert_array_equal(after.labels, before.labels)
    for h, given, parent in zip(after.motions, new, after.parents, strict=True):
        if parent:
            carrier = after.motions[parent - 1].state1_from_0
            np.testing.assert_array_equal(h.carrier, carrier)
            np.testing.assert_array_equal(h.own, given.own)
            np.testing.assert_allclose(h.state1_from_0, carrier @ given.state1_from_0)
        else:
            assert h is given


def test_whatever_changes_is_not_judged_yet():
    found = tree((0, 1, 0, 0))
    assert found.cost == found.scores.cost == SCORES.cost
    for new in (found.plus(DOOR), found.without(2), found.swapped(1, FLAP),
                found.swapped(2, FLAP, 1), found.with_motions(found.motions), on_base([DOOR])):
        for ask in (lambda c: c.scores, lambda c: c.cost):
            with pytest.raises(AssertionError, match="asked for before it is judged"):
                ask(new)


def test_what_a_change_is_made_from_stays_as_it_was():
    found = tree((3, 0, 0, 2))
    before = family(found)
    for new in (found.plus(DOOR), found.without(0), found.swapped(1, DOOR, 3),
                found.with_motions([DOOR] * 4), found.carriers_first()):
        assert family(new) != before or new.motions != found.motions
    assert family(found) == before
    assert found.scores is SCORES


@pytest.mark.parametrize("term", ["surfels", "images", "seams", "strange", "parts"])
def test_every_term_counts_in_one_sum(term):
    weights = {"surfels": 1.0, "images": 1.0, "seams": 1.0, "strange": STRANGE, "parts": PART}
    start = Scores(0.1, 0.2, 0.03, 0.5, 2)
    more = replace(start, **{term: getattr(start, term) + 1})
    assert more.cost - start.cost == pytest.approx(weights[term])
    assert more.left - start.left == pytest.approx(0.0 if term == "parts" else weights[term])


def test_what_is_judged_is_charged_for_its_parts_and_carriers(judge, right, look_alikes):
    assert right.scores.parts == 2
    alone = judge.judge(on_base(look_alikes.truth[:1]))
    assert alone.scores.parts == 1
    carried = replace(right, parents=(0, 1))
    assert judge.judge(carried).scores.parts == 3, "what carries a part is told as well"


@pytest.mark.parametrize(("share", "told"), [(0.0, 0.5), (PART, 0.5), (1.5 * PART, 0.75),
                                             (2 * PART, 1.0), (0.3, 1.0)])
def test_a_small_part_pays_half_a_price_at_least_and_a_large_one_no_more_than_one(share, told):
    """A half of what its surfels save where each was contradicted, between the two."""
    assert price(share) == pytest.approx(told)
