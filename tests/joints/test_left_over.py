"""What joints leave over: nothing of true ones, a part's share of the surface where it lacks."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from toys import Box, cameras, drawn, gaussians_of, scene_of

from part2gs_robotics.evidence.canonical import Canonical, canonical
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.joints.left_over import (
    LEAST,
    SHAPE,
    Surface,
    bodies,
    left_over,
    shaped,
    sorted_out,
    surface_under,
)
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import LeftOver, Motion

BASE = Box((0, 0, 0), (1.6, 1, 0.2), 1)
BLOCKS = Box((0.1, 0.1, 0.2), (0.4, 0.4, 0.5), 2), Box((0.1, 0.6, 0.2), (0.4, 0.9, 0.5), 3)
SLIDES = (Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.4),
          Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.8))
SIDE = 96


def seen(boxes: tuple[Box, ...], joints: tuple[Joint, ...], unit: float = 1.0, noise: float = 0.0,
         ) -> tuple[Canonical, Motion]:
    """Return two states of boxes that move, but for the first, and their true motion.

    Args:
        boxes: base first.
        joints: of the others.
        unit: how long one is in the scene.
        noise: of places and colours of the Gaussians, one standard deviation.
    """
    rng = np.random.default_rng(0)
    Ks, views = cameras(20, SIDE, np.array([0.8, 0.5, 0.25]), 1.95)
    fits, probs, states = [], [], []
    for moved in (False, True):
        there = [b if k == 0 or not moved else replace(b, move=joints[k - 1].state1_from_0)
                 for k, b in enumerate(boxes)]
        gaussians, owner = gaussians_of(there, 0.04)
        states.append(drawn(gaussians, Ks, views, SIDE))
        fits.append(shaken(gaussians, rng, noise))
        probs.append(np.eye(len(boxes), dtype=np.float32)[owner])
    fits = [replace(g, means=g.means * np.float32(unit),
                    log_scales=g.log_scales + np.float32(np.log(unit))) for g in fits]
    far = views.copy()
    far[:, :3, 3] *= unit
    states = [replace(s, viewmats=far) for s in states]
    slides = tuple(replace(j, value=j.value * unit) for j in joints)
    both = canonical(scene_of((states[0], states[1])), (fits[0], fits[1]))
    return both, Motion((probs[0], probs[1]), slides, (0,) * len(slides))


def shaken(gaussians: Gaussians, rng: np.random.Generator, noise: float) -> Gaussians:
    """Return Gaussians with noise of places and colours."""
    means = gaussians.means + rng.normal(0, noise, gaussians.means.shape)
    paint = gaussians.sh0 + rng.normal(0, 10 * noise, gaussians.sh0.shape)
    return replace(gaussians, means=means.astype(np.float32), sh0=paint.astype(np.float32))


def lacking(motion: Motion, part: int) -> Motion:
    """Return a motion in which a part is taken for the base."""
    probs = [p.copy() for p in motion.part_probs]
    for p in probs:
        p[:, 0] += p[:, part]
        p[:, part] = 0
    return replace(motion, part_probs=(probs[0], probs[1]))


@pytest.fixture(scope="module")
def two() -> tuple[Canonical, Motion]:
    return seen((BASE, *BLOCKS), SLIDES)


@pytest.fixture(scope="module")
def without_second(two: tuple[Canonical, Motion]) -> LeftOver:
    return left_over(two[0], lacking(two[1], 2))


def test_true_joints_leave_nothing(two: tuple[Canonical, Motion]) -> None:
    left = left_over(*two)
    assert left.complete
    assert left.share < 0.002
    assert left.views == (-1, -1)
    assert not left.marks[0].any()


def test_of_two_alike_blocks_the_one_that_lacks_is_half(without_second: LeftOver) -> None:
    assert not without_second.complete
    assert without_second.share == pytest.approx(0.5, abs=0.05)


def test_marks_lie_where_the_lacking_part_is(two: tuple[Canonical, Motion],
                                             without_second: LeftOver) -> None:
    for state, (view, marks) in enumerate(zip(without_second.views, without_second.marks,
                                              strict=True)):
        photos = two[0].scene.states[state]
        place = np.array([0.25 + 0.8 * state, 0.75, 0.35])
        spot = photos.Ks[view] @ (photos.viewmats[view] @ [*place, 1.0])[:3]
        rows, cols = np.nonzero(marks)
        across = 0.3 * photos.Ks[view, 0, 0] / spot[2]
        gaps = np.stack([cols + 0.5, rows + 0.5], 1) - spot[:2] / spot[2]
        assert np.linalg.norm(gaps.mean(0)) < 0.25 * across
        assert np.abs(gaps).max() < across
        assert len(rows) > 0.5 * across**2


def test_what_turned_is_looked_at_in_the_light_that_the_motion_was_found_in() -> None:
    """Lit from one side, a block that slides is as bright as before, one that turns is not."""
    lit = (0.8, *(7 * [0.0]))  # brighter towards x
    turn = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.8, 0.5, 0]), 1.2)
    for joint, alike in ((SLIDES[0], True), (turn, False)):
        both, motion = seen((BASE, BLOCKS[0]), (joint,))
        even, shaded = (surface_under(both, replace(motion, shades=shades)).errors
                        for shades in (Motion.shades, lit))
        assert np.array_equal(even, shaded, equal_nan=True) == alike
        assert np.nanmean(shaded) >= np.nanmean(even)  # its paint was drawn without any light


def test_noise_alone_is_complete_and_hides_no_part() -> None:
    both, motion = seen((BASE, *BLOCKS), SLIDES, noise=0.012)
    left, less = left_over(both, motion), left_over(both, lacking(motion, 2))
    assert left.complete
    assert not less.complete
    assert less.share == pytest.approx(0.5, abs=0.1)


def test_the_share_has_no_unit(without_second: LeftOver) -> None:
    both, motion = seen((BASE, *BLOCKS), SLIDES, 0.01)
    assert left_over(both, lacking(motion, 2)).share == pytest.approx(without_second.share,
                                                                      abs=0.01)


def test_what_one_state_hides_is_not_charged() -> None:
    """A drawer inside its cabinet in state 0: its walls show in state 1 alone."""
    cabinet = Box((0, 0, 0), (0.7, 1, 0.7), 1)
    drawer = Box((0.1, 0.1, 0.1), (0.705, 0.9, 0.6), 2)
    both, motion = seen((cabinet, drawer), (replace(SLIDES[0], value=0.5),))
    left, less = left_over(both, motion), left_over(both, lacking(motion, 1))
    assert left.share < 0.002
    assert less.share > 0.9


def test_a_joint_that_goes_half_the_way_explains_little(two: tuple[Canonical, Motion]) -> None:
    both, motion = two
    short = (motion.joints[0], replace(motion.joints[1], value=0.4))
    left = left_over(both, replace(motion, joints=short))
    assert not left.complete
    assert 0.2 < left.share < 0.6


@pytest.mark.parametrize(("height", "aside", "own", "near"), [
    (0.9 * SHAPE, 0.0, False, True), (1.1 * SHAPE, 0.0, False, False),
    (0.5 * SHAPE, 0.5 * SHAPE, False, False),  # beside the pane is another thing's place
    (0.5 * SHAPE, 0.5 * SHAPE, True, True), (0.8 * SHAPE, 0.8 * SHAPE, True, False)])
def test_a_pane_explains_what_is_before_and_behind_it_whatever_its_label(
        height: float, aside: float, own: bool, near: bool) -> None:
    """Surfels of state 0 that a slide of 2 takes over the middle of a pane, or past its edge."""
    y, x = np.mgrid[0:21, 0:21].reshape(2, -1) * 0.01
    pane = np.stack([x + 2.0, y, np.zeros_like(x)], 1)
    spots = np.array([[0.2 + aside if aside else 0.1, 0.1, height]])

    def surfels(points: np.ndarray) -> Surfels:
        return Surfels(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)),
                       np.zeros((len(points), 3)), np.full(len(points), 3))

    both = SimpleNamespace(surfel_size=0.01, surfaces=SimpleNamespace(
        surfels=(surfels(spots), surfels(pane)), diag=1.0))
    labels = [np.array([int(own)]), np.ones(len(pane), np.int64)]
    move = np.eye(4)
    move[0, 3] = 2.0
    assert shaped(both, labels, [np.eye(4), move])[0] == near


def test_bodies_are_connected_pieces_of_a_mask() -> None:
    line = np.array([[max(n - 1, 0), min(n + 1, 9)] for n in range(10)], np.int32)
    mask = np.array([1, 1, 1, 0, 0, 1, 1, 0, 1, 1], bool)
    number = bodies(mask, line)
    assert len(set(number[mask])) == 3
    assert len(set(number[:3])) == len(set(number[5:7])) == len(set(number[8:])) == 1


@pytest.mark.parametrize(("error", "bad"), [(0.14, True), (0.012, False)])
def test_what_a_missing_part_hides_of_the_rest_does_not_hide_the_part(error: float, bad: bool,
                                                                      ) -> None:
    agreeing, hidden, lacking_ones = 200, 100, 100  # a third of what agrees looks wrong behind it
    errors = np.repeat([0.01, 0.4, error], [agreeing, hidden, lacking_ones])
    lacks = np.arange(len(errors)) >= agreeing + hidden
    groups = np.arange(len(errors)) // 10 * 10
    surface = Surface(lacks, lacks, ~lacks, np.zeros(len(errors), bool), errors,
                      (groups[:, None] + np.arange(10)).astype(np.int32))
    found, bound = sorted_out(surface)
    np.testing.assert_array_equal(found, lacks & bad)
    assert bound == pytest.approx(LEAST + (0.0 if bad else hidden / (agreeing + hidden)))
