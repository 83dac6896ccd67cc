"""Masks that the others contradict are found, whichever way they are wrong; right ones stay."""

from __future__ import annotations

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.model.se3 import make, rotation_from_rotvec
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.wrong_masks import right_masks, without_wrong_masks


@pytest.fixture(scope="module")
def state(ball_scene):
    return read_scene(ball_scene, ReadConfig()).states[0]


def shifted(mask):
    return np.roll(mask, round(0.15 * mask.shape[1]), axis=1)


def halved(mask):
    left = mask.copy()
    left[:, : int(np.median(np.nonzero(mask)[1]))] = 0
    return left


def with_a_blob(mask):
    rows, columns = np.nonzero(mask)
    side = int(0.4 * np.ptp(columns))
    out = mask.copy()
    out[rows.min():rows.min() + side, max(0, columns.min() - side):columns.min()] = 255
    return out


def spoilt(state, views, how):
    alphas = state.alphas.copy()
    for view in views:
        alphas[view] = how(alphas[view])
    return replace(state, alphas=alphas)


@pytest.mark.parametrize("how", [shifted, halved, with_a_blob, np.zeros_like])
@pytest.mark.parametrize("views", [[3], [5, 11]])
def test_wrong_masks_are_found_and_no_other(state, views, how):
    right = right_masks(spoilt(state, views, how), "state 0")
    assert np.flatnonzero(~right).tolist() == views


def test_right_masks_stay_as_they_are(ball_scene):
    for state in read_scene(ball_scene, ReadConfig()).states:
        assert right_masks(state, "state").all()
        kept, note = without_wrong_masks(state, "state")
        assert kept is state
        assert not note


def test_a_wrong_pose_is_found_as_well(state):
    viewmats = state.viewmats.copy()
    viewmats[7] = make(rotation_from_rotvec(np.array([0.0, 0.2, 0.0])), np.zeros(3)) @ viewmats[7]
    right = right_masks(replace(state, viewmats=viewmats), "state 0")
    assert np.flatnonzero(~right).tolist() == [7]


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_the_world_s_unit_does_not_matter(state, scale):
    viewmats = state.viewmats.copy()
    viewmats[:, :3, 3] *= scale
    bad = replace(spoilt(state, [3, 9], shifted), viewmats=viewmats)
    assert np.flatnonzero(~right_masks(bad, "state 0")).tolist() == [3, 9]


def test_masks_smeared_by_a_few_pixels_stay(state):
    brush = np.ones((3, 3), np.uint8)
    for how in (cv2.dilate, cv2.erode):
        assert right_masks(spoilt(state, [3, 9], lambda m, f=how: f(m, brush)), "state").all()


def test_too_many_to_be_outvoted_are_kept_and_said(state):
    bad = spoilt(state, range(0, len(state), 3), np.zeros_like)
    kept, note = without_wrong_masks(bad, "State 0")
    assert kept is bad
    assert note.startswith("State 0: 8 of 24 masks")
    assert "too many to leave out" in note


def test_views_leave_with_all_that_is_theirs(state):
    depths = np.arange(len(state), dtype=np.float32)[:, None, None] * np.ones_like(state.alphas)
    counts = depths.astype(np.uint16), np.arange(len(state), dtype=float)
    bad = replace(spoilt(state, [3], shifted), depths=depths, depth_counts=counts)
    kept, note = without_wrong_masks(bad, "State 0")
    stay = np.delete(np.arange(len(state)), 3)
    assert state.names[3] in note
    assert kept.names == tuple(np.array(state.names)[stay])
    assert (kept.depths[:, 0, 0] == stay).all()
    assert (kept.depth_counts[0][:, 0, 0] == stay).all()
    assert (kept.depth_counts[1] == stay).all()
    for name in ("images", "alphas", "Ks", "viewmats", "held_out"):
        assert np.array_equal(getattr(kept, name), getattr(bad, name)[stay])


def test_the_reader_leaves_them_out_and_says_so(ball_scene, tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(ball_scene, scene)
    before = read_scene(ball_scene, ReadConfig())
    photos = sorted(path for path in scene.rglob("*.png") if "end" in path.parts)
    wrong = [photos[k] for k in np.flatnonzero(before.states[1].held_out)]
    for photo in wrong:
        image = cv2.imread(str(photo), cv2.IMREAD_UNCHANGED)
        image[..., 3] = shifted(image[..., 3])
        cv2.imwrite(str(photo), image)
    found = read_scene(scene, ReadConfig())
    assert len(found.states[0]) == len(before.states[0])
    assert len(found.states[1]) == len(before.states[1]) - len(wrong)
    assert found.states[1].held_out.any()  # others measure the fit now
    (note,) = set(found.notes) - set(before.notes)
    assert note.startswith(f"State 1: {len(wrong)} of ")
    assert all(photo.name in note for photo in wrong)
