"""Signed distance to surfels: signs beside edges and in corners, and gradients of contact by it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from part2gs_robotics.paper import joint_terms
from part2gs_robotics.paper.joint_terms import Base
from part2gs_robotics.paper.losses import contact_loss, moved_points

pytestmark = pytest.mark.usefixtures("one_torch_thread")
LO, HI = np.array([0.0, 0, 0]), np.array([1.0, 0.8, 0.6])


@pytest.fixture(scope="module")
def board():
    """Return the Base of a box's surface, 12,000 random surfels."""
    rng = np.random.default_rng(0)
    points = LO + rng.random((12_000, 3)) * (HI - LO)
    axis, end = rng.integers(3, size=len(points)), rng.integers(2, size=len(points))
    points[np.arange(len(points)), axis] = np.where(end, HI[axis], LO[axis])
    normals = np.zeros_like(points)
    normals[np.arange(len(points)), axis] = 2.0 * end - 1
    return Base(points, normals, float(np.linalg.norm(HI - LO)))


def exact(points):
    """Return the signed distance of a box."""
    out = np.maximum(LO - points, points - HI)
    return np.where((out < 0).all(1), out.max(1), np.linalg.norm(np.maximum(out, 0), axis=1))


def test_behind_all_near_surfels_is_inside_and_beside_an_edge_is_not(board, monkeypatch):
    rng = np.random.default_rng(1)
    points = LO - 0.2 + rng.random((20_000, 3)) * (HI - LO + 0.4)
    edge = points.copy()
    edge[:, :2] = HI[:2] + rng.normal(size=(len(points), 2)) * 0.02  # along one edge

    def wrong(cloud):
        true, found = exact(cloud), board(torch.from_numpy(cloud)).numpy()
        return float((found[true > 0] < 0).mean()), true, found

    for cloud in (points, edge):
        share, true, found = wrong(cloud)
        deep = true < -0.02
        assert (found[deep] < 0).all()
        assert np.abs(found - true)[deep].max() < 0.02
        with monkeypatch.context() as patch:
            patch.setattr(joint_terms, "AGREE", 1)
            assert share < 0.25 * wrong(cloud)[0], "the nearest alone errs four times as often"


def test_contact_has_its_closed_form_on_a_face_that_was_pushed_in(board):
    """A sheet d inside a face: the mean of squares is d^2."""
    for d in (0.01, 0.03, 0.05):
        x, y = np.meshgrid(np.linspace(0.2, 0.8, 20), np.linspace(0.2, 0.6, 20))
        sheet = np.stack([x.ravel(), y.ravel(), np.full(x.size, HI[2] - d)], 1)
        assert float(contact_loss(torch.from_numpy(sheet), sdf=board)) == pytest.approx(d**2)


def test_gradients_of_contact_through_joint_and_surfels_are_those_of_differences(board):
    rng = np.random.default_rng(2)
    points = torch.from_numpy(LO + 0.1 + rng.random((12, 3)) * 0.3)
    turns, slides = torch.tensor([0.0, 0.2]).double(), torch.tensor([0.0, 0.05]).double()
    axis = torch.tensor([0.2, 0.1, 1.0], dtype=torch.float64, requires_grad=True)
    origin = torch.tensor([0.0, 0.1, 0.0], dtype=torch.float64, requires_grad=True)

    def swept(a, o):
        return contact_loss(moved_points(points, a, o, turns, slides), sdf=board)

    assert float(swept(axis, origin).detach()) > 0
    assert torch.autograd.gradcheck(swept, (axis, origin), eps=1e-7, atol=1e-6, rtol=1e-5)


def test_without_surfels_everything_is_free():
    nothing = Base(np.zeros((0, 3)), np.zeros((0, 3)), 1.0)
    assert torch.isinf(nothing(torch.zeros(4, 3).double())).all()
