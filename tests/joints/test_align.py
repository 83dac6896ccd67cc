"""Direct alignment pulls a slightly wrong joint back to the images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.guides import guides_of
from part2gs_robotics.joints import align as align_room
from part2gs_robotics.joints.align import AlignmentProblem, align
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.small_views import small_views

SIDE, VIEWS, DIAG = 128, 10, 1.2
TRUTH = {
    "revolute": Joint("revolute", np.array([0.0, 0, -1]), np.array([0.0, -0.05, 0.3]), 0.8),
    "prismatic": Joint("prismatic", np.array([0.0, -1, 0]), np.array([0.4, 0.0, 0.3]), 0.3),
    "screw": Joint("screw", np.array([0.0, 0, -1]), np.array([0.0, -0.05, 0.3]), 0.8, 0.1),
}


@pytest.fixture(scope="module", params=list(TRUTH))
def photographed(request, toy):
    """A textured plate in front of a base, moved by the true joint, drawn in both states."""
    truth = TRUTH[request.param]
    boxes = [toy.Box((0, 0, 0), (0.8, 0.5, 0.6), 1), toy.Box((0, -0.05, 0), (0.8, -0.02, 0.6), 2)]
    gaussians, labels = toy.gaussians_of(boxes, 0.025)
    after = toy.gaussians_of([boxes[0], replace(boxes[1], move=truth.state1_from_0)], 0.025)[0]
    Ks, cameras = toy.cameras(VIEWS, SIDE, np.array([0.4, 0.1, 0.3]), 1.3)
    views = tuple(small_views(toy.drawn(g, Ks, cameras, SIDE), VIEWS, SIDE)
                  for g in (gaussians, after))
    return truth, AlignmentProblem((gaussians, after), (labels, labels), views, DIAG)


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def test_a_joint_off_by_one_degree_and_one_percent_comes_back(photographed):
    truth, problem = photographed
    tilt = se3.rotation_from_rotvec(np.deg2rad(1.0) * np.array([0.8, 0.0, 0.6]))
    start = replace(truth, axis=tilt @ truth.axis, value=truth.value * 1.01,
                    pitch=truth.pitch * 1.1)
    if truth.kind != "prismatic":
        start = replace(start, origin=truth.origin + np.array([0.008, -0.006, 0]))
    found, = align(problem, [start])
    assert degrees_between(start.axis, truth.axis) > 0.5
    assert degrees_between(found.axis, truth.axis) < 0.1
    assert found.value == pytest.approx(truth.value, rel=1e-3)
    if truth.kind != "prismatic":
        arm = np.cross(found.origin - truth.origin, truth.axis)
        assert np.linalg.norm(arm) < 1e-3 * DIAG
        assert 0 < found.sigma_origin < 0.01
    assert found.pitch == pytest.approx(truth.pitch, rel=1e-2)
    assert 0 < found.sigma_rise < 0.01 or truth.kind != "screw"
    assert 0 < found.sigma_axis < np.deg2rad(1.0)
    assert 0 < found.sigma_value < 0.01
    assert found.kind == truth.kind


def test_the_true_joint_stays(photographed):
    truth, problem = photographed
    found, = align(problem, [truth])
    assert degrees_between(found.axis, truth.axis) < 0.1
    assert found.value == pytest.approx(truth.value, rel=1e-3)


@pytest.mark.parametrize("drawn_by", [0.0, 3.0])
def test_a_joint_follows_clues_unless_the_images_are_clearly_against_it(
    photographed, monkeypatch, drawn_by
) -> None:
    truth, problem = photographed
    tilt = se3.rotation_from_rotvec(np.deg2rad(drawn_by) * np.array([0.8, 0.6, 0.0]))
    drawn = replace(truth, axis=tilt @ truth.axis)
    monkeypatch.setattr(align_room, "squared", lambda *_: drawn)
    monkeypatch.setattr(align_room, "turned", lambda joint, *_: joint)
    clues = align_room.Clues(guides_of([]), [None])  # type: ignore[list-item]
    found, = align(problem, [truth], clues=clues)
    assert (found is drawn) == (drawn_by == 0.0)
    assert degrees_between(found.axis, truth.axis) < 0.1


@pytest.mark.parametrize("right", [True, False])
def test_farther_clues_are_followed_where_the_images_like_them_better(
    photographed, monkeypatch, right
) -> None:
    truth, problem = photographed
    tilt = se3.rotation_from_rotvec(np.deg2rad(0.6) * np.array([0.8, 0.6, 0.0]))
    crooked = replace(truth, axis=tilt @ truth.axis)
    start, drawn = (crooked, truth) if right else (truth, crooked)
    monkeypatch.setattr(align_room, "squared", lambda joint, *rest: (
        drawn if rest[-1] == align_room.FARTHER else joint))
    monkeypatch.setattr(align_room, "turned", lambda joint, *_: joint)
    clues = align_room.Clues(guides_of([]), [None])  # type: ignore[list-item]
    here = (align_room.Level(0.7, 0.03, 0),)  # no steps: the joint is where it is
    found, = align(problem, [start], here, clues=clues)
    assert (found is drawn) == right
