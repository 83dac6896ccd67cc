"""Wires: thin things that views see become tubes; noise beside walls and loose things do not."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import ndimage
from seen_boxes import HI, LO, VOXEL, box_distance, grid_around, part_maps

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.place import LONG, Place
from part2gs_robotics.volume.wires import _along, with_wires

GRID = grid_around(LO, HI + np.array([0.25, 0, 0]))
SOLID = Solid(GRID, np.clip(box_distance(GRID, LO, HI) / VOXEL, -3, 3).astype(np.float32))
THICK = 0.006  # half of it: a pixel shows 8 mm, a voxel is 12 mm


def bar(start: float, thick: float = THICK) -> tuple[np.ndarray, np.ndarray]:
    """Return the box of a bar along x from a start to 0.4."""
    return np.array([start, -thick, -thick]), np.array([0.4, thick, thick])


def along_x(start: float, y: float = 0.0, z: float = 0.0) -> SimpleNamespace:
    """Return a part's Gaussians on a line along x, each 2 voxels long."""
    x = np.arange(start, 0.4, 2 * VOXEL)
    points = np.stack([x, np.full_like(x, y), np.full_like(x, z)], 1)
    way = np.array([VOXEL, 0, 0])
    return SimpleNamespace(points={1: points}, ends={1: np.stack([points - way, points + way], 1)},
                           state1_from_0={1: np.eye(4)})


def added(place, *boxes) -> np.ndarray:
    """Return which voxels two states of boxes add to the block."""
    maps = part_maps([(LO, HI, 1, None), *boxes])
    return (with_wires(SOLID, 1, place, [maps, maps]).values > 0) & (SOLID.values <= 0)


def test_a_bar_thinner_than_a_voxel_becomes_a_tube_that_the_block_holds():
    new = added(along_x(HI[0]), (*bar(HI[0]), 1, None))
    at = GRID.centers(np.argwhere(new))
    assert np.abs(at[:, 1:]).max() < 2.1 * VOXEL
    whole = np.unique(np.floor((at[:, 0] - HI[0]) / VOXEL))
    assert len(whole) > 0.9 * (0.4 - HI[0]) / VOXEL
    assert ndimage.label(new | (SOLID.values > 0))[1] == 1


@pytest.mark.parametrize(("missing", "whole"), [(2, True), (4, False)])
def test_a_wire_that_lacks_few_gaussians_is_whole_and_one_that_lacks_many_is_not(missing, whole):
    place = along_x(HI[0])
    stays = np.delete(np.arange(len(place.points[1])), 3 + np.arange(missing))
    place.points[1], place.ends[1] = place.points[1][stays], place.ends[1][stays]
    new = added(place, (*bar(HI[0]), 1, None))
    assert ndimage.label(new | (SOLID.values > 0))[1] == 1
    far = GRID.centers(np.argwhere(new))[:, 0].max()
    assert (far > 0.38) == whole


def test_a_tube_ends_where_views_see_nothing():
    place = along_x(HI[0])
    place.ends[1][-4, 1, 0] = 0.48  # a Gaussian that sticks out of the bar
    at = GRID.centers(np.argwhere(added(place, (*bar(HI[0]), 1, None))))
    assert 0.38 < at[:, 0].max() < 0.4 + 2.5 * VOXEL


@pytest.mark.parametrize("why", ["another part's", "nothing there", "thick", "loose", "a plate"])
def test_what_is_not_a_wire_of_the_part_stays_away(why):
    start = HI[0] + (6 * VOXEL if why == "loose" else 0.0)
    box = (*bar(start, 4 * VOXEL if why == "thick" else THICK), 2 if "other" in why else 1, None)
    if why == "a plate":  # thin to views along it, wide to most
        box = (np.array([start, -0.12, -THICK]), np.array([0.4, 0.12, THICK]), 1, None)
    upon = 4 * VOXEL if why == "thick" else 0.0  # on its surface: views do see them
    boxes = [] if why == "nothing there" else [box]
    new = added(along_x(start, 0.11 if why == "a plate" else 0.0, upon), *boxes)
    assert not new.any()


def test_noise_beside_a_wall_is_no_wire():
    """Gaussians two voxels above the block's top: its depth is wrong by as much."""
    assert not added(along_x(-0.15, z=HI[2] + 1.9 * VOXEL)).any()


def test_ends_of_gaussians_move_with_the_part():
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(6, 4)).astype(np.float32)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    scales = np.log(np.tile([0.05, 0.01, 0.02], (6, 1))).astype(np.float32)
    one = Gaussians(rng.normal(size=(6, 3)).astype(np.float32), quats, scales,
                    np.full(6, 3.0, np.float32), np.zeros((6, 3), np.float32),
                    np.zeros((6, 0, 3), np.float32))
    turn = Joint("revolute", np.array([0, 0, 1.0]), np.array([0.2, 0, 0]), 0.7)
    motion = SimpleNamespace(joints=(turn,), parents=(0,), labels=lambda s: np.array([0, 1] * 3))
    place = Place((one, one), motion)
    ends = place.ends[1]
    np.testing.assert_allclose(ends.mean(1), place.points[1], atol=1e-9)
    long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert long == pytest.approx(2 * LONG * (0.05 - 0.02))
    back = apply(inverse(turn.move), ends[:3].reshape(-1, 3)).reshape(3, 2, 3)
    np.testing.assert_allclose(ends[3:], back, atol=1e-6)
    place.keep(1, np.arange(6) < 2)
    assert [len(place.points[1]), len(place.ends[1]), len(place.colors[1])] == [2, 2, 2]


def test_points_along_a_line_are_at_most_a_step_apart():
    ends = np.array([[[0, 0, 0], [1.0, 0, 0]], [[0, 1, 0], [0, 1, 0]], [[0, 0, 0], [0, 0, 0.3]]])
    found = _along(ends, 0.3)
    np.testing.assert_allclose(found[:5, 0], [0, 0.25, 0.5, 0.75, 1.0])
    np.testing.assert_allclose(found[5], [0, 1, 0])
    np.testing.assert_allclose(found[6:, 2], [0, 0.3])
