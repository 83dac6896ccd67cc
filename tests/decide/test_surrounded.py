"""A face amid another part joins it where it lies there as well, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.decide.labelling import Unary
from part2gs_robotics.decide.surrounded import GONE, TIE, joined
from part2gs_robotics.evidence.graph import Graph

RIM = 6  # surfels of a face that touch the next one
CREASE = 0.2


def faces(borders, sizes):
    """Graph of faces, each a ring in itself, whose rims touch where `borders` says."""
    starts = np.r_[0, np.cumsum(sizes)]
    neighbors, weights = np.zeros((starts[-1], 4), np.int32), np.ones((starts[-1], 4), np.float32)
    for start, size in zip(starts, sizes, strict=False):
        ring = (np.arange(size)[:, None] + np.array([-2, -1, 1, 2])) % size
        neighbors[start:start + size] = start + ring
    for number, (a, b) in enumerate(borders):
        one = starts[a] + RIM * (number % 3) + np.arange(RIM)
        two = starts[b + 1] - 1 - RIM * (number % 3) - np.arange(RIM)
        neighbors[one, 0], weights[one, 0] = two, CREASE
        neighbors[two, 3], weights[two, 3] = one, CREASE
    return Graph(neighbors, weights)


def landing(still, moved):
    """Faces 0..2 of state 0 land on 3..5 of state 1 and back; costs of every face, still, moved."""
    half = sum(SIZES[:3])
    other = np.r_[np.arange(half) + half, np.arange(half)]
    match = np.stack([np.repeat(cost * 2, SIZES) for cost in (still, moved)], 1)
    return Unary(match, np.stack([other, other], 1), np.full((2 * half, 2), 0.3))


def labels(*of_faces):
    return np.repeat(of_faces, SIZES)


SIZES = [30, 50, 50] * 2  # a top amid two sides, in both states
SEAT = [(0, 1), (0, 2), (0, 1), (3, 4), (3, 5), (3, 4)]
UP = np.tile([0.0, 0, 1], (sum(SIZES), 1))
STILL = np.zeros((sum(SIZES), 2)), sum(SIZES[:3])  # no motion carries anything far; end of state 0
TURNED = [0.4, 0.4]  # what sides cost under the other label


def test_a_face_that_lies_as_well_turned_joins_what_surrounds_it():
    hard = labels(0, 1, 1, 0, 1, 1)
    unary = landing([0.02, *TURNED], [0.02 + 0.8 * TIE, 0.02, 0.02])
    assert (joined(hard, unary, faces(SEAT, SIZES), UP, *STILL) == 1).all()
    assert np.array_equal(hard, labels(0, 1, 1, 0, 1, 1))  # what was handed in is as it was


def test_a_face_that_only_stays_is_left_alone():
    hard = labels(0, 1, 1, 0, 1, 1)
    unary = landing([0.02, *TURNED], [0.4, 0.02, 0.02])
    assert np.array_equal(joined(hard, unary, faces(SEAT, SIZES), UP, *STILL), hard)


def test_a_face_that_hangs_together_with_its_part_is_no_island():
    hard = labels(0, 1, 0, 0, 1, 0)
    both = [(0, 1), (0, 2), (3, 4), (3, 5)]
    unary = landing([0.02, 0.4, 0.02], [0.02, 0.02, 0.4])
    assert np.array_equal(joined(hard, unary, faces(both, SIZES), UP, *STILL), hard)


def test_faces_of_both_states_join_together_or_not_at_all():
    """In state 1 the top hangs together with a post: there it stays, so it does in state 0."""
    hard = labels(0, 1, 1, 0, 0, 1)
    unary = landing([0.02, 0.02, 0.02], [0.02, 0.4, 0.02])
    assert np.array_equal(joined(hard, unary, faces(SEAT, SIZES), UP, *STILL)[:30], hard[:30])


def test_a_post_beside_its_hinge_stays_though_it_hardly_moves():
    """It lies as well turned, and touches nothing but the door: but it is a body, no sheet."""
    hard = labels(0, 1, 1, 0, 1, 1)
    unary = landing([0.02, *TURNED], [0.02, 0.02, 0.02])
    around = np.linspace(0, 2 * np.pi, SIZES[0], endpoint=False)
    normals = UP.copy()
    for start in (0, sum(SIZES[:3])):
        normals[start:start + SIZES[0]] = np.stack([np.cos(around), np.sin(around), 0 * around], 1)
    assert np.array_equal(joined(hard, unary, faces(SEAT, SIZES), normals, *STILL), hard)
    assert (joined(hard, unary, faces(SEAT, SIZES), UP, *STILL) == 1).all()


def test_where_nothing_tells_the_larger_face_stays():
    hard = labels(0, 1, 1, 0, 1, 1)
    unary = landing([0.02] * 3, [0.02] * 3)
    assert (joined(hard, unary, faces(SEAT, SIZES), UP, *STILL) == 1).all()


@pytest.mark.parametrize("hard", [labels(0, 0, 0, 0, 0, 0), labels(1, 1, 1, 1, 1, 1)])
def test_one_part_has_no_islands(hard):
    unary = landing([0.02] * 3, [0.02] * 3)
    assert np.array_equal(joined(hard, unary, faces(SEAT, SIZES), UP, *STILL), hard)


WHEEL = [(0, 1), (3, 4)]  # a rim at its spokes, in both states; the base, the third, is elsewhere
FAR = np.tile([0.0, 2 * GONE], (sum(SIZES), 1)), sum(SIZES[:3])
AROUND = np.random.default_rng(0).normal(size=(sum(SIZES), 3))  # a body looks all ways
AROUND /= np.linalg.norm(AROUND, axis=1, keepdims=True)
RESTS = labels(0, 1, 0, 0, 1, 0)


def test_a_rim_that_only_spokes_hold_turns_with_them():
    unary = landing([0.02, 0.4, 0.02], [0.02 + 0.8 * TIE, 0.02, 0.4])
    new = joined(RESTS, unary, faces(WHEEL, SIZES), AROUND, *FAR)
    np.testing.assert_array_equal(new, labels(1, 1, 0, 1, 1, 0))


@pytest.mark.parametrize(("still", "moved"), [
    ([0.02, 0.4, 0.02], [0.02 + 1.2 * TIE, 0.02, 0.4]),  # a rim with a mark on it that stays
    ([0.30, 0.4, 0.02], [0.30, 0.02, 0.4]),  # nothing was met either way
])
def test_a_rim_that_nothing_shows_to_turn_stays(still, moved):
    new = joined(RESTS, landing(still, moved), faces(WHEEL, SIZES), AROUND, *FAR)
    np.testing.assert_array_equal(new, RESTS)


def test_what_hangs_on_the_base_as_well_or_hardly_moves_stays():
    unary = landing([0.02, 0.4, 0.02], [0.02, 0.02, 0.4])
    held = [*WHEEL, (0, 2), (3, 5)]  # the rim touches the base
    np.testing.assert_array_equal(joined(RESTS, unary, faces(held, SIZES), AROUND, *FAR), RESTS)
    near = 0.4 * FAR[0], FAR[1]  # the post of a hinge
    np.testing.assert_array_equal(joined(RESTS, unary, faces(WHEEL, SIZES), AROUND, *near), RESTS)


def test_the_base_itself_stays_though_a_cap_turns_on_it():
    """A bottle looks alike all around: it lies as well turned with its cap."""
    unary = landing([0.02] * 3, [0.02] * 3)
    hard = labels(0, 1, 1, 0, 1, 1)
    np.testing.assert_array_equal(joined(hard, unary, faces(SEAT, SIZES), AROUND, *FAR), hard)
