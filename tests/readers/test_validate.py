"""Validation: good scenes pass, planted defects are found, invariant to the choice of world."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth_photos import write_ball_scene

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.se3 import make, rotation_from_rotvec
from part2gs_robotics.readers import validate
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.silhouettes import object_box, silhouettes

States = tuple[StateViews, StateViews]


@pytest.fixture(scope="module")
def states(ball_scene: Path) -> States:
    return read_scene(ball_scene, ReadConfig()).states


def moved(state: StateViews, new_from_old: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
          scale: float = 1.0) -> StateViews:
    """Return the state with its world moved by a rigid motion, then scaled."""
    viewmats = state.viewmats @ np.linalg.inv(new_from_old)
    viewmats[:, :3, 3] *= scale
    return replace(state, viewmats=viewmats)


def test_box_holds_the_object_and_little_more(states: States) -> None:
    low, high = object_box(silhouettes(states[0]), "state 0")
    assert (low < [-0.68, -0.68, -0.68]).all()
    assert (high > [1.13, 0.68, 0.68]).all()
    assert (high - low < 1.45 * np.array([1.85, 1.4, 1.4])).all()


@pytest.mark.parametrize("scale", [0.001, 1.0, 1000.0])
def test_any_world_frame_and_scale_pass(states: States, scale: float) -> None:
    rng = np.random.default_rng(1)
    motion = make(rotation_from_rotvec(rng.normal(size=3)), 10 * rng.normal(size=3))
    first, second = (moved(state, motion, scale) for state in states)
    validate.check_frames((first, second), "scene")


@pytest.mark.parametrize("direction", [0, 1, 2])
def test_states_shifted_apart_are_found(states: States, direction: int) -> None:
    shift = np.eye(4)
    shift[direction, 3] = 1.2  # most of the width of the object
    with pytest.raises(SceneError, match="not in one frame"):
        validate.check_frames((states[0], moved(states[1], shift)), "scene")


def test_states_that_share_little_surface_are_doubted(states: States) -> None:
    assert validate.check_frames(states, "scene") == ()
    shift = np.eye(4)
    shift[2, 3] = 0.17  # a tenth of the width
    (note,) = validate.check_frames((states[0], moved(states[1], shift)), "scene")
    assert "one frame" in note


def test_one_state_of_another_scale_is_found(states: States) -> None:
    with pytest.raises(SceneError, match="not in one frame"):
        validate.check_frames((states[0], moved(states[1], np.eye(4), 2.0)), "scene")


def test_mirrored_camera_axes_are_found(states: States) -> None:
    flipped = replace(states[0], viewmats=np.diag([1.0, -1.0, -1.0, 1.0]) @ states[0].viewmats)
    with pytest.raises(SceneError, match="OpenGL axes"):
        validate.check_frames((flipped, states[1]), "scene")


@pytest.mark.parametrize(("share", "refused"), [(0.1, False), (0.5, True)])
def test_a_few_lost_masks_are_forgiven(states: States, share: float, refused: bool) -> None:
    alphas = states[0].alphas.copy()
    alphas[: int(share * len(alphas))] = 0
    broken = replace(states[0], alphas=alphas)
    if refused:
        with pytest.raises(SceneError, match="12 of 24 masks are empty"):
            validate.check_masks(broken, "state 0")
    else:
        validate.check_masks(broken, "state 0")
        validate.check_frames((broken, states[1]), "scene")


def cube(size: int, low: int, high: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    out = np.zeros((size,) * 3, bool)
    out[low:high, low:high, low:high] = True
    return out


def test_agreement_of_equal_disjoint_and_nested_cubes() -> None:
    a = cube(20, 4, 12)
    assert validate.hull_agreement(a, a) == (1.0, 1.0)
    assert validate.hull_agreement(a, cube(20, 14, 18)) == (0.0, 0.0)
    iou, same = validate.hull_agreement(a, cube(20, 7, 9))
    assert iou == 8 / 512
    assert same == 0.0


def test_agreement_does_not_depend_on_the_order() -> None:
    rng = np.random.default_rng(0)
    a, b = (rng.random((12, 12, 12)) < 0.6 for _ in range(2))
    assert validate.hull_agreement(a, b) == validate.hull_agreement(b, a)


def test_too_few_views_are_counted(tmp_path: Path) -> None:
    scene = write_ball_scene(tmp_path / "s", views=validate.MIN_VIEWS - 1)
    with pytest.raises(SceneError, match="19 posed images"):
        read_scene(scene, ReadConfig())
