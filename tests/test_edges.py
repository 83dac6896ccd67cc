"""Edges: families of parallel edges are found in many photos, and only where there are some."""

from __future__ import annotations

import numpy as np
import pytest
from toys import pictures

from part2gs_robotics import se3
from part2gs_robotics.edges import bundled, edge_families
from part2gs_robotics.segments import Segments, segments_of

TURN = se3.rotation_from_rotvec(np.array([0.3, -0.5, 0.9]))


def angle(a, b):
    return float(np.arccos(min(1.0, abs(a @ b))))


def lines_along(direction, count, rng):
    start = rng.uniform(-0.5, 0.2, (count, 3))
    return np.stack([start, start + 0.4 * direction], 1)


@pytest.fixture(scope="module")
def eyes(toy):
    return toy.cameras(20, 200, np.zeros(3), 1.0)


def test_three_families_are_told_to_a_hundredth_of_a_degree(eyes):
    """From seeds half a degree off, among as many lines in any direction."""
    rng = np.random.default_rng(0)
    lines = np.concatenate([lines_along(TURN[:, k], 4, rng) for k in range(3)])
    ways = rng.normal(size=(12, 3))
    astray = [lines_along(w / np.linalg.norm(w), 1, rng) for w in ways]
    bundle = bundled([pictures(np.concatenate([lines, *astray]), *eyes, rng),
                      pictures(lines, *eyes, rng)])
    seeds = (TURN + np.deg2rad(0.3) * rng.normal(size=(3, 3))).T
    found = edge_families(bundle, seeds / np.linalg.norm(seeds, axis=1, keepdims=True))
    assert len(found) == 3
    for direction, error in found:
        gap = min(angle(direction, TURN[:, k]) for k in range(3))
        assert gap < np.deg2rad(0.02)
        assert gap < 3 * np.sqrt(np.trace(error)) < np.deg2rad(0.2)
        assert direction @ error @ direction == pytest.approx(0.0, abs=1e-12)


def test_an_edge_is_sought_where_two_walls_meet(eyes):
    rng = np.random.default_rng(1)
    bundle = bundled([pictures(lines_along(TURN[:, 2], 6, rng), *eyes, rng)])
    (direction, _), = edge_families(bundle, TURN[:, :2].T)
    assert angle(direction, TURN[:, 2]) < np.deg2rad(0.02)


def test_segments_of_no_common_edge_are_no_family(eyes):
    """Other lines in every photo, as reflections and noise make them."""
    rng = np.random.default_rng(2)
    Ks, viewmats = eyes
    astray = []
    for v in range(len(Ks)):
        ways = rng.normal(size=(60, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        lines = np.concatenate([lines_along(w, 1, rng) for w in ways])
        astray.append(pictures(lines, Ks[v:v + 1], viewmats[v:v + 1], rng))
    seeds = rng.normal(size=(20, 3))
    seeds /= np.linalg.norm(seeds, axis=1, keepdims=True)
    assert edge_families(bundled(astray), seeds) == []


def test_a_scene_without_segments_has_no_family(eyes):
    nothing = Segments(np.zeros((0, 2, 2)), np.zeros(0, np.int64), *eyes)
    assert edge_families(bundled([nothing, nothing]), np.eye(3)) == []
    assert edge_families(bundled([nothing]), np.zeros((0, 3))) == []


def test_photos_of_a_turned_box_tell_its_edges(toy):
    """From photos to directions, normals known to a third of a degree."""
    move = se3.make(TURN, np.zeros(3))
    box = toy.Box((-0.3, -0.25, -0.2), (0.3, 0.25, 0.2), 1, move)
    state = toy.photographed([box], *toy.cameras(16, 160, np.zeros(3), 0.9), 160)
    rng = np.random.default_rng(3)
    seeds = (TURN + np.deg2rad(0.2) * rng.normal(size=(3, 3))).T
    found = edge_families(bundled([segments_of(state)]),
                          seeds / np.linalg.norm(seeds, axis=1, keepdims=True))
    assert len(found) == 3
    for direction, _ in found:
        assert min(angle(direction, TURN[:, k]) for k in range(3)) < np.deg2rad(0.05)
