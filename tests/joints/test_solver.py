"""A joint's parameters are coordinates: each moves the part in a way of its own."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.joints.solver import parameters, perturbed
from part2gs_robotics.model.joint import Joint

DIAG = 1.4
TILT = np.array([1.0, 2, -0.5]) / np.linalg.norm([1.0, 2, -0.5])
JOINTS = [Joint("prismatic", TILT, np.array([0.1, 0.2, 0.3]), 0.4),
          Joint("revolute", TILT, np.array([0.1, 0.2, 0.3]), 1.1),
          Joint("screw", TILT, np.array([0.1, 0.2, 0.3]), 1.1, 0.2)]


@pytest.mark.parametrize("joint", JOINTS, ids=["prismatic", "revolute", "screw"])
def test_every_parameter_moves_the_part_in_its_own_way(joint):
    count = len(parameters(joint))

    def moved(change):
        return perturbed(joint, change, DIAG).state1_from_0

    assert not parameters(joint).any()
    assert np.allclose(moved(np.zeros(count)), joint.state1_from_0)
    step, eye = 1e-5, np.eye(count)
    rates = np.stack([(moved(step * e) - moved(-step * e)) / (2 * step) for e in eye])
    flat = rates[:, :3].reshape(count, -1)
    assert np.linalg.matrix_rank(flat, tol=1e-3) == count
    both = (moved(step * (eye[0] + eye[2])) - joint.state1_from_0) / step
    assert np.allclose(both, rates[0] + rates[2], atol=1e-3)  # linear to first order


@pytest.mark.parametrize("joint", JOINTS, ids=["prismatic", "revolute", "screw"])
def test_tilts_are_radians_across_the_axis_and_offsets_diagonals(joint):
    for i in (0, 1):
        tilted = perturbed(joint, 1e-4 * np.eye(len(parameters(joint)))[i], DIAG)
        assert np.arccos(np.clip(tilted.axis @ joint.axis, -1, 1)) == pytest.approx(1e-4, rel=1e-3)
    value = perturbed(joint, 0.01 * np.eye(len(parameters(joint)))[2], DIAG).value - joint.value
    assert value == pytest.approx(0.01 * DIAG if joint.kind == "prismatic" else 0.01)
    if joint.kind != "prismatic":
        for i in (3, 4):
            step = 0.01 * np.eye(len(parameters(joint)))[i]
            shift = perturbed(joint, step, DIAG).origin - joint.origin
            assert np.linalg.norm(shift) == pytest.approx(0.01 * DIAG)
            assert shift @ joint.axis == pytest.approx(0.0, abs=1e-12)


def test_a_screw_turned_further_rises_as_far_and_its_rise_is_a_length():
    joint = JOINTS[2]
    for i, more in ((2, 0.0), (5, 0.01 * DIAG)):
        new = perturbed(joint, 0.01 * np.eye(6)[i], DIAG)
        assert new.rise == pytest.approx(joint.rise + more)
