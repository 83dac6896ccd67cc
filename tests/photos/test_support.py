"""The plane below the object is found, not its lid, not the floor, in any frame and unit."""

from __future__ import annotations

import numpy as np
import photo_room as room
import pytest
from scipy.spatial.transform import Rotation

from part2gs_robotics.errors import SceneError
from part2gs_robotics.photos.posed import Posed, eyes, focus
from part2gs_robotics.photos.support import find_support


def posed(points: np.ndarray) -> Posed:
    views = room.walk(20, 0), room.walk(20, 1)
    names = tuple(tuple(f"{n}" for n in range(20)) for _ in (0, 1))
    return Posed(room.K, 0.0, names, views, points, np.ones((len(points), 2), bool), 0.0, 0.5)


def cloud(rng: np.random.Generator, table: int = 400, lid: int = 300) -> np.ndarray:
    """Return points of a table, a lid above it, a floor seen beside it, and strays."""
    return np.concatenate([
        np.c_[rng.uniform(-1.1, 1.1, (table, 2)), rng.normal(0, 0.003, table)],
        np.c_[rng.uniform(-0.3, 0.3, (lid, 2)), np.full(lid, 0.4)],
        np.c_[rng.uniform(1.3, 2.5, (200, 2)), np.full(200, -1.2)],
        rng.uniform(-1, 1, (100, 3)) + np.array([0, 0, 1.2])])


def test_the_table_is_the_support_not_the_lid_nor_the_floor():
    found = find_support(posed(cloud(np.random.default_rng(0))))
    up = np.linalg.inv(found.stand_from_world)[:3, 2]
    assert up @ [0, 0, 1] > np.cos(np.deg2rad(0.5))
    assert abs(found.stand_from_world[2, 3]) < 0.01


def test_another_frame_and_unit_give_the_same_answer():
    here = posed(cloud(np.random.default_rng(0)))
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = Rotation.from_rotvec([0.4, 1.1, -2]).as_matrix(), [5, -3, 1]
    a, b = find_support(here), find_support(here.moved(7.0, move))
    assert b.radius == pytest.approx(7 * a.radius, rel=1e-9)
    world = a.stand_from_world @ np.linalg.inv(move) @ np.linalg.inv(b.stand_from_world)
    np.testing.assert_allclose(world[:3, :3], np.eye(3), atol=1e-6)


def test_without_a_plane_the_message_says_what_to_do():
    points = np.random.default_rng(0).normal(0, 0.3, (60, 3))
    with pytest.raises(SceneError, match="textured mat"):
        find_support(posed(points))


def test_cameras_look_at_the_focus():
    middle, radius = focus(room.walk(30, 0))
    np.testing.assert_allclose(middle, [0, 0, 0.18], atol=0.02)
    assert radius == pytest.approx(np.median(np.linalg.norm(
        eyes(room.walk(30, 0)) - middle, axis=1)))
