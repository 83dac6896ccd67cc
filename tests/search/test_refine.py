"""Refinement pulls a perturbed motion back, in any world frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.landing import build_landing
from part2gs_robotics.evidence.study import distances
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.refine import STEPS, joint_move, matches, refine

TAUS = (0.05, 0.03, 0.02)


def own_of(world):
    """Surfels of the moving box in both states, off its border with the base."""
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    move = truth_of(world).move
    sets = []
    for state, back in ((0, np.eye(4)), (1, se3.inverse(move))):
        s = world.states[state].surfels
        points = se3.apply(back, s.points)
        sets.append(s.select(((points > lo - 0.005) & (points < hi + 0.005)).all(1)))
    return sets[0], sets[1]


def truth_of(world):
    if hasattr(world, "pitch"):
        return Joint("screw", world.axis, world.origin, world.value, world.pitch)
    if hasattr(world, "origin"):
        return Joint("revolute", world.axis, world.origin, world.value)
    return Joint("prismatic", world.axis, np.array([0.2, 0.3, 0.4]), world.value)


def lands_of(world):
    return world.states[0].land, world.states[1].land


def error_of(found, truth, points):
    """Largest distance between where two motions carry the part."""
    return np.linalg.norm(se3.apply(found.move, points) - se3.apply(truth.move, points),
                          axis=1).max()


def across_faces(found, truth, own):
    """Median distance, across the faces, between where two motions carry the part."""
    gap = se3.apply(found.move, own.points) - se3.apply(truth.move, own.points)
    return np.median(np.abs((gap * (own.normals @ truth.move[:3, :3].T)).sum(1)))


def perturbed_of(truth):
    axis = truth.axis + np.array([0.04, -0.03, 0.05])
    return Joint(truth.kind, axis / np.linalg.norm(axis),
                 truth.origin + np.array([0.01, 0.012, 0.0]), truth.value * 1.05,
                 truth.pitch * 0.8)


@pytest.mark.parametrize("name", ["slid", "turned", "screwed"])
def test_a_perturbed_motion_comes_back(name, request):
    world = request.getfixturevalue(name)
    truth, own = truth_of(world), own_of(world)
    start = perturbed_of(truth)
    found = refine(start, own, lands_of(world), TAUS, 4)
    assert error_of(start, truth, own[0].points) > 0.02
    assert across_faces(found, truth, own[0]) < 0.002  # a tenth of a voxel
    assert error_of(found, truth, own[0].points) < 0.02  # along faces the voxel is the limit
    assert np.degrees(np.arccos(min(1.0, found.axis @ truth.axis))) < 0.7
    assert np.linalg.norm(found.axis) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["slid", "turned", "screwed"])
def test_a_held_axis_stays_and_the_rest_is_found(name, request):
    world = request.getfixturevalue(name)
    truth, own = truth_of(world), own_of(world)
    start = replace(perturbed_of(truth), axis=truth.axis, held=True)
    found = refine(start, own, lands_of(world), TAUS, 4)
    assert found.axis is truth.axis
    assert found.held
    assert across_faces(found, truth, own[0]) < 0.002
    askew = replace(start, axis=perturbed_of(truth).axis)
    assert refine(askew, own, lands_of(world), TAUS, 4).axis is askew.axis  # right or wrong


@pytest.mark.parametrize("name", ["slid", "turned", "screwed"])
def test_as_many_steps_as_are_taken_suffice(name, request):
    """Twice as many change nothing across faces; along them a part slips by less than a voxel."""
    world = request.getfixturevalue(name)
    own, start = own_of(world), perturbed_of(truth_of(world))
    found, more = (refine(start, own, lands_of(world), distances(0.03), steps)
                   for steps in (STEPS, 2 * STEPS))
    assert error_of(start, found, own[0].points) > 0.02
    gap = se3.apply(found.move, own[0].points) - se3.apply(more.move, own[0].points)
    across = (gap * (own[0].normals @ more.move[:3, :3].T)).sum(1)
    assert np.median(np.abs(across)) < 5e-4  # a fortieth of a voxel
    assert error_of(found, more, own[0].points) < 0.02


def test_refinement_follows_a_rigid_motion_of_the_world(turned):
    """Only the voxel grid is not moved along, so results agree to a fraction of its cell."""
    world_move = se3.screw_motion(np.array([0.6, 0, 0.8]), np.array([0.1, 0.2, 0.3]), 0.7, 0.4)

    def carried(s: Surfels) -> Surfels:
        return replace(s, points=se3.apply(world_move, s.points),
                       normals=s.normals @ world_move[:3, :3].T)

    lands = []
    for seen in turned.states:
        maps = DepthMaps(seen.maps.depths, seen.maps.alphas, seen.maps.Ks,
                         seen.maps.viewmats @ se3.inverse(world_move))
        s = carried(seen.surfels)
        box = s.points.min(0) - 0.1, s.points.max(0) + 0.1
        lands.append(build_landing(s, np.zeros(len(s)), maps, box, 0.02, 0.1))
    own, start = own_of(turned), perturbed_of(truth_of(turned))
    here = refine(start, own, lands_of(turned), TAUS, 4)
    moved = Joint("revolute", world_move[:3, :3] @ start.axis, se3.apply(world_move, start.origin),
                       start.value)
    there = refine(moved, (carried(own[0]), carried(own[1])), (lands[0], lands[1]), TAUS, 4)
    back = se3.inverse(world_move) @ there.move @ world_move
    gap = se3.apply(back, own[0].points) - se3.apply(here.move, own[0].points)
    assert np.abs(gap).max() < 0.003
    assert there.value == pytest.approx(here.value, abs=2e-3)


def test_without_matches_the_guess_stays(slid):
    guess = Joint("prismatic", np.array([0.0, 0, 1]), np.zeros(3), 0.9)  # up into free space
    found = refine(guess, own_of(slid), lands_of(slid), TAUS, 4)
    assert np.allclose(found.move, guess.move)


def test_the_length_of_the_axis_does_not_matter():
    params = np.array([0.1, 0.2, 0.9, 1.0, 2.0, 3.0, 0.4])
    longer = params * np.array([3, 3, 3, 1, 1, 1, 1])
    for kind in ("prismatic", "revolute"):
        assert np.allclose(joint_move(kind, params), joint_move(kind, longer), atol=1e-14)


def test_matched_pairs_meet_under_the_true_motion(slid):
    zero, zero_n, one, one_n = matches(truth_of(slid).move, own_of(slid), lands_of(slid), 0.02)
    assert len(zero) > 500
    assert np.abs(((zero + slid.axis * slid.value - one) * one_n).sum(1)).max() < 0.02  # tau
    assert (zero_n * one_n).sum(1).min() >= 0.5
