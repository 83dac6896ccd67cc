"""Orders: every way from state 0 to state 1 on which joints go one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import chain, orders, ways
from part2gs_robotics.model.se3 import inverse

SLIDE = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.4)
TURN = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.3, 0.1, 0]), 1.2)
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], float)
STEP = 0.05


def from_part(part, other, parents, q):
    return inverse(chain(part, [SLIDE, TURN], parents, q)) @ chain(other, [SLIDE, TURN], parents, q)


@pytest.mark.parametrize(("part", "other", "parents", "count"), [
    (1, 0, (0, 0), 1), (2, 1, (0, 0), 3), (2, 1, (0, 1), 1), (0, 2, (0, 1), 3)])
def test_every_order_leads_from_state_0_to_state_1(part, other, parents, count) -> None:
    """All at once, and of two joints between the parts either first; a joint alone has one way."""
    found = orders(part, other, [SLIDE, TURN], parents, CORNERS, STEP)
    assert len(found) == count
    for poses in found:
        np.testing.assert_allclose(poses[0], np.eye(4), atol=1e-12)
        np.testing.assert_allclose(
            poses[-1], from_part(part, other, parents, (0.4, 1.2)), atol=1e-12)
        gaps = np.einsum("pij,nj->pni", poses[:, :3, :3], CORNERS) + poses[:, None, :3, 3]
        assert np.linalg.norm(np.diff(gaps, axis=0), axis=2).max() < 2 * STEP


def test_one_after_the_other_the_second_waits() -> None:
    _, first, second = orders(2, 1, [SLIDE, TURN], (0, 0), CORNERS, STEP)
    for poses, corner in ((first, (0.4, 0.0)), (second, (0.0, 1.2))):
        target = from_part(2, 1, (0, 0), corner)
        assert np.abs(poses - target).max((1, 2)).min() < 1e-12


def test_a_joint_alone_runs_as_in_its_way() -> None:
    alone = orders(1, 0, [SLIDE, TURN], (0, 0), CORNERS, STEP)[0]
    np.testing.assert_array_equal(alone, ways(1, 0, [SLIDE, TURN], (0, 0), CORNERS, STEP)[0])
