"""Rubs: slivers as thin as surfaces are wrong do not hold a door up, walls do."""

import numpy as np
import pytest
from ajar_room import OPEN, VOXEL, ajar, blind, cabinet, hinge, looking, overlap_at, place
from manifold3d import Manifold

from part2gs_robotics.mesh.rubs import without_rubs

FAR = np.rad2deg(OPEN) + np.linspace(0.0, 80.0, 17)  # degrees beyond where it stands ajar


def scene(block: Manifold) -> tuple[Manifold, Manifold]:
    """Return a cabinet with a block beside it, and its door ajar."""
    base, door = cabinet(0.0)
    return base + block, ajar(door)


def over_the_door(deep: float) -> Manifold:
    """Return a block beside the cabinet under which the door passes, too low by so much."""
    return Manifold.cube([0.3, 0.3, 0.1]).translate([-0.9, -0.9, 0.5 - deep])


def overlaps(base: Manifold, door: Manifold) -> float:
    return max(overlap_at(base, door, -way) for way in FAR)


def test_a_sliver_yields_to_a_door_that_opens_farther_than_it_was_seen() -> None:
    base, door = scene(over_the_door(0.6 * VOXEL))
    cut, same = without_rubs([base, door], [[base], [door]], place(hinge()), blind(), VOXEL)
    assert same is door
    assert overlaps(base, door) > 1e-5
    assert overlaps(cut, door) < 1e-9
    assert base.volume() - cut.volume() < 0.3 * 0.3 * 1.1 * VOXEL  # half a cell of room


def test_what_is_deeper_in_the_way_than_surfaces_are_wrong_stays() -> None:
    base, door = scene(over_the_door(4 * VOXEL))
    cut, _ = without_rubs([base, door], [[base], [door]], place(hinge()), blind(), VOXEL)
    assert cut is base


@pytest.mark.parametrize("seen", [True, False])
def test_a_thin_shelf_stays_if_photos_saw_it(seen: bool) -> None:
    """With coarse cells, no place of it is deeper in the door than surfaces are wrong."""
    shelf = Manifold.cube([0.8, 0.8, 0.8 * VOXEL]).translate([-1.4, -1.4, 0.35])
    post = Manifold.cube([0.3, 0.3, 0.3]).translate([-1.6, -1.6, 0.2])  # or it is a crumb
    base, door = scene(shelf + post)
    maps = looking(base) if seen else blind()
    cut, _ = without_rubs([base, door], [[base], [door]], place(hinge()), maps, 3 * VOXEL)
    assert (overlaps(cut, door) > 1e-6) == seen


def test_a_part_of_no_pieces_or_that_slides_is_left_alone() -> None:
    base, door = scene(over_the_door(0.6 * VOXEL))
    cut, _ = without_rubs([base, door], [[base], []], place(hinge()), blind(), VOXEL)
    assert cut is base
