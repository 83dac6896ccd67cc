"""Meshing: evidence of two states, part identities and joints -> one closed mesh per part."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import MeshConfig
from part2gs_robotics.errors import EmptyPartError
from part2gs_robotics.evidence.depth_maps import observe
from part2gs_robotics.mesh.board_parts import (
    belief_of,
    board_shapes,
    board_surfaces,
    edge_directions,
    yielded,
)
from part2gs_robotics.mesh.surface import closed_surface
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.solids import arrays
from part2gs_robotics.model.twin import Part, PartMesh
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.grid_solids import (
    MARGIN,
    apart_solids,
    carved_base,
    part_evidence,
    require_room,
    whole_solids,
)
from part2gs_robotics.volume.part_maps import PartMaps, render_part_maps
from part2gs_robotics.volume.place import Place
from part2gs_robotics.volume.wires import with_wires

if TYPE_CHECKING:
    from manifold3d import Manifold

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
    evidence = part_evidence(place, maps, grid)
    wholes = whole_solids(evidence)
    solids = apart_solids(wholes, evidence, place, config.clearance_voxels)
    _require_volume(solids)
    require_room(solids, wholes, place)
    # Only now: a wire may have a way where grids that have lost its neighbours' wires leave none.
    # And not the base: nothing falls off it, and tubes along rims make its convex pieces worse.
    solids = [with_wires(solid, k, place, maps) if k else solid
              for k, solid in enumerate(wholes if config.flat_walls else solids)]
    if config.flat_walls:
        # One by one: evidence is ten numbers per voxel of every part.
        beliefs = [belief_of(evidence.pop(0), not k) for k in range(place.count)]
        shapes = board_shapes(place, beliefs, solids, maps, edge_directions(scene, place))
        del beliefs, wholes, solids  # grids, which cutting parts apart has no need of
        surfaces, yields = board_surfaces(shapes, place, maps), shapes.yields
    else:
        solids[0] = carved_base(solids, evidence, place, config.clearance_voxels)
        surfaces = [closed_surface(s, part_name(k), config.clearance_voxels)
                    for k, s in enumerate(solids)]
        yields = [yielded(old.values > 0, new.values <= 0)
                  for new, old in zip(solids, wholes, strict=True)]
    surfaces = _apart(surfaces, place, grid.voxel)
    finish = [partial(_part, k, surface, place, maps, grid.voxel, motion, config.convex)
              for k, surface in enumerate(surfaces)]
    return tuple(replace(part, diagnostics={**part.diagnostics, "yielded": share})
                 for part, share in zip(side_by_side(finish), yields, strict=True))


def part_name(part: int) -> str:
    """Return the file-safe name of a part."""
    return f"part_{part}" if part else "base"


def _require_volume(solids: list[Solid]) -> None:
    """Raise if nothing is left of a part on its grid."""
    for k, solid in enumerate(solids):
        if not (solid.values > 0).any():
            raise EmptyPartError(
                f"{part_name(k)}: its volume is 0 on a grid of {max(solid.values.shape)} cells. "
                "Needed surfaces of this part that some view sees; raise --resolution, give more "
                "views, or lower --parts if the part does not exist.", k)


def _inside_masks(maps: list[PartMaps], place: Place) -> tuple[list[PartMaps], Place]:
    """Drop Gaussians that most views see through: floaters would only widen the grid."""
    for k in range(place.count):
        seen = [observe(apply(place.state1_from_0[k], place.points[k]) if s else place.points[k],
                        maps[s].maps, np.inf) for s in (0, 1)]
        fine = (seen[0].outside <= 1) | (seen[1].outside <= 1)
        if fine.any():
            place.keep(k, fine)
    return maps, place


def _grid(place: Place, resolution: int) -> Grid:
    """Return the grid around all parts at state 0."""
    boxes = [place.box(k) for k in range(place.count)]
    lo, hi = np.min([b[0] for b in boxes], 0), np.max([b[1] for b in boxes], 0)
    voxel = float((hi - lo).max()) / resolution
    return Grid.around(lo - MARGIN * voxel, hi + MARGIN * voxel, voxel)


def _apart(surfaces: list[Manifold], place: Place, voxel: float) -> list[Manifold]:
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
                rest = (surfaces[cut] - tool).as_original()
                trimmed = rest.simplify(1e-3 * voxel)
                if flaw(trimmed) is None:
                    surfaces[cut] = trimmed
    return surfaces


def _part(part: int, surface: Manifold, place: Place, maps: list[PartMaps], voxel: float,
          motion: Motion, convex: bool) -> Part:
    """Return the finished part: colours, collision pieces, joint and limits."""
    from part2gs_robotics.collision.convex import MOST_PIECES, convex_pieces

    vertices, faces = arrays(surface)
    mesh = PartMesh(vertices, faces, _colors(vertices, place, part),
                    _synthesised(vertices, faces, place.state1_from_0[part], maps, voxel))
    joint = place.joints[part - 1] if part else None
    value = joint.value if joint else 0.0
    name, carrier = part_name(part), place.parents[part - 1] if part else -1
    diagnostics = motion.diagnostics[part - 1] if 0 < part <= len(motion.diagnostics) else {}
    # One piece at most is the hull of the whole part.
    pieces = convex_pieces(mesh, tolerance=voxel, max_pieces=MOST_PIECES if convex else 1)
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
