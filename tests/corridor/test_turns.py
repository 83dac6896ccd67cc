"""Turns of 0 and 180 degrees have true gradients."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from part2gs_robotics.joints.solver import at
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.paper.losses import articulation_loss, moved_points, rotation_angle

pytestmark = pytest.mark.usefixtures("one_torch_thread")
ANGLES = pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.7, np.pi - 1e-9, np.pi])
WAYS = np.random.default_rng(0).normal(size=(8, 3))
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)


@ANGLES
def test_exponential_and_logarithm_are_inverse(angle):
    for way in WAYS:
        rot = se3.rotation_from_rotvec(angle * way)
        np.testing.assert_allclose(rot @ rot.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(rot) == pytest.approx(1.0, abs=1e-14)
        back = se3.rotvec_from_rotation(rot)
        assert np.linalg.norm(back) <= np.pi + 1e-12
        if angle == np.pi and back @ way < 0:  # at a half turn both ways are one rotation
            back = -back
        assert np.abs(back - angle * way).max() < (1e-14 if angle < 1e-3 else 1e-8)
        np.testing.assert_allclose(se3.rotation_from_rotvec(back), rot, atol=1e-14)
        quat = se3.quat_from_rotation(rot)
        assert quat[0] >= 0
        np.testing.assert_allclose(se3.rotation_from_quats(quat[None])[0], rot, atol=1e-14)
        np.testing.assert_allclose(se3.rotation_from_quats(-quat[None])[0], rot, atol=1e-14)


def left_jacobian(w):
    """Closed form of d exp / dw: exp(w + dw) = exp(J dw) exp(w)."""
    angle, k = np.linalg.norm(w), se3.hat(w)
    if angle < 1e-4:
        return np.eye(3) + k / 2 + k @ k / 6
    return (np.eye(3) + (1 - np.cos(angle)) / angle**2 * k
            + (angle - np.sin(angle)) / angle**3 * k @ k)


@ANGLES
def test_the_exponential_has_its_closed_derivative(angle):
    step = 1e-6  # truncation 1e-13, rounding 1e-10
    for way in WAYS[:4]:
        rot = se3.rotation_from_rotvec(angle * way)
        for i in range(3):
            d = step * np.eye(3)[i]
            slope = (se3.rotation_from_rotvec(angle * way + d)
                     - se3.rotation_from_rotvec(angle * way - d)) / (2 * step)
            expected = se3.hat(left_jacobian(angle * way)[:, i]) @ rot
            np.testing.assert_allclose(slope, expected, atol=1e-9)


@ANGLES
def test_moved_points_have_true_gradients(angle):
    points = torch.tensor(WAYS[:3])
    inputs = [torch.tensor(x, dtype=torch.float64, requires_grad=True)
              for x in (WAYS[3] * 1.3, WAYS[4], [angle], [0.0])]
    assert torch.autograd.gradcheck(lambda *a: moved_points(points, *a), inputs, atol=1e-7)


@ANGLES
def test_the_turn_of_a_loss_has_a_finite_gradient(angle):
    """The corrected angle is smooth everywhere; the printed one has a kink at 0 and pi."""
    points = torch.tensor(WAYS)
    other = torch.tensor(se3.rotation_from_rotvec(angle * WAYS[0]))

    eye, still = torch.eye(3, dtype=torch.float64, requires_grad=True), torch.zeros(3).double()
    assert torch.autograd.gradcheck(
        lambda rot: articulation_loss(rot, still, (points, points), other), eye, atol=1e-6)
    rotation_angle(eye, other).backward()
    assert torch.isfinite(eye.grad).all()


@ANGLES
@pytest.mark.parametrize("target", [0, 1])
def test_a_joints_rates_are_its_velocities(angle, target):
    joint = Joint("revolute", WAYS[0], WAYS[1], angle)
    rates = at(joint, 2.0).rates(target)
    sign, expected = (1.0 if target else -1.0), np.zeros((4, 4))
    expected[:3, :3] = sign * se3.hat(joint.axis)
    expected[:3, 3] = -expected[:3, :3] @ joint.origin
    np.testing.assert_allclose(rates[2], expected, atol=2e-5)  # one-sided: half a step of 1e-5
    slider = replace(joint, kind="prismatic")
    np.testing.assert_allclose(at(slider, 2.0).rates(target)[2, :3, 3], sign * 2 * joint.axis,
                               atol=1e-9)
    assert np.isfinite(rates).all()
