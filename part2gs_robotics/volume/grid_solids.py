"""Grid solids: evidence of all parts -> their solids on grids, none in the way of another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from part2gs_robotics.errors import EmptyPartError
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.kinematics import chain, sweep
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.volume.carve import Solid, carve
from part2gs_robotics.volume.fuse import TRUNCATION, Fused, fuse
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.part_solids import (
    MIN_WEIGHT,
    base_solid,
    calm,
    cavity,
    clear_cavity,
    keep_large,
    mended,
    moving_solid,
    without_fins,
    without_voids,
)
from part2gs_robotics.volume.place import Place

MARGIN = TRUNCATION + 2.0  # voxels around a part: its distances fade to the truncation in there
CROSSING = 0.1  # share of a part; two moving parts that overlap more really cross on their ways
STRETCH = 8  # poses of a sweep that are judged together
GRAZE = 0.015  # of a part: two that lie in each other, noisy by a voxel, touch by 1.2 % at most
# Of its volume, a part on the base alone: 0.6 in 46 twins, one 4 deg askew 0.33; a false part 0.22.
ROOM = 0.27
BASE_BONUS = np.float32(0.5)  # a base surface stands still and is seen twice: it wins a tie
STEP = 1.0  # voxels between poses of a sweep: wider steps leave combs in what is carved


def part_evidence(place: Place, maps: list[PartMaps], grid: Grid) -> list[Fused]:
    """Return what both states say about every part, each on its window of the grid."""
    reach, out = MARGIN * grid.voxel, []
    for k in range(place.count):
        lo, hi = place.box(k)
        window = grid.window(lo - reach, hi + reach) if k else grid
        states = [(maps[0], np.eye(4)), (maps[1], place.state1_from_0[k])]
        out.append(fuse(window, k, states, TRUNCATION * grid.voxel))
    return out


def whole_solids(evidence: Sequence[Fused]) -> list[Solid]:
    """Return the noisy solids of all parts, each as if it were alone."""
    return [moving_solid(one) if k else keep_large(base_solid(one), one)
            for k, one in enumerate(evidence)]


def apart_solids(wholes: Sequence[Solid], evidence: list[Fused], place: Place,
                 clearance: float) -> list[Solid]:
    """Return the solids of moving parts out of each other's way, and the base as it was.

    Args:
        wholes: base first, each as if it were alone.
        evidence: per part.
        place: joints, and the part that carries each.
        clearance: voxels between parts.
    """
    solids = list(wholes)
    solids = [_out_of_the_way(solids, evidence, k, place, clearance) if k else solids[0]
              for k in range(place.count)]
    for k in range(1, place.count):
        solids[k] = mended(solids[k], _yield_to_base(solids, evidence, k, place), evidence[k])
        for j in range(1, k):
            solids[k] = _yield_to(solids[k], solids[j], k, j, place, clearance)
        solids[k] = without_voids(keep_large(solids[k]))
    return solids


def require_room(solids: Sequence[Solid], wholes: Sequence[Solid], place: Place) -> None:
    """Raise if a part on the base that carries none has hardly any room on its way.

    The last moving part stays: the checks say what it runs into.

    Args:
        solids: out of each other's way.
        wholes: as if each were alone.
        place: of the parts.

    Raises:
        EmptyPartError: a part has no room.
    """
    free = [solid.volume for solid in solids]
    left = {k: free[k] / max(free[k], wholes[k].volume) for k, parent in enumerate(place.parents, 1)
            if not parent and k not in place.parents}
    worst = min(left, key=lambda k: left[k], default=0)
    if worst and place.count > 2 and left[worst] < ROOM:
        raise EmptyPartError(
            f"part_{worst}: on its way it runs into other parts with all but "
            f"{left[worst]:.0%} of what was seen of it. Needed room for {ROOM:.0%} at least; give "
            "views that show what is in its way, or lower --parts if the part does not exist.",
            worst)


def _out_of_the_way(solids: list[Solid], evidence: list[Fused], part: int, place: Place,
                    clearance: float) -> Solid:
    """Return a moving part without what nobody saw of it and seen surfaces of others pass through.

    Real neighbours do not meet, so where one would, the inside that was filled in is not there.
    """
    solid = solids[part]
    blind = np.where(evidence[part].own > MIN_WEIGHT, np.float32(np.inf), np.float32(0))
    for other in set(range(1, place.count)) - {part}:
        poses = sweep(other, part, place.joints, place.parents, solids[other].corners(),
                      STEP * solid.grid.voxel)
        proof = np.maximum(evidence[other].own - np.float32(MIN_WEIGHT), 0)
        solid = carve(solid, solids[other], poses, clearance, (blind, proof))
    return solid if solid is solids[part] else mended(solids[part], solid, evidence[part])


def _yield_to_base(solids: list[Solid], evidence: list[Fused], part: int,
                   place: Place) -> Solid:
    """Return a moving part without what it would sweep out of better observed base surfaces.

    Both are noisy by about a voxel; where they overlap, the one that more views saw is right.
    """
    solid = solids[part]
    poses = sweep(part, 0, place.joints, place.parents, solid.corners(),
                  STEP * solid.grid.voxel)
    base_from_part = np.asarray(np.linalg.inv(poses), np.float64)
    support = (BASE_BONUS * evidence[part].own, evidence[0].own)
    return carve(solid, solids[0], base_from_part, 0.0, support)


def carved_base(solids: list[Solid], evidence: list[Fused], place: Place,
                clearance: float) -> Solid:
    """Return the base with room for every part and for what it sweeps.

    Args:
        solids: base first, none in the way of another but in the base's.
        evidence: per part.
        place: joints, and the part that carries each.
        clearance: voxels between parts.
    """
    base = solids[0]
    for k in range(1, place.count):
        room = cavity(solids[k], evidence[k])
        for pose in (np.eye(4), inverse(place.state1_from_0[k])):
            base = clear_cavity(base, evidence[0], room, solids[k], pose)
    sweeps = [sweep(k, 0, place.joints, place.parents, solids[k].corners(),
                    STEP * base.grid.voxel)
              for k in range(1, place.count)]
    for last in (False, True):  # between the two, what the first left of the unknown is smoothed
        for k, poses in enumerate(sweeps, 1):
            base = carve(base, solids[k], poses, clearance)
        base = without_fins(base, evidence[0]) if last else calm(base, evidence[0])
    return without_voids(keep_large(base, evidence[0]))


def _yield_to(solid: Solid, rival: Solid, part: int, other: int, place: Place,
              clearance: float) -> Solid:
    """Return a moving part without what an earlier one needs.

    Both observed states must be free of overlap. Along the sweeps a part yields only a little: a
    drawer behind a door really meets it when only one of them is open. Where it does, the part
    yields on the rest of the way.
    """
    values = [j.value for j in place.joints]
    observed = np.stack([
        inverse(chain(other, place.joints, place.parents, q))
        @ chain(part, place.joints, place.parents, q) for q in ([0.0] * len(values), values)])
    out = carve(solid, rival, observed, clearance)
    poses = sweep(other, part, place.joints, place.parents, rival.corners(),
                  STEP * rival.grid.voxel)
    swept = carve(out, rival, poses, clearance)
    if swept.volume >= (1 - CROSSING) * out.volume:
        return swept
    stretches = np.array_split(poses, -(-len(poses) // STRETCH))
    grazing = [p for p in stretches
               if carve(out, rival, p, clearance).volume >= (1 - GRAZE) * out.volume]
    return carve(out, rival, np.concatenate([observed, *grazing]), clearance)
