"""A joint moves its part one way, however it is asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import PARAMETERS, Joint

AXIS = np.array([1.0, 2, -0.5]) / np.linalg.norm([1.0, 2, -0.5])
ORIGIN = np.array([0.1, 0.2, 0.3])
CARRIER = se3.screw_motion(np.array([0, 0.6, 0.8]), np.array([0.1, 0.2, 0.3]), 0.7, 0.1)
JOINTS = {
    "prismatic": Joint("prismatic", AXIS, ORIGIN, 0.4),
    "revolute": Joint("revolute", AXIS, ORIGIN, 1.1),
    "screw": Joint("screw", AXIS, ORIGIN, 1.1, 0.2),
}
KINDS = pytest.mark.parametrize("kind", list(JOINTS))
CLOSE = {"rtol": 0.0, "atol": 1e-14}  # a few roundings of numbers of order 1


@KINDS
@pytest.mark.parametrize("value", [0.4, -2.9, 1e-9, 0.0])
@pytest.mark.parametrize("carrier", [None, CARRIER])
def test_the_motion_between_the_states_is_the_same_by_every_name(kind, value, carrier):
    joint = replace(JOINTS[kind], value=value, carrier=carrier)
    outer = np.eye(4) if carrier is None else carrier
    np.testing.assert_allclose(joint.state1_from_0, joint.move, **CLOSE)
    np.testing.assert_allclose(outer @ joint.transform(value), joint.move, **CLOSE)
    np.testing.assert_allclose(joint.own, joint.transform(value), **CLOSE)
    np.testing.assert_allclose(outer @ joint.own, joint.move, **CLOSE)


@KINDS
def test_a_motion_is_rigid_and_at_zero_there_is_none(kind):
    joint = JOINTS[kind]
    rot = joint.move[:3, :3]
    np.testing.assert_allclose(rot @ rot.T, np.eye(3), **CLOSE)
    assert np.linalg.det(rot) == pytest.approx(1.0)
    np.testing.assert_allclose(joint.transform(0.0), np.eye(4), **CLOSE)
    there_and_back = joint.transform(0.3) @ joint.transform(-0.3)
    np.testing.assert_allclose(there_and_back, np.eye(4), **CLOSE)


@KINDS
def test_many_positions_are_each_alone(kind):
    joint, q = JOINTS[kind], np.linspace(-2.0, 2.0, 9)
    np.testing.assert_array_equal(joint.transforms(q), [joint.transform(v) for v in q])


def test_a_slide_goes_along_its_axis_a_turn_leaves_it_and_a_screw_does_both():
    slide, turn, screw = JOINTS.values()
    on_axis = ORIGIN + 0.6 * AXIS
    gaps = [se3.apply(h.move, on_axis) - on_axis for h in (slide, turn, screw)]
    for gap, way in zip(gaps, (0.4, 0.0, 0.2 * 1.1), strict=True):
        np.testing.assert_allclose(gap, way * AXIS, **CLOSE)
    assert [h.rise for h in (slide, turn)] == [0.0, 0.0]
    assert screw.rise == pytest.approx(0.2 * 1.1)
    assert [h.turns for h in (slide, turn, screw)] == [False, True, True]
    np.testing.assert_allclose(screw.own, turn.own @ se3.make(np.eye(3), screw.rise * AXIS),
                               **CLOSE)
    assert [PARAMETERS[h.kind] for h in (slide, turn, screw)] == [3, 5, 6]


def test_a_joint_on_the_base_carries_nothing_extra():
    joint = JOINTS["revolute"]
    np.testing.assert_array_equal(joint.move, joint.own)
    np.testing.assert_array_equal(replace(joint, carrier=CARRIER).own, joint.own)
