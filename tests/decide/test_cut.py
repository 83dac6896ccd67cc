"""Minimum cut: no other division of the nodes costs less, and none as cheap takes fewer."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import maximum_flow

from part2gs_robotics.decide.cut import minimum_cut


def network(rng, nodes, pairs, most=20):
    """Return arcs as (from, to, there, back) and ends of a random graph, some of them zero."""
    one = rng.integers(0, nodes, pairs)
    two = (one + rng.integers(1, nodes, pairs)) % nodes
    there, back = (rng.integers(0, most, pairs) * (rng.random(pairs) < 0.7) for _ in range(2))
    ends = rng.integers(-most, most, nodes) * (rng.random(nodes) < 0.8)
    return (one, two, there, back), ends.astype(np.int32)


def arranged(nodes, one, two, there, back):
    """Return the arcs in the order that `minimum_cut` asks for."""
    first, last = np.concatenate([one, two]), np.concatenate([two, one])
    count = len(one)
    sister = np.concatenate([np.arange(count) + count, np.arange(count)])
    order = np.argsort(first, kind="stable")
    place = np.empty_like(order)
    place[order] = np.arange(2 * count)
    begin = np.concatenate([[0], np.cumsum(np.bincount(first, minlength=nodes))])
    caps = np.concatenate([there, back])
    return tuple(a.astype(np.int32) for a in (begin, last[order], place[sister[order]],
                                               caps[order]))


def cost(arcs, ends, sinks):
    """Return what a division of the nodes costs."""
    one, two, there, back = arcs
    return (np.where(sinks, np.maximum(ends, 0), np.maximum(-ends, 0)).sum()
            + there[~sinks[one] & sinks[two]].sum() + back[sinks[one] & ~sinks[two]].sum())


@pytest.mark.parametrize("seed", range(20))
def test_no_division_is_cheaper_and_none_as_cheap_takes_fewer(seed):
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(2, 9))
    arcs, ends = network(rng, nodes, int(rng.integers(1, 25)), most=4)
    found = minimum_cut(arranged(nodes, *arcs), ends.copy())
    every = [np.array(sinks, bool) for sinks in product((False, True), repeat=nodes)]
    costs = [cost(arcs, ends, sinks) for sinks in every]
    least = [sinks.sum() for sinks, one in zip(every, costs, strict=True) if one == min(costs)]
    assert cost(arcs, ends, found) == min(costs)
    assert found.sum() == min(least)


@pytest.mark.parametrize(("nodes", "pairs"), [(50, 120), (300, 2000), (3000, 9000)])
def test_the_cut_is_worth_the_largest_flow(nodes, pairs):
    """Max-flow min-cut theorem, beside SciPy's flow by another algorithm."""
    rng = np.random.default_rng(nodes)
    arcs, ends = network(rng, nodes, pairs)
    one, two, there, back = arcs
    every = np.arange(nodes)
    flow = maximum_flow(csr_matrix(
        (np.concatenate([there, back, np.maximum(ends, 0), np.maximum(-ends, 0)]),
         (np.concatenate([one, two, np.full(nodes, nodes), every]),
          np.concatenate([two, one, every, np.full(nodes, nodes + 1)]))),
        shape=(nodes + 2, nodes + 2), dtype=np.int32), nodes, nodes + 1).flow_value
    assert cost(arcs, ends, minimum_cut(arranged(nodes, *arcs), ends.copy())) == flow > 0


def test_without_arcs_every_node_goes_where_it_is_cheaper():
    none = np.zeros(0, np.int64)
    ends = np.array([3, -2, 0], np.int32)
    found = minimum_cut(arranged(3, none, none, none, none), ends)
    np.testing.assert_array_equal(found, [False, True, False])
