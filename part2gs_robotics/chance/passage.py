"""Which joints of a drawn twin find their way free: exact overlap of true surfaces."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moving_parts, part_transforms, subtree
from part2gs_robotics.model.solids import FLAKE, require_closed, size_of
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks.geometry import lighter, overlap, place
from part2gs_robotics.sim_checks.interpenetration import LIMIT
from part2gs_robotics.sim_checks.subject import SWEEP_TOLERANCE

if TYPE_CHECKING:
    from manifold3d import Manifold

PLACES = 11  # positions of a range: half of the check's, a draw takes a tenth of a second


class Passage:
    """The solids of a twin, made once for all draws.

    Args:
        twin: closed meshes.

    Raises:
        MeshError: a mesh is not closed.
    """

    def __init__(self, twin: Twin) -> None:
        size = size_of(tuple(part.mesh for part in twin.parts))
        self.limit, self.thin = LIMIT * size, FLAKE * size
        self.solids: list[Manifold] = [
            lighter(require_closed(part.mesh, part.name), SWEEP_TOLERANCE * size)[0].as_original()
            for part in twin.parts]

    def ways(self, twin: Twin) -> dict[int, tuple[bool, bool]]:
        """Return per moving part whether its range is free, and its way to state 1.

        The others are at state 0, or, where that is in the way, at state 1: it waits for them.
        """
        out = {}
        moving = moving_parts(twin)
        ends = [joint.value if (joint := twin.parts[i].joint) else 0.0 for i in moving]
        for at, index in enumerate(moving):
            low, high = twin.parts[index].limits
            reach = min(low, 0.0, ends[at]), max(high, 0.0, ends[at])
            places = np.append(np.linspace(*reach, PLACES), ends[at])
            observed = places * (places - ends[at]) <= 0
            found = [self._free(twin, at, places, [0.0] * len(moving))]
            if not found[0].all() and len(moving) > 1:
                found.append(self._free(twin, at, places, ends))
            whole = any(bool(f.all()) for f in found)
            way = any(bool(f[observed].all()) for f in found)
            out[index] = (whole, way)
        return out

    def _free(self, twin: Twin, at: int, places: F64, others: list[float]) -> NDArray[np.bool_]:
        """Return at which positions of a joint what it moves touches nothing else."""
        moved = set(subtree(twin, moving_parts(twin)[at]))
        pairs = [p for p in combinations(range(len(twin.parts)), 2)
                 if (p[0] in moved) != (p[1] in moved)]
        free = np.zeros(len(places), bool)
        for k, q in enumerate(places):
            poses = part_transforms(twin, [*others[:at], float(q), *others[at + 1:]])
            free[k] = not any(self._touch(a, b, poses) for a, b in pairs)
        return free

    def _touch(self, a: int, b: int, poses: list[F64]) -> bool:
        from part2gs_robotics.collision.depth import depth

        one, two = (place(self.solids[i], poses[i]).as_original() for i in (a, b))
        found = overlap(one, two, self.thin)
        return found.solid is not None and depth(found.solid) > self.limit
