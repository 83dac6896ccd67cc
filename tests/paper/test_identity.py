"""Laws of identity refinement: wrong evidence is repaired, no part swallows another."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch
from paper_terms import part_kl_loss, part_log_probs
from scipy.sparse import csr_array

from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import part_motions
from part2gs_robotics.model.se3 import apply, quat_from_rotation, rotation_from_rotvec
from part2gs_robotics.paper.identity import IdentityConfig, refine_identities, soft_objective
from part2gs_robotics.paper.neighbourhood import part_neighbors

STEP = 0.02
HINGE = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.2, 0, 0]), -np.deg2rad(70))


def gaussians_of(points, normals=None, colors=None):
    n = len(points)
    log_scales = np.full((n, 3), -4.0, np.float32)
    if normals is not None:
        log_scales[np.arange(n), np.abs(normals).argmax(1)] = -7.0
    sh0 = np.zeros((n, 3)) if colors is None else (colors - 0.5) / SH_C0
    return Gaussians(
        np.float32(points),
        np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        log_scales,
        np.zeros(n, np.float32),
        np.float32(sh0),
        np.zeros((n, 0, 3), np.float32),
    )


def turned(gaussians, joint, mask):
    """Move the masked Gaussians by the joint, centres and orientations."""
    motion = joint.transform(joint.value)
    means, quats = gaussians.means.copy(), gaussians.quats.copy()
    means[mask] = apply(motion, means[mask].astype(float))
    quats[mask] = quat_from_rotation(motion[:3, :3])
    return Gaussians(
        means, quats, gaussians.log_scales, gaussians.logit_opacities, gaussians.sh0, gaussians.shN
    )


def two_slabs(door_width=0.4):
    """A front plate: a door flush with its frame, one colour; state 1 has the door open."""
    rng = np.random.default_rng(0)
    x, z = (m.ravel() for m in np.meshgrid(np.arange(0, 1, STEP), np.arange(0, 1, STEP)))
    points = np.stack([x, 0 * x, z], 1) + rng.normal(scale=STEP / 8, size=(len(x), 3))
    labels = ((x >= 0.2) & (x < 0.2 + door_width)).astype(int)
    g0 = gaussians_of(points, np.tile([0.0, 1.0, 0.0], (len(points), 1)))
    return (g0, turned(g0, HINGE, labels == 1)), labels


def costs_of(labels, wrong, parts, seed, margin=4.0):
    """Evidence that names another part for a share of the Gaussians."""
    rng = np.random.default_rng(seed)
    bad = rng.random(len(labels)) < wrong
    named = np.where(bad, (labels + rng.integers(1, parts, len(labels))) % parts, labels)
    return np.where(np.arange(parts) == named[:, None], 0.0, margin)


def accuracy(probs, labels):
    return min(float((p.argmax(1) == labels).mean()) for p in probs)


@pytest.mark.parametrize("margin", [1.0, 4.0, 400.0])
def test_twenty_percent_wrong_evidence_is_repaired(margin):
    pair, labels = two_slabs()
    unary = [costs_of(labels, 0.2, 2, seed, margin) for seed in (1, 2)]
    assert accuracy([-u for u in unary], labels) < 0.82
    probs = refine_identities(*unary, pair, [HINGE])
    assert accuracy(probs, labels) >= 0.98
    assert [p.dtype for p in probs] == [np.float32] * 2
    np.testing.assert_allclose(probs[0].sum(1), 1.0, atol=1e-5)


# 0.06 wide: three columns of fifty, 6 % of the Gaussians
@pytest.mark.parametrize(("width", "weight"), [(0.4, 2.0), (0.4, 20.0), (0.06, 2.0)])
def test_no_part_swallows_the_other(width, weight):
    pair, labels = two_slabs(width)
    unary = [costs_of(labels, 0.2, 2, seed) for seed in (3, 4)]
    probs = refine_identities(*unary, pair, [HINGE], IdentityConfig(part_weight=weight))
    for p in probs:
        label = p.argmax(1)
        for part in (0, 1):
            assert (label[labels == part] == part).mean() > 0.9


def test_state_without_evidence_learns_from_the_other_through_the_joint():
    pair, labels = two_slabs()
    unary = costs_of(labels, 0.1, 2, 5), np.zeros((len(labels), 2))
    assert accuracy(refine_identities(*unary, pair, [HINGE]), labels) >= 0.98
    apart = refine_identities(*unary, pair, [HINGE], IdentityConfig(cross_weight=0.0))
    assert accuracy(apart, labels) < 0.9


def test_few_seeds_spread_over_a_part_and_stop_at_the_colour_edge():
    pair, labels = two_slabs()
    colors = np.where(labels[:, None] == 1, 0.8, 0.2) * np.ones(3)
    painted = [
        Gaussians(
            g.means,
            g.quats,
            g.log_scales,
            g.logit_opacities,
            np.float32((colors - 0.5) / SH_C0),
            g.shN,
        )
        for g in pair
    ]
    known = np.random.default_rng(0).random(len(labels)) < 0.3
    unary = costs_of(labels, 0.0, 2, 0) * known[:, None]
    probs = refine_identities(unary, unary, tuple(painted), [HINGE])
    assert accuracy(probs, labels) >= 0.98


def test_parts_may_be_renumbered():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 4, 1200)
    points = rng.uniform(size=(1200, 3)) + 2.0 * np.eye(4)[labels][:, 1:]
    slides = [Joint("prismatic", axis, np.zeros(3), 0.3) for axis in np.eye(3)]
    lifted = points + 0.3 * np.eye(4)[labels][:, 1:]
    pair = gaussians_of(points), gaussians_of(lifted)
    unary = [costs_of(labels, 0.2, 4, s) + rng.uniform(0, 0.1, (1200, 4)) for s in (1, 2)]
    order = np.array([0, 3, 1, 2])
    plain = refine_identities(*unary, pair, slides)
    renamed = refine_identities(
        *(u[:, order] for u in unary), pair, [slides[k - 1] for k in order[1:]]
    )
    assert accuracy(plain, labels) > 0.98
    np.testing.assert_array_equal(renamed[0].argmax(1), np.argsort(order)[plain[0].argmax(1)])


def random_problem(seed, n=15, parts=3):
    rng = np.random.default_rng(seed)
    neighbors = part_neighbors(rng.normal(size=(n, 3)), 4)
    graph = csr_array((np.full(n * 4, 0.25), neighbors.ravel(), np.arange(n + 1) * 4), shape=(n, n))
    return rng.normal(size=(n, parts)), rng.uniform(0, 4, (n, parts)), graph, neighbors


@pytest.mark.parametrize("temperature", [1.0, 0.4])
@pytest.mark.parametrize("seed", range(4))
def test_analytic_gradient_agrees_with_differences(seed, temperature):
    rho, costs, graph, _ = random_problem(seed)
    config = IdentityConfig()
    _, gradient = soft_objective(rho, costs, graph, config, temperature)
    step, numeric = 1e-6, np.zeros_like(rho)  # central: truncation 1e-12, rounding 1e-9
    for i in np.ndindex(*rho.shape):
        nudge = np.zeros_like(rho)
        nudge[i] = step
        up, down = (
            soft_objective(rho + sign * nudge, costs, graph, config, temperature)[0]
            for sign in (1, -1)
        )
        numeric[i] = (up - down) / (2 * step)
    np.testing.assert_allclose(gradient, numeric, rtol=1e-6, atol=2e-8)


def test_objective_is_evidence_plus_the_papers_kl_term():
    rho, costs, graph, neighbors = random_problem(9)
    config = IdentityConfig(part_weight=0.7)
    value, gradient = soft_objective(rho, costs, graph, config, 0.5)
    logits = torch.tensor(rho, requires_grad=True)
    eye, zero = torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    log_probs = part_log_probs(logits, eye, zero, 0.5)
    kl = part_kl_loss(log_probs, torch.from_numpy(neighbors), config.floor) * len(rho)
    total = (log_probs.exp() * torch.tensor(costs)).sum() + 0.7 * kl
    total.backward()
    assert value == pytest.approx(total.item(), rel=1e-12)
    np.testing.assert_allclose(gradient, logits.grad, rtol=1e-9, atol=1e-12)


def test_same_input_gives_the_same_bits():
    pair, labels = two_slabs()
    unary = [costs_of(labels, 0.3, 2, seed) for seed in (1, 2)]
    first, second = (refine_identities(*unary, pair, [HINGE]) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_forbidden_part_counts_as_the_cap_and_row_offsets_as_nothing():
    pair, labels = two_slabs()
    unary = costs_of(labels, 0.2, 2, 1)
    forbidden = np.where(unary > 0, np.inf, 0.0)
    offsets = 2.0 ** np.random.default_rng(0).integers(0, 9, (len(labels), 1))
    np.testing.assert_array_equal(
        refine_identities(forbidden, forbidden, pair, [HINGE]),
        refine_identities(unary + offsets, unary, pair, [HINGE]),
    )


def test_nan_evidence_and_wrong_shapes_are_our_bugs():
    pair, labels = two_slabs()
    good = np.zeros((len(labels), 2))
    with pytest.raises(AssertionError, match="NaN"):
        refine_identities(good * np.nan, good, pair, [HINGE])
    with pytest.raises(AssertionError, match="expected"):
        refine_identities(good[:, :1], good, pair, [HINGE])


def test_no_joint_means_all_base():
    pair, labels = two_slabs()
    probs = refine_identities(*(np.zeros((len(labels), 1)),) * 2, pair, [])
    np.testing.assert_array_equal(probs[1], np.ones((len(labels), 1)))


@pytest.mark.parametrize("counts", [(0, 3), (1, 1), (2, 0), (12, 1)])
def test_tiny_states_stay_finite(counts):
    pair = tuple(gaussians_of(np.zeros((n, 3))) for n in counts)
    probs = refine_identities(*(np.zeros((n, 2)) for n in counts), pair, [HINGE])
    assert [p.shape for p in probs] == [(n, 2) for n in counts]
    assert all(np.isfinite(p).all() for p in probs)


def test_a_child_moves_with_its_parent():
    lift = Joint("prismatic", np.array([0.0, 0, 1]), np.zeros(3), 2.0)
    moves = part_motions([lift, HINGE], [0, 1])
    np.testing.assert_allclose(moves[2], lift.transform(2.0) @ HINGE.transform(HINGE.value))
    np.testing.assert_allclose(part_motions([lift, HINGE])[2], HINGE.transform(HINGE.value))
    turn = rotation_from_rotvec(HINGE.axis * HINGE.value)
    np.testing.assert_allclose(moves[2][:3, :3], turn)
    np.testing.assert_array_equal(moves[0], np.eye(4))


@pytest.mark.slow
def test_fifty_thousand_gaussians_and_five_parts_take_seconds():
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 5, 25_000)
    points = rng.uniform(size=(25_000, 3)) * [1, 1, 0.01] + labels[:, None] * [1.0, 0, 0]
    lifts = [Joint("prismatic", np.array([0.0, 0, 1]), np.zeros(3), 0.3 * k) for k in range(1, 5)]
    pair = gaussians_of(points), gaussians_of(points + labels[:, None] * [0, 0, 0.3])
    start = time.process_time()
    probs = refine_identities(*(costs_of(labels, 0.2, 5, s) for s in (1, 2)), pair, lifts)
    assert time.process_time() - start < 8.0  # 2 s on one core when alone
    assert accuracy(probs, labels) > 0.99
