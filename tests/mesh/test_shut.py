"""Shut: a door that stands ajar may close until it lies flat, through what nobody saw."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.mesh.shut import shut
from part2gs_robotics.model.joint import Joint

VOXEL = 0.01
AJAR, OPEN = np.deg2rad(8.0), np.deg2rad(70.0)


def hinge(value: float = OPEN) -> Joint:
    """Return a hinge along z at the left front edge of a cabinet; the door opens outward."""
    return Joint("revolute", np.array([0.0, 0.0, -1.0]), np.array([-0.5, -0.5, 0.0]), value)


def cabinet(lump: float) -> tuple[Manifold, Manifold]:
    """Return a hollow box open to -y, and a shut door before it; a lump stands in its way."""
    room = Manifold.cube([0.9, 1, 0.9], True).translate([0, -0.1, 0])
    base = Manifold.cube([1, 1, 1], True) - room
    door = Manifold.cube([1, 0.04, 1], True).translate([0, -0.521, 0])
    return base + Manifold.cube([0.2, lump, 0.2]).translate([0.3, -0.5 - lump, 0.0]), door


def ajar(door: Manifold) -> Manifold:
    return door.transform(hinge().transform(AJAR)[:3])


def place(joint: Joint) -> Any:
    return SimpleNamespace(count=2, joints=(joint,), parents=(0,))


def blind() -> Any:
    """Return maps of photos that saw nothing at all."""
    one = DepthMaps(np.zeros((1, 8, 8), np.float32), np.full((1, 8, 8), 255, np.uint8),
                    np.array([[[8.0, 0, 4], [0, 8, 4], [0, 0, 1]]]), np.eye(4)[None])
    both = SimpleNamespace(maps=one, labels=np.zeros(one.depths.shape, np.uint8))
    return both, both


def looking(solid: Manifold, label: int = 0) -> Any:
    """Return maps of two photos that look along +y at the front of a solid, of a part."""
    from part2gs_robotics.model.solids import arrays
    from part2gs_robotics.render.mesh_depths import draw_depths

    K = np.repeat(np.array([[[200.0, 0, 100], [0, 200, 100], [0, 0, 1]]]), 2, 0)
    turned = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2.5], [0, 0, 0, 1]])
    viewmats, depths = np.repeat(turned[None], 2, 0), np.full((2, 200, 200), np.inf, np.float32)
    vertices, faces = arrays(solid)
    draw_depths(vertices.astype(np.float32), faces, K, viewmats, 1e-6, depths)
    seen = np.isfinite(depths)
    maps = DepthMaps(np.where(seen, depths, 0).astype(np.float32),
                     (255 * seen).astype(np.uint8), K, viewmats)
    both = SimpleNamespace(maps=maps, labels=np.full(seen.shape, label, np.uint8))
    return both, both


def overlap_at(base: Manifold, door: Manifold, degrees: float) -> float:
    turned = door.transform(hinge().transform(-np.deg2rad(degrees))[:3])
    return float((base ^ turned).volume())


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
    base, shut_door = cabinet(0.04)
    door = ajar(shut_door)
    cut, _ = shut([base, door], [[base], [door]], place(hinge()), looking(base), VOXEL)
    assert cut is base


def test_what_photos_saw_of_the_door_beside_a_lump_is_no_lump() -> None:
    base, shut_door = cabinet(0.04)
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
