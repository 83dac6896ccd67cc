"""A cabinet whose door stands ajar, and photos that saw nothing or its front."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from manifold3d import Manifold

from part2gs_robotics.evidence.depth_maps import DepthMaps
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
    return base + Manifold.cube([0.2, lump, 0.2]).translate([0.25, -0.5 - lump, 0.0]), door


def ajar(door: Manifold) -> Manifold:
    return door.transform(hinge().transform(AJAR)[:3])


def place(joint: Joint) -> Any:
    return SimpleNamespace(count=2, joints=(joint,), parents=(0,),
                           state1_from_0=[np.eye(4), joint.transform(joint.value)])


def blind() -> Any:
    """Return maps of photos that saw nothing at all."""
    one = DepthMaps(np.zeros((1, 8, 8), np.float32), np.zeros((1, 8, 8), np.uint8),
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
