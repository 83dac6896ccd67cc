"""Motions along a part's own walls and edges, and motions that no joint makes."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.decide.made_joints import askew, crooked, square
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint

BOX = np.repeat(np.concatenate([np.eye(3), -np.eye(3)]), 50, axis=0)


def slide(axis, kind="prismatic"):
    return Joint(kind, np.asarray(axis) / np.linalg.norm(axis), np.zeros(3), 0.3)


def noisy(normals, degrees):
    rng = np.random.default_rng(0)
    out = normals + np.deg2rad(degrees) * rng.normal(size=normals.shape)
    return out / np.linalg.norm(out, axis=1, keepdims=True)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, -1, 0], [0, 0, 1]])
def test_a_box_slides_along_its_walls(axis):
    assert askew(slide(axis), noisy(BOX, 8)) == 0.0


@pytest.mark.parametrize("axis", [[0, 1, 1], [1, -1, 0], [0, 0.5, 0.87]])
def test_a_box_does_not_slide_between_its_walls(axis):
    assert askew(slide(axis), noisy(BOX, 8)) > 0.75


def test_the_frame_does_not_matter():
    rot = se3.rotation_from_rotvec(np.array([0.3, -0.8, 0.5]))
    for axis in (np.array([0, 0, 1.0]), np.array([0, 1.0, 1.0])):
        here, there = askew(slide(axis), BOX), askew(slide(rot @ axis), BOX @ rot.T)
        assert there == pytest.approx(here, abs=0.15)  # directions are tried 8 degrees apart


def test_a_ball_slides_anywhere_and_a_rod_along_itself():
    rng = np.random.default_rng(1)
    ball = rng.normal(size=(4000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    angle = rng.uniform(0, 2 * np.pi, 400)
    rod = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    assert askew(slide([0.2, 0.5, 0.8]), ball) == 0.0
    assert askew(slide([0, 0, 1]), rod) == 0.0
    assert askew(slide([0, 1, 1]), rod) > 0.9


def test_turns_and_parts_without_surfels_are_not_askew():
    assert askew(slide([0, 1, 1], kind="revolute"), BOX) == 0.0
    assert askew(slide([0, 1, 1]), BOX[:0]) == 0.0


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "screw"])
def test_axes_keep_to_edges_and_to_the_line_across_two(kind):
    known = square(np.eye(3)[:2])
    assert known.shape == (3, 3)
    for axis in np.eye(3):
        assert crooked(slide(axis, kind), known) == crooked(slide(-axis, kind), known) == 0.0
        near = axis + np.deg2rad(3.0) * np.roll(axis, 1)
        assert crooked(slide(near, kind), known) == 0.0
    assert crooked(slide([1, 1, 0], kind), known) == 1.0
    between = crooked(slide([1, np.tan(np.deg2rad(7.0)), 0], kind), known)
    assert between == pytest.approx(0.5)


def test_one_direction_of_edges_says_nothing_about_axes():
    assert square(np.eye(3)[:1]).shape == (0, 3)
    assert square(np.zeros((0, 3))).shape == (0, 3)
    nearly = np.array([[1, 0, 0], [np.cos(0.2), np.sin(0.2), 0]])  # no sure line across these
    assert square(nearly).shape == (0, 3)
    assert crooked(slide([1, 1, 0]), square(np.eye(3)[:1])) == 0.0
