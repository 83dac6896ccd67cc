"""Laws of part identity: gradients, neighbourhoods, temperature."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from paper_terms import part_kl_loss, part_log_probs

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.se3 import quat_from_rotation, rotation_from_rotvec
from part2gs_robotics.paper.neighbourhood import (
    gaussian_normals,
    is_hard,
    part_neighbors,
    part_temperature,
)

pytestmark = pytest.mark.usefixtures("one_torch_thread")


def random_identity(seed, n=12, d=5, parts=3):
    rng = np.random.default_rng(seed)
    arrays = rng.normal(size=(n, d)), rng.normal(size=(parts, d)), rng.normal(size=parts)
    neighbors = torch.from_numpy(part_neighbors(rng.normal(size=(n, 3)), 4))
    return [torch.tensor(a, requires_grad=True) for a in arrays], neighbors


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("temperature", [1.0, 0.3])
def test_kl_gradient_agrees_with_differences(seed, temperature):
    inputs, neighbors = random_identity(seed)

    def loss(rho, w, b):
        return part_kl_loss(part_log_probs(rho, w, b, temperature), neighbors)

    assert torch.autograd.gradcheck(loss, inputs, eps=1e-6, atol=1e-8, rtol=1e-6)


def test_kl_is_zero_where_neighbours_agree_and_positive_elsewhere():
    same = torch.log_softmax(torch.tensor([[2.0, 0.0, -1.0]], dtype=torch.float64), -1)
    ring = torch.tensor([[1, 2], [0, 2], [0, 1]])
    assert abs(part_kl_loss(same.repeat(3, 1), ring, floor=0.0).item()) < 1e-15
    (rho, w, b), neighbors = random_identity(0)
    assert part_kl_loss(part_log_probs(rho, w, b), neighbors).item() > 0.1


def test_kl_closed_form_of_two_gaussians():
    p, q = torch.tensor([0.9, 0.1]), torch.tensor([0.5, 0.5])
    log_probs = torch.stack([p, q]).double().log()
    forward = 0.9 * np.log(0.9 / 0.5) + 0.1 * np.log(0.1 / 0.5)
    back = 0.5 * np.log(0.5 / 0.9) + 0.5 * np.log(0.5 / 0.1)
    value = part_kl_loss(log_probs, torch.tensor([[1], [0]]), floor=0.0).item()
    assert value == pytest.approx((forward + back) / 2, rel=1e-6)  # float32 inputs


def test_one_part_everywhere_is_the_degenerate_minimum():
    swallowed = torch.log_softmax(torch.tensor([[40.0, 0.0]] * 6, dtype=torch.float64), -1)
    neighbors = torch.from_numpy(part_neighbors(np.random.default_rng(0).normal(size=(6, 3)), 3))
    assert part_kl_loss(swallowed, neighbors).item() < 1e-5


def test_hard_and_opposite_identities_stay_finite():
    rho = torch.tensor([[500.0, 0.0], [0.0, 500.0]], requires_grad=True)
    value = part_kl_loss(
        part_log_probs(rho, torch.eye(2), torch.zeros(2), 0.1), torch.tensor([[1], [0]])
    )
    value.backward()
    assert value.item() == pytest.approx(-np.log(1e-6), rel=1e-3)
    assert torch.isfinite(rho.grad).all()


def test_probabilities_add_up_and_plain_logits_are_a_special_case():
    logits = torch.randn(4, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    eye, zero = torch.eye(3, dtype=torch.float64), torch.zeros(3, dtype=torch.float64)
    probs = part_log_probs(logits, eye, zero).exp()
    torch.testing.assert_close(probs.sum(1), torch.ones(4, dtype=torch.float64))
    torch.testing.assert_close(probs, logits.softmax(1))


def test_neighbours_are_the_nearest_without_oneself():
    points = np.random.default_rng(1).normal(size=(200, 3))
    distances = np.linalg.norm(points[:, None] - points, axis=2) + np.diag(np.full(200, np.inf))
    expected = np.sort(np.argsort(distances, 1)[:, :8], 1)
    np.testing.assert_array_equal(np.sort(part_neighbors(points), 1), expected)


def edge_of_a_box(n=12):
    """Two faces meeting at a right angle, their normals and face index."""
    t = (np.arange(n) + 0.5) / n
    a, b = (m.ravel() for m in np.meshgrid(t, t))
    zero, face = np.zeros(n * n), np.repeat([0, 1], n * n)
    points = np.concatenate([np.stack([a, zero, b], 1), np.stack([zero, a, b], 1)])
    return points, np.eye(3)[1 - face], face


def test_normal_aware_neighbours_do_not_turn_the_corner():
    points, normals, face = edge_of_a_box()
    mixed = (face[part_neighbors(points)] != face[:, None]).mean()
    aware = (face[part_neighbors(points, normals=normals)] != face[:, None]).mean()
    assert mixed > 0.02
    assert aware == 0.0
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(points), 1))
    np.testing.assert_array_equal(
        part_neighbors(points, normals=normals), part_neighbors(points, normals=normals * signs)
    )


def test_colour_aware_neighbours_do_not_cross_the_seam():
    points, _, face = edge_of_a_box()
    colors = np.where(face[:, None] == 0, 0.9, 0.1) * np.ones(3)
    mixed = (face[part_neighbors(points, colors=colors)] != face[:, None]).mean()
    assert mixed == 0.0


@pytest.mark.parametrize(("n", "columns"), [(0, 0), (1, 0), (2, 1), (5, 4), (30, 8)])
def test_small_and_coincident_clouds(n, columns):
    neighbors = part_neighbors(np.zeros((n, 3)), 8)
    assert neighbors.shape == (n, columns)
    assert not (neighbors == np.arange(n)[:, None]).any()
    log_probs = torch.log_softmax(torch.zeros(n, 3, requires_grad=True), -1)
    assert torch.isfinite(part_kl_loss(log_probs, torch.from_numpy(neighbors)))


def test_temperature_falls_from_one_to_a_tenth_then_identities_are_hard():
    values = [part_temperature(s, 90) for s in range(90)]
    assert values[0] == 1.0
    assert values[60] == pytest.approx(0.1)
    assert all(a >= b for a, b in itertools.pairwise(values))
    assert [is_hard(s, 90) for s in (0, 59, 60, 89)] == [False, False, True, True]


def test_normal_is_the_thinnest_axis():
    rng = np.random.default_rng(3)
    turns = [rotation_from_rotvec(w) for w in rng.normal(size=(20, 3))]
    quats = np.float32([quat_from_rotation(r) for r in turns])
    thin = rng.integers(0, 3, 20)
    log_scales = np.float32(np.where(np.arange(3) == thin[:, None], -6.0, -3.0))
    zeros = np.zeros((20, 3), np.float32)
    gaussians = Gaussians(
        zeros, quats, log_scales, zeros[:, 0], zeros, np.zeros((20, 0, 3), np.float32)
    )
    expected = np.array([r[:, t] for r, t in zip(turns, thin, strict=True)])
    np.testing.assert_allclose(gaussian_normals(gaussians), expected, atol=1e-6)
