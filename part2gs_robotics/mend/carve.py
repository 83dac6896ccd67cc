"""Carve: take from one of two parts what overlaps at the poses of some evidence."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.mend.evidence import Evidence, copies
from part2gs_robotics.mesh.make_room import without
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
    tools: dict[int, list[Manifold]] = {}
    for found in evidence:
        poses = part_transforms(twin, found.positions)
        placed = [place(seen[i], poses[i]) for i in found.pair]
        yields = found.pair[0]
        if 0 not in found.pair and solids[found.pair[1]].volume() > solids[yields].volume():
            yields = found.pair[1]
        both = place(placed[0] ^ placed[1], inverse(poses[yields]))
        tools.setdefault(yields, []).extend(_grown(bit, ROOM * size) for bit in both.decompose())
    parts = list(twin.parts)
    for index, own in tools.items():
        cut = without(solids[index], own, index, VOXEL * size)
        lost = 1.0 - cut.volume() / solids[index].volume()
        logger.debug("%s: %d bits are %.2g of its volume", parts[index].name, len(own), lost)
        if lost <= MOST and cut is not solids[index]:
            parts[index] = replace(parts[index], mesh=_recoloured(parts[index].mesh, cut))
    return replace(twin, parts=tuple(parts))


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
