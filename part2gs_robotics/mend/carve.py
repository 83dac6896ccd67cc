"""Carve: take from one of two parts what overlaps at the poses of some evidence."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.mend.evidence import GRAZE, Evidence, copies
from part2gs_robotics.mesh.make_room import tidied
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import part_transforms
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.model.solids import size_of, to_manifold, to_mesh
from part2gs_robotics.model.twin import PartMesh, Twin
from part2gs_robotics.sim_checks.geometry import place

if TYPE_CHECKING:
    from manifold3d import Manifold

logger = logging.getLogger(__name__)
ROOM = 2.5e-4  # of the size, kept free round what is taken: an eighth of what a check allows
MOST = 0.03  # of its volume that a part may lose in a round; more is a real crossing
FULL = 0.5  # of its hull that a bit fills: then the hull is taken, in a tenth of the time
VOXEL = 1 / 256  # of the size: the finest grid that a part comes from; sets what counts as a bit


def carved(twin: Twin, evidence: Sequence[Evidence]) -> Twin:
    """Return the twin without the overlaps; a part that would lose too much stays as it is.

    The base yields to what moves, of two that move the larger one. A texture goes with the faces
    it was made for, colours of corners stay.
    """
    size = size_of(tuple(part.mesh for part in twin.parts))
    solids, seen = [to_manifold(part.mesh) for part in twin.parts], copies(twin)
    rest = list(solids)
    # Deepest first, each from what is left: overlaps of poses close by share most of their faces,
    # and to unite dozens of them takes minutes and gigabytes.
    for found in sorted(evidence, key=lambda one: -one.depth):
        a, b = found.pair
        larger = a if not a or solids[b].volume() <= solids[a].volume() else b
        rest[larger] = _less(rest[larger], seen[a + b - larger],
                             _pose_in(twin, found, larger), size)
    parts = list(twin.parts)
    for index, left in enumerate(rest):
        cut = tidied(solids[index], left, index, VOXEL * size)
        lost = 1.0 - cut.volume() / solids[index].volume()
        logger.debug("%s: what overlaps is %.2g of its volume", parts[index].name, lost)
        if lost <= MOST and cut is not solids[index]:
            parts[index] = replace(parts[index], mesh=_recoloured(parts[index].mesh, cut))
    return replace(twin, parts=tuple(parts))


def _pose_in(twin: Twin, found: Evidence, larger: int) -> F64:
    """Return [4, 4] where the smaller of two parts stands as the larger one sees it."""
    poses = part_transforms(twin, found.positions)
    return np.asarray(inverse(poses[larger]) @ poses[sum(found.pair) - larger])


def _less(solid: Manifold, other: Manifold, pose: F64, size: float) -> Manifold:
    """Return a solid without what another takes of it there, and room round that."""
    import manifold3d

    bits = (solid ^ place(other, pose)).decompose()
    grown = [_grown(bit, ROOM * size) for bit in bits if depth(bit) > GRAZE * size]
    if not grown:
        return solid  # itself, or a part that nothing overlaps would lose its texture
    return solid - manifold3d.Manifold.batch_boolean(grown, manifold3d.OpType.Add)


def _grown(bit: Manifold, room: float) -> Manifold:
    """Return a solid with room all round: itself and a box swept over it."""
    import manifold3d

    box = manifold3d.Manifold.cube([2 * room] * 3, True)
    hull, coarse = bit.hull(), bit.simplify(0.5 * room)
    full = bit.volume() > FULL * hull.volume()
    grown = (hull if full else bit if coarse.is_empty() else coarse).minkowski_sum(box)
    return grown if grown.volume() > bit.volume() else bit


def _recoloured(before: PartMesh, cut: Manifold) -> PartMesh:
    from scipy.spatial import cKDTree

    made = to_mesh(cut)
    nearest = cKDTree(before.vertices).query(made.vertices)[1]
    return replace(made, colors=np.ascontiguousarray(before.colors[nearest]),
                   synthesised=before.synthesised)
