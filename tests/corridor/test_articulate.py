"""End to end: two states of a textured object in, its parts and joints out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from part2gs_robotics.articulate import _about_number, _require_parts, articulate
from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.grow import decide
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.canonical import canonical
from part2gs_robotics.evidence.depth_maps import observe, render_depth_maps
from part2gs_robotics.model import se3

VIEWS = 24
HINGE = (np.array([0.0, 0, 1]), np.array([0.0, -0.05, 0.0]), -0.9)


def observed(toy, before, after, side=128, centre=(0.4, 0.3, 0.35), diag=1.0):
    """Return the scene and the Gaussians of two lists of boxes, photos drawn from the Gaussians."""
    Ks, views = toy.cameras(VIEWS, side, np.array(centre), diag)
    gaussians = tuple(toy.gaussians_of(boxes, 0.02)[0] for boxes in (before, after))
    states = tuple(toy.drawn(g, Ks, views, side) for g in gaussians)
    return toy.scene_of(states), gaussians


def degrees_between(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


@pytest.mark.slow
def test_a_drawer_and_a_door_are_found(toy):
    base = toy.Box((0, 0, 0), (0.8, 0.6, 0.45), 1)
    block, door = ((0.05, 0.1, 0.45), (0.4, 0.5, 0.7)), ((0, -0.05, 0), (0.8, -0.01, 0.45))
    slide = se3.make(np.eye(3), np.array([0.3, 0, 0]))
    turn = se3.screw_motion(*HINGE, 0.0)
    scene, gaussians = observed(
        toy, [base, toy.Box(*block, 2), toy.Box(*door, 3)],
        [base, toy.Box(*block, 2, slide), toy.Box(*door, 3, turn)],
        side=160, centre=(0.4, 0.1, 0.35), diag=1.25)
    told = []
    motion = articulate(canonical(scene, gaussians), ArticulateConfig(), lambda *a: told.append(a))
    assert sorted(j.kind for j in motion.joints) == ["prismatic", "revolute"]
    by_kind = {j.kind: j for j in motion.joints}
    assert degrees_between(by_kind["prismatic"].axis, np.array([1.0, 0, 0])) < 2.0
    assert by_kind["prismatic"].value == pytest.approx(0.3, rel=0.02)
    assert degrees_between(by_kind["revolute"].axis, -HINGE[0]) < 2.0
    assert by_kind["revolute"].value == pytest.approx(0.9, rel=0.03)
    arm = np.cross(by_kind["revolute"].origin - HINGE[1], HINGE[0])
    assert np.linalg.norm(arm) < 0.02
    labels = toy.gaussians_of([base, toy.Box(*block, 2), toy.Box(*door, 3)], 0.02)[1]
    order = [0, *(1 + [j.kind for j in motion.joints].index(k) for k in ("prismatic", "revolute"))]
    maps = render_depth_maps(gaussians[0], scene.states[0], np.inf)
    seen = observe(gaussians[0].means, maps, 0.01).surface > 2  # no photo shows faces that touch
    assert seen.mean() > 0.6
    assert (motion.labels(0) == np.array(order)[labels])[seen].mean() > 0.95
    assert [step for step, _, _ in told] == [1, 2, 3, 4, 5]
    for s in (0, 1):
        assert motion.part_probs[s].shape == (len(gaussians[s]), 3)
        assert np.allclose(motion.part_probs[s].sum(1), 1.0, atol=1e-4)


def slid_block(toy):
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.4), 1), ((0.05, 0.1, 0.4), (0.4, 0.5, 0.7))
    slide = se3.make(np.eye(3), np.array([0.3, 0, 0]))
    return observed(toy, [base, toy.Box(*block, 2)], [base, toy.Box(*block, 2, slide)])


@pytest.mark.slow
def test_a_single_slide_is_found_without_being_told_the_number(toy):
    motion = articulate(canonical(*slid_block(toy)), ArticulateConfig())
    joint, = motion.joints
    assert joint.kind == "prismatic"
    assert motion.parents == (0,)
    assert degrees_between(joint.axis, np.array([1.0, 0, 0])) < 0.1
    assert joint.value == pytest.approx(0.3, rel=1e-3)


@pytest.mark.slow
def test_the_same_input_gives_the_same_motion(toy):
    scene, gaussians = slid_block(toy)
    one, two = (articulate(canonical(scene, gaussians), ArticulateConfig()) for _ in range(2))
    assert one.joints[0].value == two.joints[0].value
    assert np.array_equal(one.joints[0].axis, two.joints[0].axis)
    assert np.array_equal(one.part_probs[0], two.part_probs[0])


@pytest.mark.slow
def test_small_images_are_enough(toy):
    """The object is 40 pixels large: fewer surfels, but one in every pixel."""
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.4), 1), ((0.05, 0.1, 0.4), (0.4, 0.5, 0.7))
    slide = se3.make(np.eye(3), np.array([0.3, 0, 0]))
    scene, gaussians = observed(toy, [base, toy.Box(*block, 2)],
                                [base, toy.Box(*block, 2, slide)], side=96, diag=1.5)
    joint, = articulate(canonical(scene, gaussians), ArticulateConfig()).joints
    assert degrees_between(joint.axis, np.array([1.0, 0, 0])) < 2.0
    assert joint.value == pytest.approx(0.3, rel=0.03)


def test_without_a_motion_that_pays_the_input_is_refused(toy):
    scene, gaussians = slid_block(toy)
    found, _ = decide(Judge(toy.study_of(scene, gaussians)), [], None)
    with pytest.raises(FitError, match=r"toy: no rigid motion.*Expected at least one part.*check"):
        _require_parts(found, scene)


def test_when_nothing_moves_the_message_says_what_where_and_what_to_do(toy):
    boxes = [toy.Box((0, 0, 0), (0.8, 0.6, 0.4), 1)]
    scene, gaussians = observed(toy, boxes, boxes)
    with pytest.raises(FitError, match=r"toy: only 0 of \d+ surface points moved.*"
                                       r"Expected at least 0\.4%.*Photograph"):
        articulate(canonical(scene, gaussians), ArticulateConfig())


@pytest.mark.parametrize(("asked", "found", "short", "words"), [
    (None, 3, False, []), (3, 3, False, []), (4, 2, False, ["only 2"]),
    (1, 1, True, ["one more"]),
])
def test_a_wrong_number_of_parts_is_told(asked, found, short, words):
    notes = _about_number(asked, found, short, [])
    assert len(notes) == len(words)
    assert all(word in note and f"asks for {asked}" in note
               for word, note in zip(words, notes, strict=True))


def test_parts_that_gain_too_little_are_named():
    (note,) = _about_number(4, 4, False, [2.0, -0.5, 0.0, math.nan])
    assert "4 moving parts; part_2, part_3 would not be found" in note
