"""Board parts: every part as a solid of flat faces, none in the way of another."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.boards.board_solid import BoardSolid, board_solid, filled, paying, refined
from part2gs_robotics.boards.cut import Belief
from part2gs_robotics.boards.outlines import Outlines
from part2gs_robotics.boards.rest import with_rest
from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.segments import segments_of
from part2gs_robotics.mesh.make_room import all_apart, without_bits
from part2gs_robotics.mesh.rubs import without_rubs
from part2gs_robotics.mesh.see_through import missed, unstopped
from part2gs_robotics.mesh.shut import shut
from part2gs_robotics.mesh.surface import closed_surface, flaw, vertices_apart
from part2gs_robotics.mesh.to_outlines import moved_pieces, to_outlines
from part2gs_robotics.model.arrays import F32, F64, Mask
from part2gs_robotics.model.kinematics import chain, sweep
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.model.solids import arrays
from part2gs_robotics.volume.carve import Solid, carve
from part2gs_robotics.volume.fuse import Fused
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.part_solids import DEEP_SHARE
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

logger = logging.getLogger(__name__)
DOUBT = 2.0  # views that see past a point against one that sees it behind a surface: depth is noisy
OUTSIDE = 2  # views that see background there: one may be a wrong mask
FULL = 2.0  # weight of views, two that face it, at which a surface counts as seen
NEAR = 1.2  # voxels from a surface: the two faces beside it
ENCLOSED = 0.1  # belief per voxel that nearly every view says is inside a part, though none saw it
REST = 0.02  # the same of what nobody saw of the base: walls rather stand than hang
PLAIN = 0.07  # voxels that simplifying may move a surface: two keep to the 0.15 between parts
ROOM = 0.5  # voxels kept free round what moves
GAP = 3  # voxels: where surfaces only touch, layers of one or two are taken
FILLINGS = 6  # times that rays which nothing stops raise what stopping them is worth
STEPS = 0.5  # voxels: a stair of steps one cell high, a slope to the planes, lies within
SAME = np.cos(np.deg2rad(1.5))  # directions of edges that are one


def edge_directions(scene: Scene, place: Place) -> list[F64]:
    """Return per part [E, 3] directions of straight edges of both states, in its frame."""
    found = [[d for d, _ in edge_families(bundled([segments_of(state)]), np.random.default_rng(0))]
             for state in scene.states]
    out = []
    for k in range(place.count):
        back = place.state1_from_0[k][:3, :3].T
        kept: list[F64] = []
        for edge in (*found[0], *(back @ e for e in found[1])):
            if all(abs(edge @ other) < SAME for other in kept):
                kept.append(edge)
        out.append(np.array(kept).reshape(-1, 3))
    return out


@dataclass(frozen=True)
class Shapes:
    """Solids of flat faces of all parts, base first, that may still be in each other's way.

    Attributes:
        surfaces: closed.
        pieces: per part, convex solids that it is the union of.
        curved: parts that are not of flat faces.
        yields: what `yielded` says of every part.
        voxel: size of the grid's cells.
    """

    surfaces: list[Manifold]
    pieces: list[list[Manifold]]
    curved: list[int]
    yields: list[float]
    voxel: float


def board_shapes(place: Place, beliefs: Sequence[Belief], wholes: Sequence[Solid],
                 maps: Sequence[PartMaps], edges: Sequence[F64]) -> Shapes:
    """Return the solids of flat faces that explain photos best.

    Args:
        place: joints, and the part that carries each.
        beliefs: what views say about every part.
        wholes: the noisy solids of the parts, in whose surfaces planes are looked for.
        maps: depth and part of every pixel, per state.
        edges: per part, [E, 3] directions.

    Raises:
        MeshError: a part has no closed surface.
    """
    boards, smooth, yields = _cut_out(place, beliefs, wholes, edges)
    worth = [np.zeros(board.cells.grid.shape) for board in boards]
    for _ in range(FILLINGS):
        more = unstopped(boards, place, maps)
        for old, new in zip(worth, more, strict=True):
            old += new
        boards = [filled(board, gain) if new.any() else board
                  for board, gain, new in zip(boards, worth, more, strict=True)]
        del more  # eight bytes per voxel and part: the next round makes as many
    boards = [paying(board, gain) for board, gain in zip(boards, worth, strict=True)]
    boards = [_drawn(board, k, place, maps) for k, board in enumerate(boards)]
    boards = [with_rest(board, *own, wanted) for board, own, wanted
              in zip(boards, smooth, missed(boards, place, maps), strict=True)]
    surfaces = [_closed(board, smooth[k][0], k) for k, board in enumerate(boards)]
    voxel = wholes[0].grid.voxel
    surfaces = [surface if board.curved else _simpler(surface, STEPS * voxel, voxel)
                for board, surface in zip(boards, surfaces, strict=True)]
    return Shapes(surfaces, [board.pieces for board in boards],
                  [k for k, board in enumerate(boards) if board.curved], yields, voxel)


def board_surfaces(shapes: Shapes, place: Place, maps: Sequence[PartMaps]) -> list[Manifold]:
    """Return the closed surfaces of all parts, none in the way of another, base first.

    Args:
        shapes: of the parts.
        place: joints, and the part that carries each.
        maps: depth and part of every pixel, per state.
    """
    voxel = shapes.voxel
    # What clears curved parts of others is their grid alone, by less than outlines move them.
    curved = [k for k in shapes.curved if k]
    surfaces, bends = to_outlines(shapes.surfaces, place, maps, voxel, curved)
    pieces = [moved_pieces(own, bend) for own, bend in zip(shapes.pieces, bends, strict=True)]
    apart = all_apart(surfaces, pieces, place, voxel)
    apart = without_rubs(shut(apart, pieces, place, maps, voxel), pieces, place, maps, voxel)
    return [_simpler(surface, PLAIN * voxel, voxel) for surface in apart]


def yielded(inside: Mask, taken: Mask) -> float:
    """Return the share of a solid's volume that others take which is more than a gap.

    Args:
        inside: [X, Y, Z] voxels of the solid.
        taken: [X, Y, Z] where others are, or come by.
    """
    from scipy.ndimage import binary_opening

    return float(binary_opening(inside & taken, np.ones(3 * (GAP,))).sum() / max(inside.sum(), 1))


def _simpler(surface: Manifold, moved: float, voxel: float) -> Manifold:
    """Return a surface without vertices that shape it by less than so much."""
    fewer = vertices_apart(surface.simplify(moved), voxel)
    return fewer if flaw(fewer) is None else surface


def _drawn(board: BoardSolid, part: int, place: Place, maps: Sequence[PartMaps]) -> BoardSolid:
    """Return a solid with its planes on the outlines of both states' masks."""
    poses = np.eye(4), place.state1_from_0[part]
    return refined(board, [
        Outlines(one.maps.alphas.astype(np.uint8), one.maps.projections @ pose)
        for one, pose in zip(maps, poses, strict=True)])


