"""Neighbours of surfels."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.evidence.graph import build_graph


def test_the_graph_stays_within_a_state_and_prefers_alike_normals(slid):
    states = tuple(s.surfels for s in slid.states)
    graph, n0 = build_graph(states), len(states[0])
    assert (graph.neighbors[:n0] < n0).all()
    assert (graph.neighbors[n0:] >= n0).all()
    normals = np.concatenate([s.normals for s in states])
    cosine = (normals[graph.neighbors] * normals[:, None]).sum(-1)
    assert graph.weights[cosine > 0.9].mean() > 2 * graph.weights[cosine < 0.1].mean()
