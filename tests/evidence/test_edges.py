"""Edges: families of parallel edges are found in many photos, and only where there are some."""

from __future__ import annotations

import numpy as np
import pytest
from toys import angle, pictures

from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.segments import Segments, segments_of
from part2gs_robotics.model import se3

TURN = se3.rotation_from_rotvec(np.array([0.3, -0.5, 0.9]))


def lines_along(direction, count, rng):
    start = rng.uniform(-0.5, 0.2, (count, 3))
    return np.stack([start, start + 0.4 * direction], 1)


@pytest.fixture(scope="module")
def eyes(toy):
    return toy.cameras(20, 200, np.zeros(3), 1.0)


def test_three_families_are_told_to_a_hundredth_of_a_degree(eyes):
    """Among as many lines in any direction."""
    rng = np.random.default_rng(0)
    lines = np.concatenate([lines_along(TURN[:, k], 4, rng) for k in range(3)])
    ways = rng.normal(size=(12, 3))
    astray = [lines_along(w / np.linalg.norm(w), 1, rng) for w in ways]
    bundle = bundled([pictures(np.concatenate([lines, *astray]), *eyes, rng),
                      pictures(lines, *eyes, rng)])
    found = edge_families(bundle, rng)[:3]  # those with most segments come first
    assert sorted(int(np.abs(TURN.T @ d).argmax()) for d, _ in found) == [0, 1, 2]
    for direction, error in found:
        gap = min(angle(direction, TURN[:, k]) for k in range(3))
        assert gap < np.deg2rad(0.02)
        assert gap < 3 * np.sqrt(np.trace(error)) < np.deg2rad(0.2)
        assert direction @ error @ direction == pytest.approx(0.0, abs=1e-12)


def test_the_frame_does_not_matter(eyes):
    """Cameras and object turned together: directions turn with them."""
    rng = np.random.default_rng(1)
    seen = pictures(lines_along(np.array([1.0, 0, 0]), 6, rng), *eyes, rng)
    turned = eyes[1] @ se3.inverse(se3.make(TURN, np.zeros(3)))
    there = Segments(seen.ends, seen.views, seen.Ks, turned)
    (one, _), = edge_families(bundled([seen]), np.random.default_rng(5))
    (two, _), = edge_families(bundled([there]), np.random.default_rng(5))
    assert angle(two, TURN @ one) < 1e-5


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
    assert edge_families(bundled(astray), rng) == []


def test_a_scene_without_segments_has_no_family(eyes):
    nothing = Segments(np.zeros((0, 2, 2)), np.zeros(0, np.int64), *eyes)
    assert edge_families(bundled([nothing, nothing]), np.random.default_rng(0)) == []


def test_photos_of_a_turned_box_tell_its_edges(toy):
    move = se3.make(TURN, np.zeros(3))
    box = toy.Box((-0.3, -0.25, -0.2), (0.3, 0.25, 0.2), 1, move)
    state = toy.photographed([box], *toy.cameras(16, 160, np.zeros(3), 0.9), 160)
    found = edge_families(bundled([segments_of(state)]), np.random.default_rng(3))
    assert sorted(int(np.abs(TURN.T @ d).argmax()) for d, _ in found) == [0, 1, 2]
    for direction, _ in found:
        assert min(angle(direction, TURN[:, k]) for k in range(3)) < np.deg2rad(0.05)
