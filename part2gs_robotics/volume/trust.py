"""Trust: how far a fitted surface is what photos tell, and how far it is carried over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from part2gs_robotics.evidence.depth_maps import DepthMaps, observe
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.volume.part_maps import PartMaps

ON = 2.0  # voxels between a point and a fitted surface that is its own


def trust(points: F64, part: int, states: Sequence[tuple[PartMaps, F64]], voxel: float) -> F64:
    """Return [N] share, 0..1, of the views of a point on a surface whose photos tell its depth.

    Args:
        points: [N, 3] on a part's fitted surface, in its frame at state 0.
        part: its index.
        states: per state, maps and the [4, 4] world_at_state_from_world_at_0 of the part.
        voxel: scene units.
    """
    every, sure = np.zeros(len(points)), np.zeros(len(points))
    for maps, world_from_part in states:
        own = np.where(maps.labels == part, maps.maps.depths, np.float32(0))
        placed = apply(world_from_part, points)
        for counts, depths in ((every, own), (sure, np.where(maps.sure, own, np.float32(0)))):
            one = DepthMaps(depths, maps.maps.alphas, maps.maps.Ks, maps.maps.viewmats)
            counts += observe(placed, one, ON * voxel).surface
    return np.asarray(np.minimum(sure / np.maximum(every, 1.0), 1.0))
