"""States out of one frame are brought into it by what stayed; others are left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth_photos import box_depth, viewmats_around, write_ball_scene

from part2gs_robotics.align.align_states import carried, on_what_stayed
from part2gs_robotics.align.hull_field import hull_field
from part2gs_robotics.cli import main
from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.se3 import apply, inverse, make, rotation_from_rotvec, turn

SIDE, FOCAL, LOW, HIGH = 128, 190.0, np.array([-0.6, -1.1, -0.5]), np.array([0.6, 0.5, 0.5])
SIZE = float(np.linalg.norm(HIGH - LOW))
BODY = (np.array([-0.5, -0.3, -0.4]), np.array([0.5, 0.4, 0.4]))
DOOR = (np.array([0.0, -0.1, -0.4]), np.array([1.0, 0.0, 0.4]))  # as wide as the body


def at_hinge(angle: float) -> np.ndarray:
    """Return world_from_door, the hinge at the body's left front edge."""
    return make(rotation_from_rotvec(np.array([0, 0, -angle])), np.array([-0.5, -0.3, 0.0]))


def state(angle: float, views: int, body: bool = True) -> StateViews:
    """Return silhouettes of the box and its door, seen from all around; colours say nothing."""
    poses, alphas = viewmats_around(views, 4.0), []
    for pose in poses:
        seen = [box_depth(pose @ at_hinge(angle), *DOOR, SIDE, FOCAL)]
        seen += [box_depth(pose, *BODY, SIDE, FOCAL)] if body else []
        alphas.append(255 * np.isfinite(np.min(seen, 0)).astype(np.uint8))
    K = np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1.0]])
    blank = np.zeros((views, SIDE, SIDE, 3), np.uint8)
    return StateViews(blank, np.stack(alphas), np.tile(K, (views, 1, 1)), poses, None,
                      tuple(map(str, range(views))), np.zeros(views, bool))


@pytest.fixture(scope="module")
def states() -> tuple[StateViews, StateViews]:
    return state(0.0, 32), state(1.4, 32)


def planted(rng: np.random.Generator, degrees: float, share: float) -> np.ndarray:
    turned, shift = rng.normal(size=3), rng.normal(size=3)
    return make(rotation_from_rotvec(np.deg2rad(degrees) * turned / np.linalg.norm(turned)),
                share * SIZE * shift / np.linalg.norm(shift))


def off(motion: np.ndarray) -> tuple[float, float]:
    """Return what is left of a motion: degrees, and the most it moves a corner, of the size."""
    corners = np.stack(np.meshgrid(*np.stack([LOW, HIGH], 1), indexing="ij"), -1).reshape(-1, 3)
    moved = np.linalg.norm(apply(motion, corners) - corners, axis=1).max()
    return np.degrees(turn(motion)), float(moved) / SIZE


def test_a_planted_offset_is_taken_out_though_the_door_is_half_of_the_picture(states):
    wrong = planted(np.random.default_rng(0), 2.0, 0.02)
    moved, note = on_what_stayed((states[0], carried(states[1], wrong)), (LOW, HIGH), "scene")
    left = moved.viewmats[0]
    degrees, share = off(inverse(left) @ states[1].viewmats[0])
    assert degrees < 0.5
    assert share < 0.006
    assert "(--align)" in note


def test_states_in_one_frame_are_left_alone_to_the_last_bit(states):
    same, note = on_what_stayed(states, (LOW, HIGH), "scene")
    assert same is states[1]
    assert "changed nothing" in note


def test_where_too_little_stays_it_says_so(states):
    other = carried(state(0.0, 32, body=False), planted(np.random.default_rng(2), 70.0, 0.05))
    with pytest.raises(SceneError, match="--align found no frame"):
        on_what_stayed((states[0], other), (LOW, HIGH), "scene")


@pytest.mark.slow
def test_unit_and_place_of_the_world_change_nothing(states):
    wrong = planted(np.random.default_rng(3), 2.0, 0.02)
    pair = states[0], carried(states[1], wrong)
    here = on_what_stayed(pair, (LOW, HIGH), "scene")[0].viewmats[0]
    unit = 1000.0
    first, second = (replace(s, viewmats=s.viewmats * scaled(unit)) for s in pair)
    there = on_what_stayed((first, second), (unit * LOW, unit * HIGH), "scene")[0].viewmats[0]
    np.testing.assert_allclose(there / scaled(unit), here, atol=2e-4)


def scaled(unit: float) -> np.ndarray:
    out = np.ones((4, 4))
    out[:3, 3] = unit
    return out


def test_the_field_is_the_distance_to_a_box(states):
    field = hull_field(state(0.0, 40), LOW, HIGH)
    beside = np.array([[-0.57, 0.1, 0.0], [0.54, 0.1, 0.1], [0.0, 0.1, 0.45]])
    far = np.array([-0.07, -0.04, -0.05])
    np.testing.assert_allclose(field.at(beside)[0], far, atol=0.02)
    step = 1e-4 * np.eye(3)[0]
    slope = (field.at(beside + step)[0] - field.at(beside - step)[0]) / 2e-4
    np.testing.assert_allclose(field.at(beside)[1][:, 0], slope, atol=1e-3)


def test_inspect_takes_the_flag_and_says_what_it_did(tmp_path: Path, capsys) -> None:
    scene = write_ball_scene(tmp_path / "scene")
    assert main(["inspect", str(scene), "--align", "--json"]) == 0
    assert "--align changed nothing" in capsys.readouterr().out
