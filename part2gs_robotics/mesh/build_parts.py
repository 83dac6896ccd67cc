"""Meshing: evidence of two states, part identities and joints -> one closed mesh per part."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import MeshConfig
from part2gs_robotics.errors import EmptyPartError
from part2gs_robotics.evidence.depth_maps import observe
from part2gs_robotics.mesh.carve import Solid, carve
from part2gs_robotics.mesh.flat_parts import flat_surfaces
from part2gs_robotics.mesh.fuse import TRUNCATION, Fused, fuse
from part2gs_robotics.mesh.part_maps import PartMaps, render_part_maps
from part2gs_robotics.mesh.part_solids import (
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
from part2gs_robotics.mesh.place import Place
from part2gs_robotics.mesh.surface import arrays, closed_surface
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.kinematics import chain, sweep
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.twin import Part, PartMesh

if TYPE_CHECKING:
    from manifold3d import Manifold

MARGIN = TRUNCATION + 2.0  # voxels around a part: its distances fade to the truncation in there
CROSSING = 0.1  # share of a part; two moving parts that overlap more really cross on their ways
STRETCH = 8  # poses of a sweep that are judged together
GRAZE = 0.015  # of a part: two that lie in each other, noisy by a voxel, touch by 1.2 % at most
# Of its volume, a part on the base alone: 0.6 in 46 twins, one 4 deg askew 0.33; a false part 0.22.
ROOM = 0.27
BASE_BONUS = np.float32(0.5)  # a base surface stands still and is seen twice: it wins a tie
STEP = 1.0  # voxels between poses of a sweep: wider steps leave combs in what is carved
COLOR_NEIGHBORS = 4  # nearest Gaussians blended into a vertex colour
SEEN = 1.5  # voxels between a vertex and a first surface for the vertex to count as observed


def build_parts(scene: Scene, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                config: MeshConfig) -> tuple[Part, ...]:
    """Build one watertight coloured mesh per part, apart in both states and along the sweeps.

    Args:
        scene: posed images of both states; depth images are used where there are some.
        gaussians: of state 0 and state 1.
        motion: part identities and joints.
        config: grid resolution and clearance.

    Returns:
        Base first, in the world frame at state 0, with convex collision pieces.

    Raises:
        EmptyPartError: a part has no Gaussians or no volume.
        MeshError: a part has no closed surface.
    """
    place = Place(gaussians, motion)
    for k in range(place.count):
        if len(place.points[k]) == 0:
            raise EmptyPartError(
                f"{part_name(k)}: 0 Gaussians carry this part's identity. Needed some in either "
                "state; lower --parts, or give views that show the part.", k)
    maps = [render_part_maps(gaussians[s], motion.part_probs[s], scene.states[s]) for s in (0, 1)]
    maps, place = _inside_masks(maps, place)
    grid = _grid(place, config.resolution)
    solids, wholes = build_solids(place, maps, grid, config.clearance_voxels)
    for k, solid in enumerate(solids):
        if not (solid.values > 0).any():
            raise EmptyPartError(
                f"{part_name(k)}: its volume is 0 on a grid of {max(solid.values.shape)} cells. "
                "Needed surfaces of this part that some view sees; raise --resolution, give more "
                "views, or lower --parts if the part does not exist.", k)
    _require_room(solids, wholes, place)
    surfaces = [closed_surface(s, part_name(k), config.clearance_voxels)
                for k, s in enumerate(solids)]
    if config.flat_walls:
        surfaces = flat_surfaces(surfaces, place, grid)
    surfaces = _apart(surfaces, place, solids)
    return tuple(_part(k, surfaces[k], place, maps, grid.voxel, motion, config.convex)
                 for k in range(place.count))


def part_name(part: int) -> str:
    """Return the file-safe name of a part."""
    return f"part_{part}" if part else "base"


def _inside_masks(maps: list[PartMaps], place: Place) -> tuple[list[PartMaps], Place]:
    """Drop Gaussians that most views see through: floaters would only widen the grid."""
    for k in range(place.count):
        seen = [observe(apply(place.state1_from_0[k], place.points[k]) if s else place.points[k],
                        maps[s].maps, np.inf) for s in (0, 1)]
        fine = (seen[0].outside <= 1) | (seen[1].outside <= 1)
        if fine.any():
            place.points[k], place.colors[k] = place.points[k][fine], place.colors[k][fine]
    return maps, place


def _grid(place: Place, resolution: int) -> Grid:
    """Return the grid around all parts at state 0."""
    boxes = [place.box(k) for k in range(place.count)]
    lo, hi = np.min([b[0] for b in boxes], 0), np.max([b[1] for b in boxes], 0)
    voxel = float((hi - lo).max()) / resolution
    return Grid.around(lo - MARGIN * voxel, hi + MARGIN * voxel, voxel)


def build_solids(place: Place, maps: list[PartMaps], grid: Grid,
                 clearance: float) -> tuple[list[Solid], list[float]]:
    """Return the solids of all parts, none in the way of another, and their volumes before that."""
    eye, reach = np.eye(4), MARGIN * grid.voxel
    evidence: list[Fused] = []
    solids: list[Solid] = []
    for k in range(place.count):
        lo, hi = place.box(k)
        window = grid.window(lo - reach, hi + reach) if k else grid
        states = [(maps[0], eye), (maps[1], place.state1_from_0[k])]
        evidence.append(fuse(window, k, states, TRUNCATION * grid.voxel))
        solids.append(moving_solid(evidence[k]) if k
                      else keep_large(base_solid(evidence[k]), evidence[k]))
    wholes = [solid.volume for solid in solids]
    solids = [_out_of_the_way(solids, evidence, k, place, clearance) if k else solids[0]
              for k in range(place.count)]
    for k in range(1, place.count):
        solids[k] = mended(solids[k], _yield_to_base(solids, evidence, k, place), evidence[k])
        for j in range(1, k):
            solids[k] = _yield_to(solids[k], solids[j], k, j, place, clearance)
        solids[k] = without_voids(keep_large(solids[k]))
    solids[0] = _carve_base(solids, evidence, place, clearance)
    return solids, wholes


def _require_room(solids: list[Solid], wholes: list[float], place: Place) -> None:
    """Raise if a part on the base that carries none has hardly any room on its way.

    The last moving part stays: the checks say what it runs into.
    """
    free = [solid.volume for solid in solids]
    left = {k: free[k] / max(free[k], wholes[k]) for k, parent in enumerate(place.parents, 1)
            if not parent and k not in place.parents}
    worst = min(left, key=lambda k: left[k], default=0)
    if worst and place.count > 2 and left[worst] < ROOM:
        raise EmptyPartError(
            f"{part_name(worst)}: on its way it runs into other parts with all but "
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


def _carve_base(solids: list[Solid], evidence: list[Fused], place: Place,
                clearance: float) -> Solid:
    """Return the base with room for every part and for what it sweeps."""
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


def _apart(surfaces: list[Manifold], place: Place, solids: list[Solid]) -> list[Manifold]:
    """Return the surfaces with any overlap left by simplification cut off exactly."""
    from part2gs_robotics.mesh.surface import flaw

    values = [j.value for j in place.joints]
    for k in range(1, place.count):
        for j in range(k):
            poses = [np.eye(4), inverse(chain(j, place.joints, place.parents, values))
                     @ chain(k, place.joints, place.parents, values)]
            keep, cut = (k, j) if j == 0 else (j, k)
            for pose in poses:
                rival = pose if keep == k else inverse(pose)
                tool = surfaces[keep].transform(rival[:3])
                if (surfaces[cut] ^ tool).volume() <= 0:
                    continue
                trimmed = (surfaces[cut] - tool).simplify(1e-3 * solids[cut].grid.voxel)
                if flaw(trimmed) is None:
                    surfaces[cut] = trimmed
    return surfaces


def _part(part: int, surface: Manifold, place: Place, maps: list[PartMaps], voxel: float,
          motion: Motion, convex: bool) -> Part:
    """Return the finished part: colours, collision pieces, joint and limits."""
    from part2gs_robotics.mesh.convex import convex_pieces

    vertices, faces = arrays(surface)
    mesh = PartMesh(vertices, faces, _colors(vertices, place, part),
                    _synthesised(vertices, faces, place.state1_from_0[part], maps, voxel))
    joint = place.joints[part - 1] if part else None
    value = joint.value if joint else 0.0
    name, carrier = part_name(part), place.parents[part - 1] if part else -1
    diagnostics = motion.diagnostics[part - 1] if 0 < part <= len(motion.diagnostics) else {}
    # One piece at most is the hull of the whole part.
    pieces = convex_pieces(mesh, tolerance=voxel, max_pieces=64 if convex else 1)
    return Part(name, carrier, mesh, pieces, joint,
                (min(0.0, value), max(0.0, value)), "measured", place.num_gaussians[part],
                dict(diagnostics))


def _colors(vertices: F64, place: Place, part: int) -> NDArray[np.uint8]:
    """Return the colour of the nearest Gaussians of either state at every vertex."""
    from scipy.spatial import cKDTree

    near = min(COLOR_NEIGHBORS, len(place.points[part]))
    distance, index = cKDTree(place.points[part]).query(vertices, k=[*range(1, near + 1)])
    weight = 1.0 / np.maximum(distance, 1e-9)
    blend = np.einsum("vk,vkc->vc", weight, place.colors[part][index]) / weight.sum(1)[:, None]
    return np.asarray(np.clip(np.rint(255 * blend), 0, 255), np.uint8)


def _synthesised(vertices: F64, faces: NDArray[np.int64], state1_from_0: F64,
                 maps: list[PartMaps], voxel: float) -> float:
    """Return the share of the surface area that no view of either state sees as first surface."""
    seen = np.zeros(len(vertices), bool)
    for s, points in enumerate((vertices, apply(state1_from_0, vertices))):
        seen |= observe(points, maps[s].maps, SEEN * voxel).surface > 0
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return float(1.0 - (area * seen[faces].mean(1)).sum() / max(area.sum(), 1e-300))
