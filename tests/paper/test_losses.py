"""Laws of the physical losses: gradients, invariances, and the printed forms' defects."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from paper_terms import grid_signed_distance

from part2gs_robotics.model.se3 import rotation_from_rotvec, screw_motion
from part2gs_robotics.paper.losses import (
    Form,
    articulation_loss,
    best_rotation,
    contact_loss,
    geman_mcclure,
    moved_points,
    repel_loss,
    rotation_angle,
    vector_field_loss,
    velocity_loss,
)
from part2gs_robotics.paper.repel import REPEL_EPSILON, repel_forces

BOTH = pytest.mark.parametrize("paper", [False, True])
RNG = np.random.default_rng(0)


pytestmark = pytest.mark.usefixtures("one_torch_thread")


def tensor(array, grad=False):
    return torch.tensor(np.asarray(array, float), dtype=torch.float64, requires_grad=grad)


def rotation(w):
    return tensor(rotation_from_rotvec(np.asarray(w, float)))


def assert_gradients(loss, *inputs):
    """Compare every gradient of loss(*inputs) with central differences (truncation ~1e-9)."""
    assert torch.autograd.gradcheck(loss, inputs, eps=1e-6, atol=1e-8, rtol=1e-6)


def assert_finite(loss, *inputs):
    value = loss(*inputs)
    value.backward()
    assert torch.isfinite(value)
    for x in inputs:
        assert x.grad is None or bool(torch.isfinite(x.grad).all())
    return value.item()


def door(angle, width=0.6, n=60):
    """A width x 0.8 panel, sampled at cell centres, turned about its edge."""
    x, z = np.meshgrid((np.arange(n) + 0.5) / n * width, (np.arange(4) + 0.5) / 4 * 0.8)
    flat = np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], 1)
    turn = rotation_from_rotvec(np.array([0.0, 0.0, angle]))
    return tensor(flat), tensor(flat @ turn.T)


def ball(points):
    return points.norm(dim=-1) - 1.0


@BOTH
@pytest.mark.parametrize("seed", range(5))
def test_gradients_of_pair_losses(paper, seed):
    rng = np.random.default_rng(seed)
    p0, p1 = tensor(rng.normal(size=(7, 3)), True), tensor(rng.normal(size=(7, 3)), True)
    w = tensor(rng.uniform(0.1, 1, size=(7, 2)), True)
    assert_gradients(lambda a, b, c: velocity_loss(a, b, c, paper=paper), p0, p1, w)
    rots, trans = tensor(rng.normal(size=(2, 3, 3)), True), tensor(rng.normal(size=(2, 3)), True)
    assert_gradients(
        lambda *x: vector_field_loss(*x, Form(paper, 0.5)), p0, p1, rots, trans, w
    )
    start, goal = rotation(rng.normal(size=3)), rotation(rng.normal(size=3))
    start.requires_grad_()
    shift = tensor(rng.normal(size=3), True)
    assert_gradients(lambda r, t, *pair: articulation_loss(r, t, pair, goal, 0.3, Form(paper, 0.5)),
                     start, shift, p0, p1)


@pytest.mark.parametrize(("angle_deg", "printed"), [(10, 0.0009), (45, 0.0176), (90, 0.060)])
def test_printed_velocity_loss_punishes_a_perfect_turn(angle_deg, printed):
    angle = np.deg2rad(angle_deg)
    p0, p1 = door(angle, n=200)
    ones = torch.ones(len(p0), 1, dtype=torch.float64)
    closed_form = 4 * np.sin(angle / 2) ** 2 * 0.6**2 / 12
    value = velocity_loss(p0, p1, ones, paper=True).item()
    assert value == pytest.approx(closed_form, rel=1 / 200**2 * 2)  # midpoint sampling: 1 - 1/n^2
    assert value == pytest.approx(printed, abs=5e-5 if angle_deg < 90 else 5e-4)
    assert velocity_loss(p0, p1, ones).item() < 1e-20


@pytest.mark.parametrize("w", [[0, 0, 0], [np.pi, 0, 0], [0.3, -2.0, 1.0]])
def test_corrected_velocity_loss_is_zero_for_every_rigid_motion(w):
    p0 = tensor(RNG.normal(size=(20, 3)))
    p1 = p0 @ rotation(w).T + tensor([1.0, 2.0, 3.0])
    assert velocity_loss(p0, p1, torch.ones(20, 1, dtype=torch.float64)).item() < 1e-20


def test_corrected_velocity_loss_measures_the_residual():
    p0 = tensor(RNG.normal(size=(4000, 3)))
    p1 = p0 @ rotation([0, 1.0, 0]).T + 0.01 * tensor(RNG.normal(size=(4000, 3)))
    value = velocity_loss(p0, p1, torch.ones(4000, 1, dtype=torch.float64)).item()
    assert value == pytest.approx(3 * 0.01**2, rel=0.05)  # 12000 draws: spread 1.3 %


def test_velocity_loss_separates_parts():
    p0 = tensor(RNG.normal(size=(10, 3)))
    parts = torch.eye(2, dtype=torch.float64).repeat_interleave(5, 0)
    shift = parts @ tensor([[1.0, 0, 0], [0, -2.0, 0]])
    assert velocity_loss(p0, p0 + shift, parts, paper=True).item() < 1e-24
    assert velocity_loss(p0, p0 + shift, parts.sum(1, keepdim=True), paper=True).item() > 1


def test_velocity_loss_with_a_given_turn_is_zero_for_that_turn_alone():
    p0 = tensor(RNG.normal(size=(20, 3)))
    ones = torch.ones(20, 1, dtype=torch.float64)
    turn = rotation([0.3, -1.0, 0.4])
    p1 = p0 @ turn.T + tensor([1.0, 2.0, 3.0])
    assert velocity_loss(p0, p1, ones, rotations=turn[None]).item() < 1e-20
    eye = torch.eye(3, dtype=torch.float64)[None]
    printed = velocity_loss(p0, p1, ones, paper=True).item()
    assert velocity_loss(p0, p1, ones, rotations=eye).item() == pytest.approx(printed)
    rotations = eye.clone().requires_grad_()
    assert_gradients(lambda r: velocity_loss(p0, p1, ones, rotations=r), rotations)


@pytest.mark.parametrize("voxel", [0.02, 1e9])
def test_repel_energy_is_the_potential_of_the_corrected_push(voxel):
    """Bounded (0.02: half of the pairs) and unbounded (1e9) pushes alike."""
    rng = np.random.default_rng(4)
    points, repels = tensor(rng.uniform(size=(40, 3)), True), rng.uniform(size=(60, 3))
    strength = 5e-4 if voxel < 1 else 1e-3
    energy = repel_loss(points, tensor(repels), voxel, strength)
    energy.backward()
    forces = repel_forces(points.detach().numpy(), repels, voxel, strength)
    np.testing.assert_allclose(points.grad.numpy(), -forces / 40, rtol=1e-9, atol=1e-15)
    assert_gradients(lambda p: repel_loss(p, tensor(repels), voxel, strength), points)


def test_repel_energy_closed_forms():
    point, seam = tensor([[0.0, 0, 0]]), tensor([[0.1, 0, 0]])
    far = repel_loss(point, seam, 1e9, strength=5e-4).item()
    assert far == pytest.approx(5e-4 / 0.1, rel=1e-7)  # k / s
    near = np.sqrt(5e-4 / 0.01)  # the push reaches half a voxel of 0.02 here: 0.22 > 0.1
    bounded = repel_loss(point, seam, 0.02, strength=5e-4).item()
    assert bounded == pytest.approx(5e-4 / near + 0.01 * (near - 0.1), rel=1e-6)


def test_repel_energy_is_finite_at_coincident_points_and_zero_without_seam():
    here = tensor(np.zeros((3, 3)), True)
    value = assert_finite(lambda p: repel_loss(p, tensor(np.zeros((9, 3))), 0.02), here)
    assert value > 0
    assert REPEL_EPSILON > 0
    nothing = tensor(np.zeros((0, 3)), True)
    assert assert_finite(lambda p: repel_loss(p, tensor(np.ones((2, 3))), 0.02), nothing) == 0.0
    here = tensor(np.zeros((3, 3)), True)
    assert assert_finite(lambda p: repel_loss(p, tensor(np.zeros((0, 3))), 0.02), here) == 0.0


def test_vector_field_forgives_outliers_only_when_corrected():
    p0 = tensor(RNG.uniform(size=(50, 3)))
    w = torch.ones(50, 1, dtype=torch.float64)
    still = torch.eye(3, dtype=torch.float64)[None], torch.zeros(1, 3, dtype=torch.float64)
    p1 = p0.clone()
    p1[0] += 100.0
    assert vector_field_loss(p0, p1, *still, w, Form(paper=True)).item() == pytest.approx(3e4)
    assert vector_field_loss(p0, p1, *still, w).item() <= 1 / 50
    order = torch.randperm(50, generator=torch.Generator().manual_seed(0))
    assert vector_field_loss(p0, p0[order], *still, w).item() == 0.0  # needs no pairs


def test_articulation_loss_vanishes_at_the_truth_and_angle_is_geodesic():
    p0 = tensor(RNG.normal(size=(12, 3)))
    turn, t = rotation([0.2, 0.5, -1.0]), tensor([0.1, 0.2, 0.3])
    p1 = p0 @ turn.T + t
    assert articulation_loss(turn, t, (p0, p1)).item() < 1e-12
    assert articulation_loss(turn, t, (p0, p1), form=Form(paper=True)).item() < 1e-7
    eye = rotation([0, 0, 0])
    for angle in (0.0, 1e-4, 1.0, 3.0, np.pi):
        assert rotation_angle(eye, rotation([0, angle, 0])).item() == pytest.approx(angle, abs=1e-9)
    value = articulation_loss(eye, t * 0, (p0, p0), rotation([0, 1e-3, 0]), rot_weight=1.0).item()
    assert value == pytest.approx(1e-6, rel=1e-6)  # angle^2 up to its fourth power


def test_best_rotation_is_proper_and_exact():
    turn = rotation([0.4, 3.0, -0.2])
    p0 = tensor(RNG.normal(size=(9, 3)))
    ones = torch.ones(9, dtype=torch.float64)
    torch.testing.assert_close(best_rotation(p0, p0 @ turn.T + 5, ones), turn)
    mirrored = best_rotation(p0, p0 * tensor([-1, 1, 1]), ones)
    assert torch.det(mirrored).item() == pytest.approx(1.0)


def test_moved_points_agree_with_screw_motion():
    axis, origin = np.array([1.0, 2.0, 2.0]) / 3, np.array([0.3, -0.1, 0.5])
    points = RNG.normal(size=(5, 3))
    turns, slides = np.array([0.0, 0.7, np.pi, -4.0]), np.array([0.0, 0.2, -1.0, 3.0])
    moved = moved_points(
        tensor(points), tensor(3 * axis), tensor(origin), tensor(turns), tensor(slides)
    )
    for got, turn, slide in zip(moved, turns, slides, strict=True):
        motion = screw_motion(axis, origin, turn, slide)
        np.testing.assert_allclose(got, points @ motion[:3, :3].T + motion[:3, 3], atol=1e-12)


def test_grid_distance_is_exact_for_linear_fields_and_constant_outside():
    origin, voxel = tensor([-1.0, -1, -1]), 0.25
    nodes = torch.stack(torch.meshgrid(*(torch.arange(n) for n in (9, 7, 5)), indexing="ij"), -1)
    slope = tensor([1.0, -2, 0.5])
    sdf = grid_signed_distance((nodes * voxel + origin) @ slope, origin, voxel)
    inside = tensor(RNG.uniform(-1, 0, size=(40, 3)), True)
    torch.testing.assert_close(sdf(inside), inside @ slope)
    assert_gradients(sdf, inside)
    far = tensor([[9.0, 9, 9], [-9.0, -9, -9]])
    torch.testing.assert_close(sdf(far), tensor([[1.0, 0.5, 0.0], [-1.0, -1, -1]]) @ slope)


def test_geman_mcclure_limits():
    assert geman_mcclure(tensor([1e-8]), 1.0).item() == pytest.approx(1e-8)
    assert geman_mcclure(tensor([1.0]), 1.0).item() == 0.5
    assert geman_mcclure(tensor([1e12]), 1.0).item() == pytest.approx(1.0)


@BOTH
@pytest.mark.parametrize("w", [[0, 0, 0], [0, np.pi, 0]])
@pytest.mark.parametrize("n", [0, 1, 6])
def test_finite_at_coincident_points_and_half_turns(paper, w, n):
    ones = np.ones((n, 3))
    for target in (None, [0, 0, 0], [np.pi, 0, 0], w):
        goal = None if target is None else rotation(target)
        inputs = rotation(w).requires_grad_(), tensor(np.zeros(3), True)
        assert_finite(
            lambda r, t, *pair, g=goal: articulation_loss(r, t, pair, g, form=Form(paper)),
            *inputs, tensor(ones, True), tensor(ones, True),
        )  # fmt: skip


@BOTH
@pytest.mark.parametrize("parts", [1, 3])
def test_finite_and_zero_for_empty_parts(paper, parts):
    p0, p1 = tensor(np.ones((5, 3)), True), tensor(np.ones((5, 3)), True)
    w = tensor(np.zeros((5, parts)), True)
    rots = tensor(np.tile(np.eye(3), (parts, 1, 1)), True)
    trans = tensor(np.ones((parts, 3)), True)
    assert assert_finite(lambda *x: velocity_loss(*x, paper=paper), p0, p1, w) == 0.0
    field = p0, p1, rots, trans, w
    assert assert_finite(lambda *x: vector_field_loss(*x, Form(paper)), *field) == 0.0
    nothing = tensor(np.zeros((0, 3)), True)
    assert assert_finite(lambda p: contact_loss(p, p0, sdf=ball, paper=paper), nothing) == 0.0
    assert assert_finite(lambda p: contact_loss(p, p, sdf=ball, paper=paper), p0) >= 0.0


@BOTH
def test_losses_follow_rigid_motion_of_the_world(paper):
    rng = np.random.default_rng(5)
    p0, p1 = (tensor(rng.normal(size=(8, 3))) for _ in range(2))
    w = torch.ones(8, 1, dtype=torch.float64)
    r, t = rotation([0.1, 0.2, 0.3]), tensor([0.1, 0, 0])
    turn, shift = rotation([0.5, -1, 2]), tensor([3.0, 1.0, -2.0])
    q0, q1 = p0 @ turn.T + shift, p1 @ turn.T + shift
    r_q = turn @ r @ turn.T
    t_q = turn @ t + shift - r_q @ shift

    def losses(a, b, rot, trans):
        yield velocity_loss(a, b, w, paper).item()
        yield vector_field_loss(a, b, rot[None], trans[None], w, Form(paper, 0.5)).item()
        yield contact_loss(a, b, paper=True).item()

    assert list(losses(q0, q1, r_q, t_q)) == pytest.approx(list(losses(p0, p1, r, t)))
