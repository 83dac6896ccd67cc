"""Laws of eq. 3 as printed: direction of lambda, invariances, averaged centres."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.se3 import apply, make, rotation_from_rotvec, screw_motion

STEP = 0.02  # spacing of the test surfaces, metres


def gaussians_of(points):
    n = len(points)
    quats = np.tile(np.float32([1, 0, 0, 0]), (n, 1))
    return Gaussians(
        np.float32(points),
        quats,
        np.full((n, 3), -5, np.float32),
        np.zeros(n, np.float32),
        np.zeros((n, 3), np.float32),
        np.zeros((n, 0, 3), np.float32),
    )


def plane(u, v, axis, value):
    a, b = np.meshgrid(np.arange(*u, STEP), np.arange(*v, STEP), indexing="ij")
    return np.insert(np.stack([a.ravel(), b.ravel()], 1), axis, value, axis=1)


def cabinet():
    """Visible faces of a 0.6 x 0.5 x 0.8 carcass without its front (y = 0)."""
    return np.concatenate(
        [
            plane((0, 0.5), (0, 0.8), 0, 0.0),
            plane((0, 0.5), (0, 0.8), 0, 0.6),
            plane((0, 0.6), (0, 0.8), 1, 0.5),
            plane((0, 0.6), (0, 0.5), 2, 0.8),
        ]
    )


def door(angle_deg):
    front = plane((0, 0.6), (0, 0.8), 1, 0.0)
    turn = screw_motion(np.array([0.0, 0.0, 1.0]), np.zeros(3), -np.deg2rad(angle_deg), 0.0)
    return np.concatenate([cabinet(), apply(turn, front)])


def drawer(slide):
    front = plane((0.05, 0.55), (0.3, 0.55), 1, 0.0)
    sides = [plane((0, max(slide, STEP)), (0.3, 0.5), 0, x) for x in (0.06, 0.54)]
    seen = [front] + (sides if slide > 0 else [])  # the box is visible only once pulled out
    rest = plane((0, 0.6), (0, 0.3), 1, 0.0)
    return np.concatenate([cabinet(), rest, np.concatenate(seen) - [0, slide, 0]])


@pytest.fixture(scope="module")
def eq3(load):
    """Return benchmarks/averaged_field.py."""
    return load("averaged_field")


SCENES = [(door, a) for a in (15, 45, 90)] + [(drawer, d) for d in (0.05, 0.15, 0.30)]


@pytest.mark.parametrize(("scene", "amount"), SCENES)
def test_opened_state_gets_the_larger_weight(eq3, scene, amount):
    closed, opened = scene(0.0), scene(amount)
    there, back = eq3.motion_richness(closed, opened), eq3.motion_richness(opened, closed)
    weight = eq3.richness_weight(there, back)
    assert 0.52 < 1.0 - weight < 0.95
    assert eq3.richness_weight(back, there) == pytest.approx(1.0 - weight, abs=1e-12)
    pair = gaussians_of(closed), gaussians_of(opened)
    assert eq3.canonical_field(*pair, num_matches=50).reference_state == 1
    assert eq3.canonical_field(*pair[::-1], num_matches=50).reference_state == 0


def test_richness_follows_rigid_motion_and_scale(eq3):
    closed, opened = door(0), door(60)
    move = make(rotation_from_rotvec(np.array([0.3, -1.0, 0.4])), np.array([3.0, -2.0, 1.0]))
    plain = eq3.motion_richness(closed, opened)
    assert eq3.motion_richness(apply(move, closed), apply(move, opened)) == pytest.approx(plain)
    assert eq3.motion_richness(7 * closed, 7 * opened) == pytest.approx(7 * plain)


def test_richness_of_one_shifted_point_is_its_shift(eq3):
    point = np.array([[0.0, 0.0, 0.0]])
    assert eq3.motion_richness(point, np.array([[3.0, 4.0, 0.0]])) == pytest.approx(5.0)


def test_unobserved_places_do_not_count_as_motion(eq3):
    closed, opened = drawer(0.0), drawer(0.3)
    front_and_base = np.arange(len(opened)) < len(closed)
    assert eq3.motion_richness(opened, closed, front_and_base) < eq3.motion_richness(opened, closed)
    assert eq3.motion_richness(opened, closed, np.zeros(len(opened), bool)) == 0.0


def test_nothing_moved_weighs_both_states_alike(eq3):
    points = gaussians_of(door(0))
    field = eq3.canonical_field(points, points, num_matches=100)
    assert field.richness == (0.0, 0.0)
    assert field.weights == (0.5, 0.5)


def test_both_states_are_kept_by_default(eq3):
    g0, g1 = gaussians_of(door(0)), gaussians_of(door(45))
    field = eq3.canonical_field(g0, g1, num_matches=100)
    assert field.gaussians[0] is g0
    assert field.gaussians[1] is g1


def test_paper_mode_shrinks_a_turned_point_by_the_chord(eq3):
    angle = np.pi / 2
    p0 = np.array([[1.0, 0.0, 0.0], [-5.0, 0.0, 0.0]])
    p1 = np.array([[np.cos(angle), np.sin(angle), 0.0], [-5.0, 0.0, 0.0]])
    field = eq3.canonical_field(gaussians_of(p0), gaussians_of(p1), paper_mode=True)
    lam = field.richness_weight
    assert lam == pytest.approx(0.5)
    radius = np.linalg.norm(field.gaussians[0].means[0])
    assert len(field.gaussians) == 1
    assert radius == pytest.approx(np.sqrt(lam**2 + (1 - lam) ** 2), abs=1e-6)  # cos 90 = 0


def test_paper_mode_interpolates_with_the_printed_weight(eq3):
    rng = np.random.default_rng(0)
    p0 = rng.uniform(size=(60, 3)) * 10
    p1 = p0.copy()
    p1[:5] += [0.01, 0.02, 0.03]
    p1 = np.concatenate([p1, rng.uniform(size=(20, 3)) * 10 + [30, 0, 0]])
    field = eq3.canonical_field(gaussians_of(p0), gaussians_of(p1), paper_mode=True)
    lam, (i, j) = field.richness_weight, field.matches.T
    assert field.reference_state == 1
    expected = lam * np.float32(p0)[i] + (1 - lam) * np.float32(p1)[j]
    np.testing.assert_allclose(field.gaussians[0].means[j], expected, atol=1e-4)
