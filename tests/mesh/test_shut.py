"""Shut: a door that stands ajar may close until it lies flat, through what nobody saw."""

import numpy as np
import pytest
from ajar_room import AJAR, OPEN, VOXEL, ajar, blind, cabinet, hinge, looking, overlap_at, place
from manifold3d import Manifold

from part2gs_robotics.mesh.shut import shut
from part2gs_robotics.model.joint import Joint


def test_a_lump_that_nobody_saw_yields_until_the_door_is_shut() -> None:
    base, shut_door = cabinet(0.04)
    door = ajar(shut_door)
    cut, same = shut([base, door], [[base], [door]], place(hinge()), blind(), VOXEL)
    assert same is door
    assert overlap_at(base, door, 7.0) > 1e-4
    assert max(overlap_at(cut, door, way) for way in np.linspace(0, 7.9, 9)) < 1e-9
    assert overlap_at(cut, door, 10.0) > 1e-3  # the frame is where it was
    assert cut.volume() > 0.98 * base.volume()


def test_a_lump_that_photos_saw_stops_the_door() -> None:
    base, shut_door = cabinet(0.1)
    door = ajar(shut_door)
    cut, _ = shut([base, door], [[base], [door]], place(hinge()), looking(base), VOXEL)
    assert cut is base


def test_a_wall_that_stands_out_no_farther_than_rooms_without_texture_do_yields() -> None:
    base, shut_door = cabinet(0.07)
    door = ajar(shut_door)
    cut, _ = shut([base, door], [[base], [door]], place(hinge()), looking(base), VOXEL)
    assert max(overlap_at(cut, door, way) for way in np.linspace(0, 7.9, 9)) < 1e-9


def test_a_fin_before_the_background_stays_though_the_door_would_take_it_off() -> None:
    base, shut_door = cabinet(0.0)
    base = base + Manifold.cube([0.2, 0.05, 0.3], True).translate([0.58, -0.52, 0])
    door = ajar(shut_door + Manifold.cube([0.3, 0.04, 1], True).translate([0.6, -0.521, 0]))
    for maps, stays in ((looking(base), True), (blind(), False)):
        cut, _ = shut([base, door], [[base], [door]], place(hinge()), maps, VOXEL)
        assert (cut is base) == stays


def test_what_photos_saw_of_the_door_beside_a_lump_is_no_lump() -> None:
    base, shut_door = cabinet(0.1)
    door = ajar(shut_door)
    cut, _ = shut([base, door], [[base], [door]], place(hinge()), looking(base, 1), VOXEL)
    assert cut.volume() < base.volume()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_which_way_the_joint_counts_does_not_matter(sign: float) -> None:
    base, shut_door = cabinet(0.04)
    door = ajar(shut_door)
    joint = Joint("revolute", sign * hinge().axis, hinge().origin, sign * OPEN)
    cut, _ = shut([base, door], [[base], [door]], place(joint), blind(), VOXEL)
    assert cut.volume() < base.volume()


def test_a_door_that_is_photographed_wide_open_first_shuts_before_its_state_1() -> None:
    base, shut_door = cabinet(0.04)
    wide = shut_door.transform(hinge().transform(OPEN)[:3])
    joint = hinge(AJAR - OPEN)
    cut, _ = shut([base, wide], [[base], [wide]], place(joint), blind(), VOXEL)
    at = wide.transform(joint.transform(np.deg2rad(1.0) - OPEN)[:3])
    assert (base ^ at).volume() > 1e-4 > 1e-8 > (cut ^ at).volume()


def test_faces_along_each_other_in_the_air_are_no_stop() -> None:
    """Open by 90 degrees the door is parallel to the side wall, and meets nothing there."""
    base, shut_door = cabinet(0.0)
    start = np.deg2rad(60.0)
    door = shut_door.transform(hinge().transform(start)[:3])
    cut, _ = shut([base, door], [[base], [door]], place(hinge(np.deg2rad(-5.0))), blind(), VOXEL)
    assert cut is base
