"""Neighbours of surfels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from part2gs_robotics.evidence.graph import bonds, build_graph, ways_from


def test_the_graph_stays_within_a_state_and_prefers_alike_normals(slid):
    states = tuple(s.surfels for s in slid.states)
    graph, n0 = build_graph(states), len(states[0])
    assert (graph.neighbors[:n0] < n0).all()
    assert (graph.neighbors[n0:] >= n0).all()
    normals = np.concatenate([s.normals for s in states])
    cosine = (normals[graph.neighbors] * normals[:, None]).sum(-1)
    assert graph.weights[cosine > 0.9].mean() > 2 * graph.weights[cosine < 0.1].mean()


def bonds_of(slid, states):
    """Return the bonds of the slid scene under photos of given states."""
    pair = tuple(s.surfels for s in slid.states)
    graph = build_graph(pair)
    maps = tuple(s.maps for s in slid.states)
    return graph, pair, bonds(pair, graph, maps, states, 1.0)


def test_faces_hold_together_and_creases_and_gaps_do_not(slid):
    graph, pair, held = bonds_of(slid, tuple(s.state for s in slid.states))
    normals = np.concatenate([s.normals for s in pair])
    cosine = (normals[graph.neighbors] * normals[:, None]).sum(-1)
    assert held.min() >= 0.0
    assert held.max() <= 1.0
    assert held[cosine < 0.5].max() == 0.0
    assert held[cosine > 0.95].mean() > 0.3  # a share of all: half in the mean, less at corners


def test_a_line_in_the_photos_is_a_seam(slid):
    """A dark line painted across the photos of one state lowers the bonds that it crosses."""
    states = tuple(s.state for s in slid.states)
    plain = tuple(replace(s, images=np.full_like(s.images, 128)) for s in states)
    images = plain[0].images.copy()
    middle = images.shape[2] // 2
    images[:, :, middle:middle + 2] = 0
    lined = replace(plain[0], images=images), plain[1]
    _, pair, before = bonds_of(slid, plain)
    _, _, after = bonds_of(slid, lined)
    n0 = len(pair[0])
    held = before[:n0] > 0.1
    left = after[:n0][held] / before[:n0][held]
    assert left.max() == 1.0  # what no photo shows lined holds as firmly as before
    assert 0.05 < (left < 0.2).mean() < 0.5  # lined in most photos that see it


def test_dim_photos_show_the_same_seams(slid):
    """What is a line the scene itself tells: a third of the light leaves the seams where they are.

    A third of 3 k is k: nothing is rounded.
    """
    states = tuple(s.state for s in slid.states)
    bright = tuple(replace(s, images=s.images // 3 * 3) for s in states)
    dim = tuple(replace(s, images=s.images // 3) for s in states)
    _, _, there = bonds_of(slid, bright)
    _, _, here = bonds_of(slid, dim)
    assert np.abs(here - there).max() < 0.01


@pytest.mark.parametrize("seed", range(6))
def test_ways_from_many_starts_are_those_of_scipy(seed):
    """Sums along a way are the same whoever finds it, so the shortest is to the last bit."""
    rng = np.random.default_rng(seed)
    count, labels, reach = 200, 4, 0.8
    rows, cols = rng.integers(0, count, (2, 500))
    gaps = rng.random(500) ** 2 * (rng.random(500) > 0.05)  # some touch
    one_way = csr_matrix((gaps, (rows, cols)), (count, count))
    surface = one_way.maximum(one_way.T)
    starts = rng.random((count, labels)) < 0.02
    starts[:, 2] = False  # a label without any start
    starts[:, 3] = rng.random(count) < 0.5
    found = ways_from(surface, starts, reach)
    assert (found[:, 2] == reach).all()
    for k in (0, 1, 3):
        ways = dijkstra(surface, indices=np.flatnonzero(starts[:, k]), min_only=True, limit=reach)
        assert np.array_equal(found[:, k], np.minimum(ways, reach))
    assert 0.0 < found[:, 0].max() <= reach
    lag = 0.1
    short = found <= found.min(1, keepdims=True) + lag
    assert 0.2 < short.mean() < 0.8
    near = ways_from(surface, starts, reach, lag)
    assert np.array_equal(near[short], found[short])
    assert (near[~short] == reach).mean() > 0.9
    assert (near >= found).all()
