"""Turns: a part's own edges in both states tell how far it turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toys import pictures

from part2gs_robotics.evidence.edges import bundled
from part2gs_robotics.evidence.part_edges import PartEdges
from part2gs_robotics.evidence.segments import Segments
from part2gs_robotics.joints.drawn_to_edges import BEND, turn_of, turned
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

AXIS = np.array([0.0, 0.0, 1.0])
VALUE = 0.9


def edges_of(lines, eyes, rng, turn=VALUE):
    """Return the edges of a part whose lines [N, 2, 3] turn about AXIS between the states."""
    move = se3.screw_motion(AXIS, np.array([0.1, 0.2, 0.0]), turn, 0.0)
    pairs = [lines, se3.apply(move, lines.reshape(-1, 3)).reshape(-1, 2, 3)]
    seen = [pictures(pair, *eyes, rng) for pair in pairs]
    ways = [(p[:, 1] - p[:, 0]) / np.linalg.norm(p[:, 1] - p[:, 0], axis=1)[:, None] for p in pairs]
    count = len(eyes[0])
    return PartEdges((bundled([seen[0]]), bundled([seen[1]])),
                     (np.tile(ways[0], (count, 1)), np.tile(ways[1], (count, 1))))


@pytest.fixture(scope="module")
def eyes(toy):
    return toy.cameras(20, 200, np.zeros(3), 1.0)


def door(rng):
    """Return 4 lines across the axis and 4 along it."""
    start = rng.uniform(-0.3, 0.3, (8, 3))
    way = np.repeat([[0.4, 0.0, 0.0], [0.0, 0.0, 0.4]], 4, 0)
    return np.stack([start, start + way], 1)


@pytest.mark.parametrize("off", [0.0, 0.5, -0.8])
def test_a_turn_is_told_from_a_start_that_is_off(eyes, off):
    edges = edges_of(door(np.random.default_rng(0)), eyes, np.random.default_rng(1))
    turn, error = turn_of(edges, AXIS, VALUE + np.deg2rad(off))
    assert turn == pytest.approx(VALUE, abs=np.deg2rad(0.02))
    assert abs(turn - VALUE) < 3 * error < np.deg2rad(0.3)


def test_edges_along_the_axis_tell_nothing(eyes):
    edges = edges_of(door(np.random.default_rng(0))[4:], eyes, np.random.default_rng(1))
    assert turn_of(edges, AXIS, VALUE) is None


def test_edges_that_did_not_turn_so_far_tell_nothing(eyes):
    edges = edges_of(door(np.random.default_rng(0)), eyes, np.random.default_rng(1), VALUE + 0.2)
    assert turn_of(edges, AXIS, VALUE) is None


def test_a_part_without_edges_keeps_its_turn(eyes):
    nothing = Segments(np.zeros((0, 2, 2)), np.zeros(0, np.int64), *eyes)
    edges = PartEdges((bundled([nothing]),) * 2, (np.zeros((0, 3)),) * 2)
    assert turn_of(edges, AXIS, VALUE) is None
    joint = Joint("revolute", AXIS, np.zeros(3), VALUE, sigma_axis=0.01, sigma_value=0.01)
    assert turned(joint, np.eye(5), edges, 1.0) is joint


def test_a_joint_turns_as_far_as_its_edges_and_its_place_follows(eyes):
    edges = edges_of(door(np.random.default_rng(0)), eyes, np.random.default_rng(1))
    off = np.deg2rad(0.2)
    joint = Joint("revolute", AXIS, np.array([0.1, 0.2, 0.0]), VALUE - off, sigma_value=BEND)
    h = np.eye(5) * 1e4
    h[2, 3] = h[3, 2] = -5e3
    out = turned(joint, h, edges, 1.0)
    assert abs(out.value - VALUE) < 0.2 * off
    assert out.sigma_value < joint.sigma_value
    np.testing.assert_allclose(out.axis, AXIS)
    moved = np.linalg.norm(out.origin - joint.origin)
    assert moved == pytest.approx(0.5 * (out.value - joint.value), rel=2e-2)
    assert turned(replace(joint, value=VALUE - 10 * off), h, edges, 1.0).value == VALUE - 10 * off
    loose = h.copy()  # its place hangs on the turn by what no image shows
    loose[3:, 3:] = 0.0
    assert turned(joint, loose, edges, 1.0) is joint
    slide = replace(joint, kind="prismatic")
    assert turned(slide, np.eye(3), edges, 1.0) is slide
    carried = replace(joint, carrier=np.eye(4))
    assert turned(carried, h, edges, 1.0) is carried
