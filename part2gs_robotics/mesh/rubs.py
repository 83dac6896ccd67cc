"""Rubs: what would hold a door up beyond its states though surfaces are no surer than that.

A part turns on beyond where it was photographed, and a thin sliver of the base is in its way,
mostly beside the hinge: both surfaces are as wrong as half a cell, and seen from afar. At a real
stop the overlap grows with the angle; a rub stays as deep for a quarter of a turn. The base yields
to it, up to where the overlap gets deeper than surfaces are wrong, or a door lies flat on the base,
unless photos saw what stands there.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.mesh.shut import End, flush_ends, let_by, meets
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

logger = logging.getLogger(__name__)
RUB = 1.2  # voxels that an overlap may be deep: rubs of seven hinges had 0.1 to 1.1
STEP = np.deg2rad(5.0)  # between places that are looked at; what is met there is a cell deep
REFINED = 4  # halvings of the step that met more: 0.3 degrees
DEEPER = np.deg2rad(0.5)  # beyond, to see how fast the overlap grows
MOST_BACK = np.deg2rad(4.0)  # of a stop; what grows slower is a rub, which began at no one angle
TOUCH = 0.05  # voxels: an overlap as deep holds a part up
MOST = np.pi  # rad of a whole range: as the exported one


def without_rubs(surfaces: Sequence[Manifold], pieces: Sequence[Sequence[Manifold]], place: Place,
                 maps: Sequence[PartMaps], voxel: float) -> list[Manifold]:
    """Return surfaces whose base lets parts turn on where only rubs hold them up.

    Args:
        surfaces: closed, apart on the observed ways, base first, world frame at state 0.
        pieces: convex, per part: what it is the union of; a part without any stays as it is.
        place: joints, and the part that carries each.
        maps: what photos of both states saw.
        voxel: size of the grid's cells, scene units.
    """
    out, flush = list(surfaces), flush_ends(surfaces, place)
    for k, (joint, parent) in enumerate(zip(place.joints, place.parents, strict=True), 1):
        if joint.kind != "revolute" or parent != 0 or not pieces[k]:
            continue
        for start, sign in ((min(0.0, joint.value), -1.0), (max(0.0, joint.value), 1.0)):
            way, rubs = _way(out[0], out[k], joint, (start, sign), voxel)
            way = min([way, *(abs(end.value - start) for end in flush
                              if (end.part, end.start) == (k, start) and meets(out, joint, end))])
            end = End(k, start + sign * way, start)
            cut = let_by(out, pieces[k], place, maps, end, voxel) if rubs and way > 0 else None
            if cut is None:
                continue
            out[0] = cut
            logger.info("part %d: the base yields to it for %.1f degrees beyond a state, where it "
                        "rubs", k, np.rad2deg(way))
    return out


def _way(base: Manifold, part: Manifold, joint: Joint, ray: tuple[float, float],
         voxel: float) -> tuple[float, bool]:
    """Return how far a part turns along a ray (start, sign), and whether it rubs on its way."""
    limit = max(MOST - abs(joint.value), 0.0)
    base, part = base.as_original(), part.as_original()

    def deep(way: float) -> float:
        both = base ^ part.transform(joint.transform(ray[0] + ray[1] * way)[:3])
        return depth(both) / voxel if both.volume() > 0 else 0.0

    free, rubs = 0.0, False
    while free < limit:
        new = min(free + STEP, limit)
        here = deep(new)
        if here > RUB:
            return _stop(deep, free, new), rubs
        free, rubs = new, rubs or here > TOUCH
    return limit, rubs


def _stop(deep: Callable[[float], float], free: float, met: float) -> float:
    """Return where what is too deep at `met` began, or else is as deep as a rub.

    Faces that meet grow deeper in proportion: the line through two overlaps leads to the touch.
    """
    for _ in range(REFINED):
        middle = 0.5 * (free + met)
        free, met = (free, middle) if deep(middle) > RUB else (middle, met)
    own, growth = deep(free), deep(free + DEEPER) - deep(free)
    back = own * DEEPER / growth if growth > 0 else np.inf
    return max(free - back, 0.0) if back <= MOST_BACK else free
