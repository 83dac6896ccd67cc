"""Surfels are carried by the motion that explains them, and no motion is kept for nothing."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from part2gs_robotics.decide.labelling import (
    FOREIGN_COST,
    NEUTRAL_COST,
    UNSEEN_MOVES,
    Unary,
    energy_of,
    label,
    unary_costs,
)
from part2gs_robotics.evidence.graph import Graph, build_graph, web_of
from part2gs_robotics.evidence.landing import FREE_COST
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

TAU = 0.03


def labelled(unary, graph, start=None, bonds=None, asked=None):
    """Return labels from all at rest, or from `start`, and their energy with the bonds they cut."""
    bonds = np.zeros(graph.weights.shape, np.float32) if bonds is None else bonds
    start = np.zeros(len(unary.match), np.int64) if start is None else start
    hard = label(unary, web_of(graph, bonds), start, asked)
    cut = (bonds * (hard[:, None] != hard[graph.neighbors])).sum(dtype=np.float64)
    return hard, energy_of(unary, graph, hard) + float(cut)


def parts_of(world):
    """Return surfels, landing grids, the true motion, and which surfels are surely the part's."""
    states = tuple(s.surfels for s in world.states)
    lands = tuple(s.land for s in world.states)
    truth = Joint("prismatic", world.axis, np.array([0.2, 0.3, 0.4]), world.value)
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    own = []
    for s, back in zip(states, (np.eye(4), se3.inverse(truth.move)), strict=True):
        points = se3.apply(back, s.points)
        own.append(((points > lo - 0.005) & (points < hi + 0.005)).all(1))
    return states, lands, truth, np.concatenate(own)


def test_two_boxes_one_moved_are_told_apart(slid):
    states, lands, truth, own = parts_of(slid)
    unary = unary_costs([np.eye(4), truth.move], states, lands, TAU)
    hard, energy = labelled(unary, build_graph(states))
    points = np.concatenate([s.points for s in states])
    seam = np.abs(points[:, 2] - slid.block.lo[2]) < 0.04  # within two voxels of the other box
    assert (hard == own)[~seam].mean() > 0.97
    assert (hard == own).mean() > 0.93
    alone = unary_costs([np.eye(4)], states, lands, TAU)
    still = labelled(alone, build_graph(states))
    assert not still[0].any()
    assert still[1] > energy + 200


def test_meeting_a_surfel_that_another_part_carries_costs_more():
    """One surfel, met by both motions: who owns the target decides, up to the miss."""
    unary = Unary(np.array([[0.1, 0.0], [0.0, 0.0]]), np.array([[1, 1], [-1, -1]]),
                  np.array([[FREE_COST, NEUTRAL_COST], [FREE_COST, NEUTRAL_COST]]))
    cost = unary.cost(np.array([[0.5, 0.5], [1.0, 0.0]]))
    assert cost[0] == pytest.approx([0.1, FOREIGN_COST])
    assert cost[1] == pytest.approx([FREE_COST, NEUTRAL_COST])


def test_what_hard_labels_cost_each_is_a_column_of_what_soft_ones_do():
    rng = np.random.default_rng(0)
    count, labels = 60, 3
    unary = Unary(rng.random((count, labels)), rng.integers(-1, count, (count, labels)),
                  rng.random((count, labels)), 0.2 * rng.random((count, labels)))
    hard = rng.integers(0, labels, count)
    every = unary.cost(np.eye(labels)[hard])
    np.testing.assert_allclose(unary.own(hard), every[np.arange(count), hard], rtol=1e-14)


def test_neighbours_outvote_a_neutral_surfel_but_not_a_clear_one():
    n = 11
    neighbors = np.array([[j for j in range(n) if j != i] for i in range(n)], np.int32)
    graph = Graph(neighbors, np.ones((n, n - 1), np.float32))
    none = np.full((n, 2), -1)
    miss = np.tile([0.0, 1.0], (n, 1))
    miss[0] = [0.3, 0.3]
    hard, _ = labelled(Unary(miss, none, miss), graph)
    assert hard[0] == 0
    miss[0] = [3.0, 0.0]
    hard, energy = labelled(Unary(miss, none, miss), graph)
    assert hard[0] == 1
    assert energy == pytest.approx(0.12 * 20)  # ten cut neighbours, seen from both ends


