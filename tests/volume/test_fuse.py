import numpy as np
import pytest
from seen_boxes import HI, LO, VOXEL, box_distance, grid_around, part_maps

from part2gs_robotics.model.se3 import screw_motion
from part2gs_robotics.volume.fuse import TRUNCATION, fuse
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.part_solids import cavity, moving_solid, within_hull


def face_error(fused, exact) -> float:
    """Return the 95th percentile of the error beside the faces, edges left out.

    Beside an edge the views of the other face see further, which moves no zero crossing.
    """
    points = fused.grid.centers(np.stack(np.indices(fused.grid.shape), -1))
    within = ((points > LO + 4 * VOXEL) & (points < HI - 4 * VOXEL)).sum(-1) == 2
    near = within & (np.abs(exact) < VOXEL)
    assert near.sum() > 500
    return float(np.percentile(np.abs(fused.distance - exact)[near], 95))


@pytest.fixture(scope="module")
def one_box() -> PartMaps:
    return part_maps([(LO, HI, 1, None)])


def test_distance_of_a_box_is_right_near_its_faces(one_box):
    grid = grid_around(LO, HI)
    fused = fuse(grid, 1, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    exact = box_distance(grid, LO, HI)
    assert face_error(fused, exact) < 0.35 * VOXEL
    assert (fused.distance[exact < -4 * VOXEL] < 0).all()
    assert (fused.weight[exact > 5 * VOXEL] == 0).all()
    assert (fused.enclosed[exact > 5 * VOXEL] == 1).all()


def test_volume_of_a_box_is_its_closed_form(one_box):
    fused = fuse(grid_around(LO, HI), 1, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    assert moving_solid(fused).volume == pytest.approx((HI - LO).prod(), rel=0.03)


def test_evidence_holds_one_number_per_voxel_and_field(one_box):
    fused = fuse(grid_around(LO, HI), 1, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    arrays = [value for value in vars(fused).values() if isinstance(value, np.ndarray)]
    held = [array if array.base is None else array.base for array in arrays]
    assert sum(one.nbytes for one in held) == len(arrays) * fused.distance.nbytes


def test_a_window_of_the_grid_sees_what_the_grid_sees(one_box):
    grid = grid_around(LO, HI)
    window = grid.window(LO + 0.03, HI + 0.01)  # other block borders
    whole = fuse(grid, 1, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    part = fuse(window, 1, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    cut = whole.distance[grid.slices(window)]
    near = np.abs(cut) < VOXEL
    np.testing.assert_allclose(part.distance[near], cut[near], atol=0.25 * VOXEL)
    assert ((part.distance > 0) == (cut > 0)).mean() > 0.995
    np.testing.assert_allclose(window.lo, grid.lo + VOXEL * np.rint((window.lo - grid.lo) / VOXEL))


def test_a_moved_part_fuses_in_its_own_frame(one_box):
    move = screw_motion(np.array([0, 0.6, 0.8]), np.array([0.1, 0, 0]), 0.5, 0.05)
    grid = grid_around(LO, HI)
    moved = part_maps([(LO, HI, 1, move)])
    fused = fuse(grid, 1, [(one_box, np.eye(4)), (moved, move)], TRUNCATION * VOXEL)
    exact = box_distance(grid, LO, HI)
    assert face_error(fused, exact) < 0.35 * VOXEL


def test_another_part_bounds_but_never_fills():
    other_hi = np.array([LO[0], HI[1], HI[2]])
    other_lo = np.array([LO[0] - 0.2, LO[1], LO[2]])
    maps = part_maps([(LO, HI, 1, None), (other_lo, other_hi, 2, None)])
    fused = fuse(grid_around(other_lo, HI), 1, [(maps, np.eye(4))], TRUNCATION * VOXEL)
    solid = moving_solid(fused)
    inside_other = box_distance(fused.grid, other_lo, other_hi) > 2 * VOXEL
    assert not (solid.values[inside_other] > 0).any()
    assert solid.volume == pytest.approx((HI - LO).prod(), rel=0.05)


def test_a_thin_plate_keeps_the_least_thickness():
    lo, hi = np.array([-0.2, -0.15, -0.002]), np.array([0.2, 0.15, 0.002])  # a third of a voxel
    fused = fuse(grid_around(lo, hi), 1, [(part_maps([(lo, hi, 1, None)]), np.eye(4))],
                 TRUNCATION * VOXEL)
    solid = moving_solid(fused)
    columns = (solid.values > 0).sum(2)
    i, j = np.indices(columns.shape)
    x, y = (fused.grid.lo[a] + VOXEL * n for a, n in ((0, i), (1, j)))
    core = (np.abs(x) < 0.17) & (np.abs(y) < 0.12)
    assert (columns[core] >= 1).mean() > 0.98
    assert columns.max() <= 5


def test_the_room_in_a_tray_is_its_cavity():
    t = 0.04
    floor = (LO, np.array([HI[0], HI[1], LO[2] + t]), 1, None)
    walls = [(LO, np.array([LO[0] + t, HI[1], HI[2]]), 1, None),
             (np.array([HI[0] - t, LO[1], LO[2]]), HI, 1, None),
             (LO, np.array([HI[0], LO[1] + t, HI[2]]), 1, None),
             (np.array([LO[0], HI[1] - t, LO[2]]), HI, 1, None)]
    maps = part_maps([floor, *walls])
    fused = fuse(grid_around(LO, HI), 1, [(maps, np.eye(4))], TRUNCATION * VOXEL)
    solid = moving_solid(fused)
    room_lo, room_hi = LO + t, np.array([HI[0] - t, HI[1] - t, HI[2]])
    exact = box_distance(fused.grid, room_lo, room_hi)
    room = cavity(solid, fused)
    assert room[exact > 4 * VOXEL].mean() > 0.9
    assert not room[exact < -VOXEL].any()
    assert solid.volume == pytest.approx((HI - LO).prod() - (room_hi - room_lo).prod(), rel=0.08)


def test_nothing_is_inside_the_hull_of_a_speck(one_box):
    fused = fuse(grid_around(LO, HI), 7, [(one_box, np.eye(4))], TRUNCATION * VOXEL)
    solid = moving_solid(fused)
    assert solid.volume == 0
    assert not within_hull(solid, np.ones(fused.grid.shape, bool)).any()