def _closed(board: BoardSolid, smooth: Manifold, part: int) -> Manifold:
    """Return the closed surface of a solid of flat faces, the noisy one's if it has none."""
    surface = vertices_apart(without_bits(board.whole), board.cells.grid.voxel)
    reason = flaw(surface)
    if reason is None:
        return surface
    logger.warning("part %d: its flat faces do not close (%s); its noisy surface is taken", part,
                   reason)
    return smooth


def _cut_out(place: Place, beliefs: Sequence[Belief], wholes: Sequence[Solid],
             edges: Sequence[F64],
             ) -> tuple[list[BoardSolid], list[tuple[Manifold, F32]], list[float]]:
    """Return solids of flat faces of all parts, none where another comes by.

    With each, the noisy surface of the same part and the values of its grid, and what it yields.
    """
    found: dict[int, BoardSolid] = {}
    bodies: dict[int, Solid] = {}
    smooth: dict[int, tuple[Manifold, F32]] = {}
    yields: dict[int, float] = {}
    for k in (*range(1, place.count), 0):
        belief, solid = beliefs[k], wholes[k]
        taken = _taken(k, bodies, place, solid)
        yields[k] = yielded(solid.values > 0, taken)
        if taken.any():
            belief = replace(belief, inside=np.where(taken, np.float32(-1), belief.inside))
            away = np.where(taken, np.minimum(solid.values, np.float32(-1)), solid.values)
            solid = replace(solid, values=away)
        noisy = closed_surface(solid, f"part {k}", 1.0)
        smooth[k] = noisy, solid.values
        board = board_solid(belief, *arrays(noisy), edges[k])
        bodies[k] = solid if board.curved else Solid(board.cells.grid, board.values)
        if board.curved:
            logger.info("part %d: %.0f %% of it lies in planes; its smooth surface is taken", k,
                        100 * board.flat)
            board = replace(board, whole=noisy, pieces=[])
        found[k] = board
    order = range(place.count)
    return [found[k] for k in order], [smooth[k] for k in order], [yields[k] for k in order]


def belief_of(fused: Fused, base: bool) -> Belief:
    """Return what views say about a part.

    Args:
        fused: evidence.
        base: what nobody saw of it is there rather than not.
    """
    free = np.float32(DOUBT) * fused.clear
    votes = fused.behind + free + fused.behind_other
    inside = (fused.behind - free - fused.behind_other) / (votes + np.float32(1))
    if base:
        unseen: F32 | np.float32 = np.float32(REST)
    else:
        unseen = np.where(fused.enclosed >= DEEP_SHARE, np.float32(ENCLOSED),
                          np.float32(-0.5 * ENCLOSED))
    inside = np.where(votes < 0.5, unseen, inside)
    outside = fused.background >= OUTSIDE
    inside = np.where(outside, np.float32(-1), inside)
    near = np.abs(fused.distance) < NEAR * fused.grid.voxel
    surface = np.where(near, np.clip(fused.own / np.float32(FULL), 0, 1), np.float32(0))
    return Belief(fused.grid, inside.astype(np.float32), surface.astype(np.float32), outside)


def _taken(part: int, others: dict[int, Solid], place: Place, solid: Solid) -> Mask:
    """Return [X, Y, Z] where other parts are, or come by."""
    grid = solid.grid
    full = Solid(grid, np.full(grid.shape, 3.0, np.float32))
    taken = np.zeros(grid.shape, bool)
    for other, rival in others.items():
        if not (rival.values > 0).any():
            continue
        if part:  # two that move may well meet elsewhere: a drawer runs into a shut door
            values = [j.value for j in place.joints]
            poses = np.stack([inverse(chain(other, place.joints, place.parents, q))
                              @ chain(part, place.joints, place.parents, q)
                              for q in ([0.0] * len(values), values)])
        else:
            poses = sweep(other, part, place.joints, place.parents, rival.corners(), grid.voxel)
        taken |= carve(full, rival, poses, ROOM).values < 0
    return taken