def test_what_nothing_shows_rests():
    """Unseen at rest and moved, ten neighbours half and half: the base has it."""
    neighbors = np.array([[j for j in range(11) if j != i] for i in range(11)], np.int32)
    graph = Graph(neighbors, np.ones((11, 10), np.float32))
    none, miss = np.full((11, 2), -1), np.full((11, 2), NEUTRAL_COST)
    half = np.arange(11) % 2
    hard, energy = labelled(Unary(miss, none, miss).resting, graph, half)
    assert not hard.any()
    assert energy == pytest.approx(11 * NEUTRAL_COST)
    seen = Unary(miss, none, np.tile([FREE_COST, NEUTRAL_COST], (11, 1)))
    hard, energy = labelled(seen.resting, graph, half)
    assert hard.all()  # seen empty at rest: a tie no more
    assert energy == pytest.approx(11 * (NEUTRAL_COST + UNSEEN_MOVES))
    np.testing.assert_array_equal(seen.resting.miss[:, 0], FREE_COST)
    np.testing.assert_allclose(seen.resting.miss[:, 1], NEUTRAL_COST + UNSEEN_MOVES)


def wall_between_two_drawers(width, high=40, deep=5):
    """A wall that slides along itself under both drawers' motions; only its rims show it rests."""
    wide = width + 2 * deep
    row, column = np.divmod(np.arange(high * wide), wide)
    steps = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)]
    ring = [np.clip(row + a, 0, high - 1) * wide + np.clip(column + b, 0, wide - 1)
            for a, b in steps]
    first, second = column < deep, column >= width + deep
    target = np.tile(np.arange(len(row))[:, None], (1, 3))
    target[first[:, None] & (np.arange(3) != 1)] = -1
    target[second[:, None] & (np.arange(3) != 2)] = -1
    target[~first & ~second & ((row == 0) | (row == high - 1)), 1:] = -1
    unary = Unary(np.zeros(target.shape), target, np.full(target.shape, FREE_COST))
    graph = Graph(np.stack(ring, 1).astype(np.int32), np.ones((len(row), 8), np.float32))
    return unary, graph, np.where(first, 1, np.where(second, 2, 0))


@pytest.mark.parametrize("width", [10, 40])
@pytest.mark.parametrize("first", [0, 1])
def test_a_shared_wall_rests_or_not_whichever_costs_less(width, first):
    """A wide wall rests; a narrow one is cheaper shared. From rest and from any part's labels."""
    unary, graph, rests = wall_between_two_drawers(width)
    shared = np.where(rests == 2, 2, 1)
    start = np.full(len(rests), first)
    hard, energy = labelled(unary, graph, start)
    assert energy <= min(energy_of(unary, graph, rests), energy_of(unary, graph, shared)) + 1e-3
    row, column = np.divmod(np.arange(len(hard)), width + 10)
    inside = (row > 10) & (row < 29) & (column > 5) & (column < width + 4)
    assert (hard[inside] == 0).all() == (width == 40)


def few_surfels(rng, count=7, labels=3):
    """Return landings, neighbours and bonds of a few surfels at random."""
    others = np.stack([rng.permutation(np.delete(np.arange(count), i))[:3] for i in range(count)])
    graph = Graph(others.astype(np.int32), rng.random((count, 3)).astype(np.float32))
    target = rng.integers(-1, count, (count, labels))
    target = np.where(target == np.arange(count)[:, None], -1, target)
    miss = np.where(rng.random((count, labels)) < 0.5, FREE_COST, NEUTRAL_COST)
    unary = Unary(0.5 * rng.random((count, labels)), target, miss, 0.2 * rng.random(miss.shape))
    return unary, graph, (0.5 * rng.random((count, 3))).astype(np.float32)


@pytest.mark.parametrize("seed", range(12))
def test_no_exchange_for_one_label_is_cheaper_than_the_one_made(seed):
    """All of them are tried, meeting of surfels, neighbours and bonds counted."""
    rng = np.random.default_rng(seed)
    unary, graph, bonds = few_surfels(rng)
    start, one = rng.integers(0, 3, 7), seed % 3
    energies = []
    for takes in product((False, True), repeat=7):
        hard = np.where(takes, one, start)
        cut = (bonds * (hard[:, None] != hard[graph.neighbors])).sum(dtype=np.float64)
        energies.append(energy_of(unary, graph, hard) + float(cut))
    _, energy = labelled(unary, graph, start, bonds, [one])
    assert energy == pytest.approx(min(energies), abs=1e-3)  # whole numbers of 2^-14
    assert labelled(unary, graph, start, bonds)[1] <= energy + 1e-3
