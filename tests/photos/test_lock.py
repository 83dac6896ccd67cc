"""What stayed locks the states, whatever moved and however much of the picture it fills."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from part2gs_robotics.photos.lock import carried, lock_states, similarity

MIDDLE, RADIUS = np.zeros(3), 2.0


def motion(rng: np.random.Generator, angle: float = 1.0) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(angle * rng.normal(size=3)).as_matrix()
    out[:3, 3] = rng.normal(size=3)
    return out


def scene(rng: np.random.Generator, stayed: int, moved: int, wrong: int):
    """Return points of both states, the truth, and which pairs stayed."""
    room = rng.uniform(-5, 5, (stayed // 2, 3))
    room[:, rng.integers(0, 3)] = 5.0
    table = np.c_[rng.uniform(-1.2, 1.2, (stayed - len(room), 2)), np.zeros(stayed - len(room))]
    door = np.c_[rng.uniform(0, 0.6, moved), np.zeros(moved), rng.uniform(0, 0.4, moved)]
    first = np.concatenate([room, table, door, rng.uniform(-2, 2, (wrong, 3))])
    opened = Rotation.from_euler("z", -1.1).as_matrix()
    second = first.copy()
    second[stayed:stayed + moved] = door @ opened.T
    second[stayed + moved:] = rng.uniform(-2, 2, (wrong, 3))
    first = first + rng.normal(0, 0.002, first.shape)
    scale, world = 0.37, motion(rng)
    back = np.linalg.inv(world)
    second = carried(second, 1.0, back) / scale  # state 1 has a frame and a unit of its own
    return first, second, (scale, world), np.arange(len(first)) < stayed


@pytest.mark.parametrize("seed", range(5))
def test_a_similarity_is_found_from_exact_points(seed):
    rng = np.random.default_rng(seed)
    points, scale, move = rng.normal(size=(8, 3)), rng.uniform(0.1, 9), motion(rng, 3.0)
    found, placed = similarity(carried(points, scale, move), points)
    assert found == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(placed, move, atol=1e-9)


def test_a_mirrored_cloud_gets_a_rotation_all_the_same():
    points = np.random.default_rng(0).normal(size=(9, 3))
    _, move = similarity(points * [1, 1, -1], points)
    assert np.linalg.det(move[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("moved", [0, 200, 600])
def test_a_door_with_more_points_than_all_that_stayed_does_not_pull(moved):
    first, second, (scale, world), stayed = scene(np.random.default_rng(moved), 200, moved, 80)
    lock = lock_states(first, second, MIDDLE, RADIUS)
    assert lock is not None
    assert lock.sure
    assert lock.scale == pytest.approx(scale, rel=2e-3)
    off = carried(second, lock.scale, lock.zero_from_one) - carried(second, scale, world)
    assert np.linalg.norm(off[stayed], axis=1).max() < 0.01
    assert lock.kept[stayed].mean() > 0.95
    assert lock.kept[200:200 + moved].sum() <= 0.2 * moved  # its hinge moves hardly at all


def test_without_what_stayed_the_lock_is_not_sure():
    rng = np.random.default_rng(0)
    first, second, _, _ = scene(rng, 0, 0, 200)
    lock = lock_states(first, second, MIDDLE, RADIUS)
    assert lock is None or not lock.sure


def test_two_motions_that_fill_as_much_of_the_room_are_not_told_apart():
    rng = np.random.default_rng(1)
    half = rng.uniform(-3, 3, (400, 3))
    second = half.copy()
    second[200:] = carried(half[200:], 1.0, motion(rng))
    lock = lock_states(half, second, MIDDLE, RADIUS)
    assert lock is not None
    assert not lock.sure
