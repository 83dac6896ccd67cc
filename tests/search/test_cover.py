"""Choice of motions: a facility location with answers known in closed form."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.cover import UNEXPLAINED, choose, cover, explained, saved_matrix


def value(saved, rows, price):
    return (saved[list(rows)].max(0).sum() if rows else 0.0) - price * len(rows)


def test_each_row_must_save_its_price():
    saved = np.array([[1.0, 1, 1, 0, 0], [0, 0, 0, 1, 1]])
    assert sorted(cover(saved, 1.5)) == [0, 1]
    assert cover(saved, 2.5) == [0]
    assert cover(saved, 3.5) == []


def test_without_hypotheses_nothing_is_chosen(slid):
    assert cover(np.zeros((0, 5)), 1.0) == []
    evidence, lands = evidence_of(slid)
    assert choose([], evidence, lands, 2.0, 1.0) == []


def test_a_copy_is_not_paid_for_twice():
    saved = np.array([[1.0, 1, 0], [1.0, 1, 0], [0, 0, 1]])
    rows = cover(saved, 0.1)
    assert len(rows) == 2
    assert 2 in rows


def test_the_greedy_first_choice_is_dropped_when_others_replace_it():
    """Row 0 saves most alone; rows 1 and 2 together save all, after which it saves nothing."""
    saved = np.array([[1.0, 1, 1, 1, 0, 0], [1, 1, 0, 0, 1, 0], [0, 0, 1, 1, 0, 1]])
    saved[0] *= 0.95
    assert sorted(cover(saved, 0.5)) == [1, 2]


@pytest.mark.parametrize("seed", range(6))
def test_the_choice_is_at_least_a_swap_from_no_better(seed):
    rng = np.random.default_rng(seed)
    saved = np.maximum(rng.normal(size=(7, 20)), 0)
    price = 1.5
    chosen = cover(saved, price)
    best = max(value(saved, rows, price) for n in range(5) for rows in combinations(range(7), n))
    found = value(saved, chosen, price)
    assert found >= 0.97 * best
    others = [r for r in range(7) if r not in chosen]
    for j in others:
        assert value(saved, [*chosen, j], price) <= found + 1e-9
        for d in chosen:
            swapped = [c for c in chosen if c != d] + [j]
            assert value(saved, swapped, price) <= found + 1e-9


def evidence_of(world):
    move = se3.make(np.eye(3), world.axis * world.value)
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    sets = []
    for state, back in ((0, np.eye(4)), (1, se3.inverse(move))):
        s = world.states[state].surfels
        points = se3.apply(back, s.points)
        own = ((points > lo - 0.005) & (points < hi + 0.005)).all(1)
        sets.append(s.select(own & (points[:, 2] > lo[2] + 0.03)))
    return Evidence(*sets), (world.states[0].land, world.states[1].land)


def test_the_true_motion_explains_its_evidence_and_staying_none(slid):
    evidence, lands = evidence_of(slid)
    truth = Joint("prismatic", slid.axis, np.zeros(3), slid.value)
    zero, one = explained(truth, evidence, lands, 0.03)
    assert np.concatenate([zero, one]).mean() > 0.8 * UNEXPLAINED
    still = Joint("prismatic", slid.axis, np.zeros(3), 0.0)
    saved = saved_matrix([truth, still], evidence, lands, 2.0)
    assert saved.shape == (2, len(evidence.vacated) + len(evidence.arrived))
    assert (saved >= 0).all()
    assert saved[0].sum() > 3 * saved[1].sum()


def test_choosing_keeps_the_true_motion_and_polishes_a_rough_one(slid):
    evidence, lands = evidence_of(slid)
    axis = np.array([1.0, 0.02, -0.02])
    rough = Joint("prismatic", axis / np.linalg.norm(axis), np.array([0.2, 0.3, 0.4]), 0.29)
    wrong = [Joint("prismatic", np.eye(3)[i], np.zeros(3), d) for i in (1, 2) for d in (-0.4, 0.4)]
    chosen = choose([*wrong, rough], evidence, lands, 2.0, 20.0)
    assert len(chosen) == 1
    h, gain = chosen[0]
    assert gain > 20.0
    assert np.allclose(h.axis * h.value, slid.axis * slid.value, atol=0.003)
