"""Labels in registers: the damped mean field of a plain loop, for any number of labels."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.decide.mean_field import LOWEST, NEVER, descend, wide
from part2gs_robotics.runtime.simd import LANES

TEMPERATURES = (0.3, 0.04)


def padded(values, fill):
    """Return [N, width] float32 of [N, L] values."""
    out = wide(*values.shape, fill)
    out[:, : values.shape[1]] = values
    return out


def plain(cost, q, neighbors, weights, temperature):
    """One damped step in float64, node by node."""
    out = np.empty_like(q)
    for i in range(len(q)):
        against = cost[i] + (weights[i, :, None] * (1 - q[neighbors[i]])).sum(0)
        share = np.exp((against.min() - against) / temperature)
        out[i] = (share / share.sum() + q[i]) / 2
    return out


def problem(rng, labels, nodes=40, ring=10):
    cost, q = rng.uniform(0, 1, (nodes, labels)), rng.dirichlet(np.ones(labels), nodes)
    neighbors = rng.integers(0, nodes, (nodes, ring)).astype(np.int32)
    return cost, q, neighbors, rng.uniform(0, 0.12, (nodes, ring)).astype(np.float32)


@pytest.mark.parametrize("temperature", TEMPERATURES)
@pytest.mark.parametrize("labels", [1, 2, LANES, LANES + 1, 2 * LANES + 3])
def test_a_step_is_that_of_a_plain_loop(labels, temperature):
    cost, q, neighbors, weights = problem(np.random.default_rng(labels), labels)
    expected = q
    for _ in range(3):
        expected = plain(cost, expected, neighbors, weights.astype(np.float64), temperature)
    found = descend(padded(cost, NEVER), padded(q, 0.0), neighbors, weights, temperature, 3)
    # float32 costs of order 1 over a temperature of 0.04: errors of 1e-7 become 1e-5.
    assert found[:, :labels] == pytest.approx(expected, abs=2e-5)
    assert found[:, labels:].max(initial=0.0) < 1e-15


def test_labels_far_too_dear_get_nothing_and_nothing_overflows():
    cost = np.array([[0.0, 1e6, -LOWEST], [1e30, 0.0, 1e30]])
    q = padded(np.full((2, 3), 1 / 3), 0.0)
    none, zero = np.zeros((2, 0), np.int32), np.zeros((2, 0), np.float32)
    found = descend(padded(cost, NEVER), q, none, zero, 0.04, 60)
    assert np.isfinite(found).all()
    assert found[:, :3] == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]]), abs=1e-6)


def test_all_labels_alike_stay_alike():
    _, _, neighbors, weights = problem(np.random.default_rng(0), 3)
    q = padded(np.full((len(neighbors), 3), 1 / 3), 0.0)
    found = descend(padded(np.ones((len(q), 3)), NEVER), q, neighbors, weights, 0.04, 20)
    assert found[:, :3] == pytest.approx(1 / 3, abs=1e-6)
