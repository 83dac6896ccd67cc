"""Neighbours of surfels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.evidence.graph import bonds, build_graph


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
    assert held[cosine > 0.95].mean() > 0.4


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
    changed = (after[:n0] < 0.9 * before[:n0]) & (before[:n0] > 0.1)
    assert 0.01 < changed.mean() < 0.5
