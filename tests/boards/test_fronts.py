"""Fronts: what lies between lines from edge to edge, and whether it looks alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.boards.fronts import SIDE, broad_front, units_of
from part2gs_robotics.mesh.bodies import parted
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.solids import to_mesh

LOW, HIGH = np.array([-0.3, -0.2, 0.0]), np.array([0.1, 0.2, 0.6])  # its front is at x = 0.1
SLIDE = Joint("prismatic", np.array([1.0, 0.0, 0.0]), np.zeros(3), 0.25)
SIZE = 240  # pixels of a photo
K = np.array([[SIZE, 0, SIZE / 2], [0, SIZE, SIZE / 2], [0, 0, 1.0]])
ROWS = 3 * SIDE // 2  # of a painted front, as much higher than wide as the part's


def painted(lines, handles, seed=0):
    """Return a front, grey with a little noise: (row, share of the width) and rows of handles."""
    image = np.random.default_rng(seed).normal(90.0, 0.5, (ROWS, SIDE))
    for row, share in lines:
        image[round(row * ROWS) - 1 : round(row * ROWS) + 2, : round(share * SIDE)] = 70.0
    for row in handles:
        image[round(row * ROWS) - 4 : round(row * ROWS) + 4, 90:166] = 200.0
    return image.astype(np.uint8)


def photographed(front):
    """Return both states' photos of a part with such a front, from before it."""
    states = []
    for state in (0, 1):
        corners = np.array([[HIGH[0] + state * SLIDE.value, y, z] for y, z in
                            [(LOW[1], HIGH[2]), (HIGH[1], HIGH[2]), (HIGH[1], LOW[2]),
                             (LOW[1], LOW[2])]])
        eyes = [np.array([1.1, y, z]) for y in (-0.4, 0.0, 0.4) for z in (0.1, 0.5, 0.9)]
        viewmats = np.array([looking(eye, corners.mean(0)) for eye in eyes])
        images = [photo(front, corners, viewmat) for viewmat in viewmats]
        states.append(StateViews(
            np.stack(images), np.full((9, SIZE, SIZE), 255, np.uint8), np.repeat(K[None], 9, 0),
            viewmats, None, tuple(map(str, range(9))), np.zeros(9, bool)))
    return tuple(states)


def looking(eye, at):
    ahead = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    viewmat = np.eye(4)
    viewmat[:3, :3] = [right, np.cross(ahead, right), ahead]
    viewmat[:3, 3] = -viewmat[:3, :3] @ eye
    return viewmat


def photo(front, corners, viewmat):
    pixels = (corners @ viewmat[:3, :3].T + viewmat[:3, 3]) @ K.T
    square = np.array([[0, 0], [SIDE, 0], [SIDE, ROWS], [0, ROWS]], np.float32)
    warp = cv2.getPerspectiveTransform(square, (pixels[:, :2] / pixels[:, 2:]).astype(np.float32))
    gray = cv2.warpPerspective(front, warp, (SIZE, SIZE), flags=cv2.INTER_AREA)
    return np.repeat(gray[..., None], 3, 2)


def units(lines, handles, joint=SLIDE):
    moves = np.eye(4), SLIDE.transform(SLIDE.value)
    return units_of(to_mesh(box(LOW, HIGH)), joint, photographed(painted(lines, handles)), moves)


def heights(found):
    """Return the cuts as shares of the height, from the top."""
    z = np.linspace(HIGH[2], LOW[2], 601)
    line = np.stack([np.full(601, HIGH[0]), np.zeros(601), z], 1)
    return np.flatnonzero(np.diff(found.of(line))) / 600


def test_two_alike_with_a_line_between_are_two():
    found = units([(0.5, 1.0)], [0.2, 0.7])
    assert found.alike
    assert heights(found) == pytest.approx([0.5], abs=0.01)


def test_a_gap_that_photos_show_here_and_there_is_one_where_the_others_are_whole():
    found = units([(0.25, 0.45), (0.5, 1.0), (0.75, 1.0)], [0.08, 0.33, 0.58, 0.83])
    assert found.alike
    assert heights(found) == pytest.approx([0.25, 0.5, 0.75], abs=0.01)


@pytest.mark.parametrize("handles", [[0.2], [], [0.05, 0.9]])
def test_a_line_between_what_is_not_alike_or_plain_parts_nothing(handles):
    found = units([(0.5, 1.0)], handles)
    assert not found.alike
    assert len(found.cuts) == 1


def test_a_panels_line_a_rim_and_the_border_of_two_tones_are_no_lines_between():
    assert units([(0.5, 0.8)], [0.2, 0.7]) is None
    assert units([(0.04, 1.0), (0.96, 1.0)], [0.2, 0.7]) is None
    front = painted([], [0.2, 0.7])
    front[ROWS // 2 :] += 40
    moves = np.eye(4), SLIDE.transform(SLIDE.value)
    assert units_of(to_mesh(box(LOW, HIGH)), SLIDE, photographed(front), moves) is None


def test_what_turns_has_no_front():
    assert units([(0.5, 1.0)], [0.2, 0.7], replace(SLIDE, kind="revolute")) is None


@pytest.mark.parametrize(("handles", "parts"), [([0.2, 0.7], 2), ([0.2], 1)])
def test_one_body_of_two_alike_becomes_two_parts_and_a_line_alone_a_note(handles, parts):
    states = photographed(painted([(0.5, 1.0)], handles))
    scene = Scene(Path("toy"), "toy", states)
    clouds = [Gaussians(np.float32([[x + 0.25 * s, 0, z] for x in (-0.2, 0.1) for z in (0.1, 0.5)]),
                        np.tile(np.float32([1, 0, 0, 0]), (4, 1)), np.zeros((4, 3), np.float32),
                        np.full(4, 4.0, np.float32), np.zeros((4, 3), np.float32),
                        np.zeros((4, 0, 3), np.float32)) for s in (0, 1)]
    probs = np.tile(np.float32([0, 1]), (4, 1))
    motion = Motion((probs, probs), (SLIDE,), (0,))
    base, part = toy_cabinet_twin(1).parts
    twin = base, replace(part, mesh=to_mesh(box(LOW, HIGH)))
    more = parted(scene, (clouds[0], clouds[1]), motion, twin)
    assert len(more.joints) == parts
    if parts == 2:
        for state in (0, 1):
            lower, _, other, _ = more.labels(state)
            assert more.labels(state).tolist() == [lower, 3 - lower, lower, 3 - lower]
            assert other == lower
    note, = more.notes
    assert ("moved alike" if parts == 2 else "divide the front of part_1 into 2") in note
    alone, = parted(scene, (clouds[0], clouds[1]), motion, twin, 1).notes
    assert "into 2" in alone  # no more were asked for


@pytest.mark.parametrize(("high", "front"), [((0.1, 0.2, 0.6), True), ((0.1, -0.1, 0.6), True),
                                             ((0.1, -0.15, 0.6), False)])
def test_a_wall_has_no_front(high, front):
    assert broad_front(to_mesh(box(tuple(LOW), high)), SLIDE) is front


def test_what_is_open_all_through_has_no_front():
    tube = box(tuple(LOW), tuple(HIGH)) - box((-0.4, -0.18, 0.02), (0.2, 0.18, 0.58))
    assert not broad_front(to_mesh(tube), SLIDE)
    closed = tube + box((0.08, -0.2, 0.0), (0.1, 0.2, 0.6))  # at one end
    assert broad_front(to_mesh(closed), SLIDE)
