"""Laws of the contact loss: gradients through the joint, closed forms, what is wrong as printed."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from part2gs_robotics.paper.losses import contact_loss, moved_points

pytestmark = pytest.mark.usefixtures("one_torch_thread")


def tensor(array, grad=False):
    return torch.tensor(np.asarray(array, float), dtype=torch.float64, requires_grad=grad)


def assert_gradients(loss, *inputs):
    """Compare every gradient of loss(*inputs) with central differences (truncation ~1e-9)."""
    assert torch.autograd.gradcheck(loss, inputs, eps=1e-6, atol=1e-8, rtol=1e-6)


def ball(points):
    return points.norm(dim=-1) - 1.0


@pytest.mark.parametrize("seed", range(5))
def test_gradients_of_contact_through_the_joint(seed):
    rng = np.random.default_rng(seed)
    points = tensor(rng.normal(size=(9, 3)), True)
    axis, origin = tensor(rng.normal(size=3), True), tensor(rng.normal(size=3), True)
    turns, slides = tensor([0.0, 0.4, 1.0]), tensor([0.0, 0.1, 0.2])

    def swept(*x):
        return contact_loss(moved_points(*x, turns, slides), sdf=ball)

    assert_gradients(swept, points, axis, origin)
    static = tensor(rng.normal(size=(6, 3)), True)
    assert_gradients(lambda p, s: contact_loss(p, s, paper=True), points, static)


def drawer(depth_into_wall):
    """Box with an open front, and a drawer box inside it, shifted sideways into the wall."""

    def shell(lo, hi, n=14):
        t = np.linspace(0, 1, n)
        a, b = (m.ravel() for m in np.meshgrid(t, t))
        sides = [
            np.insert(np.stack([a, b], 1), axis, end, 1)
            for axis, end in ((0, 0), (0, 1), (2, 0), (2, 1), (1, 1))
        ]
        return np.vstack(sides) * (np.array(hi) - np.array(lo)) + np.array(lo)

    carcass = shell([-0.2, 0, -0.1], [0.2, 0.4, 0.1])
    inner = shell([-0.197, 0, -0.097], [0.197, 0.397, 0.097]) + np.array([depth_into_wall, 0, 0])
    return tensor(inner), tensor(carcass)


def room(points):
    """Signed distance of the wall x = 0.2, solid for x > 0.2."""
    return 0.2 - points[..., 0]


def test_printed_contact_loss_is_blind_where_the_hinge_sees():
    gap, walls = drawer(-0.003)
    deep, _ = drawer(0.05)
    printed = [contact_loss(p, walls, paper=True).item() for p in (gap, deep)]
    assert printed[0] > 0.1  # fires without any contact
    assert printed[1] < printed[0] * 1.5  # and hardly notices 5 cm of overlap
    assert contact_loss(gap, sdf=room).item() == 0.0
    hinge = [contact_loss(drawer(d)[0], sdf=room).item() for d in (0.002, 0.01, 0.03, 0.05)]
    assert 0 == hinge[0] < hinge[1] < hinge[2] < hinge[3]  # 2 mm still inside the 3 mm gap


def test_contact_hinge_closed_form_and_margin():
    points = tensor([[0.8, 0, 0], [0, 3.0, 0]])
    assert contact_loss(points, sdf=ball).item() == pytest.approx(0.2**2 / 2)
    assert contact_loss(points, sdf=ball, margin=0.05).item() == pytest.approx(0.15**2 / 2)


def test_contact_hinge_averages_over_joint_values():
    points = tensor([[2.0, 0, 0]])
    axis, still = tensor([1.0, 0, 0]), tensor([0.0, 0, 0])
    swept = moved_points(points, axis, still, tensor([0.0, 0.0]), tensor([0.0, -1.5]))
    assert contact_loss(swept, sdf=ball).item() == pytest.approx(0.5**2 / 2)


def test_printed_contact_sign_is_the_angle():
    static = tensor([[0.0, 0, 0], [10.0, 0, 0]])  # centroid at x = 5
    opposite = tensor([[2.0, 0, 0]])  # nearest to the left, centroid to the right
    beside = tensor([[-1.0, 0, 0]])  # both to the right
    assert contact_loss(opposite, static, paper=True).item() == pytest.approx(1.0)
    assert contact_loss(beside, static, paper=True).item() == 0.0
