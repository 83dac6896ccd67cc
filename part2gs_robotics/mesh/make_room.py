"""Make room: what parts sweep is cut out of those that they pass, exactly."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.joined import hull, joined
from part2gs_robotics.mesh.surface import flaw, vertices_apart
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import both_ways, chain, ways
from part2gs_robotics.model.se3 import apply, inverse, inverses
from part2gs_robotics.model.solids import arrays, corners_of, hull_of
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

logger = logging.getLogger(__name__)
ARC = 8.0  # cells a corner moves between two poses: the arc bulges by 0.1 beyond its chord at most
GAP = 0.15  # cells kept free round what passes: the bulge, and what touches does not overlap
FINE = 1e-3  # cells: what a cut leaves behind is tidied by so much
EXACT = 1e-4  # of a common hull may be empty: rounding
LOOSE = 0.01  # of the volume: what a cut leaves hanging in the air, smaller than that, is dropped
CROSSING = 0.1  # of a moving part that another sweeps: where it is more, both really cross
GRAZE = 0.015  # the same of one stride: noise of two parts that touch


def all_apart(surfaces: Sequence[Manifold], pieces: Sequence[Sequence[Manifold]], place: Place,
              voxel: float) -> list[Manifold]:
    """Return parts that yield to what passes them: the base to all, a moving part to earlier ones.

    Two that move may really cross, as a drawer and a shut door do: there the later one yields in
    both observed states and where they graze.

    Args:
        surfaces: closed, base first, in the world frame at state 0.
        pieces: convex, per part: what it is the union of.
        place: joints, and the part that carries each.
        voxel: size of the grid's cells, scene units.
    """
    out = list(surfaces)
    kept = [_fewer(own, voxel) for own in pieces]
    for part in (*range(1, place.count), 0):
        for other in range(1, part or place.count):
            always, along = _swept(other, part, kept[other], place, voxel)
            near = _Tools(along).near(out[part], kept[part])
            tools = _Tools([*always, *(near if part == 0 else _yielding(out[part], near))])
            cut = without(out[part], tools.near(out[part], kept[part]), part, voxel)
            if cut is out[part]:
                continue
            out[part] = cut
            if part:  # what the base keeps passes nobody
                kept[part] = [less for piece in kept[part]
                              if not (less := _rest(piece, tools.near(piece, ()))).is_empty()]
    return out


def base_apart(base: Manifold, part: int, pieces: Sequence[Manifold], place: Place,
               voxel: float) -> Manifold:
    """Return the base without what one part sweeps on the way of its joint from 0 to its value.

    Args:
        base: closed.
        part: number of the part; it hangs on the base.
        pieces: convex: what the part is the union of.
        place: joints, and the part that carries each.
        voxel: size of the grid's cells, scene units.
    """
    always, along = _swept(part, 0, _fewer(pieces, voxel), place, voxel)
    return without(base, _Tools([*always, *along]).near(base, ()), 0, voxel)


def _fewer(pieces: Sequence[Manifold], voxel: float) -> list[Manifold]:
    """Return convex pieces, those as one whose common hull is their union."""
    hulls = [hull(corners_of(piece), float(piece.volume())) for piece in pieces
             if not piece.is_empty()]
    solid = [one for one in hulls if one.volume > 0]
    return [hull_of(one.corners) for one in joined(solid, len(solid), EXACT, FINE * voxel)]


class _Tools:
    """Convex bodies that take from others, with their boxes."""

    def __init__(self, solids: Sequence[Manifold]) -> None:
        self.solids = [solid for solid in solids if not solid.is_empty()]
        self.boxes = _boxes(self.solids)

    def near(self, solid: Manifold, pieces: Sequence[Manifold]) -> list[Manifold]:
        """Return those whose box meets that of a piece of a solid, of the solid without pieces."""
        own = _boxes(pieces or [solid])
        low, high = self.boxes[:, None, :3], self.boxes[:, None, 3:]
        met = np.all((low <= own[None, :, 3:]) & (own[None, :, :3] <= high), axis=2)
        return [self.solids[i] for i in np.flatnonzero(met.max(axis=1, initial=False))]


def _boxes(solids: Sequence[Manifold]) -> F64:
    """Return [N, 6] lowest and highest corners."""
    return np.array([solid.bounding_box() for solid in solids], np.float64).reshape(-1, 6)


def without_bits(solid: Manifold) -> Manifold:
    """Return a solid without loose pieces that are a crumb of it; rooms closed all round stay."""
    import manifold3d

    pieces, whole = solid.decompose(), solid.volume()
    kept = [piece for piece in pieces if piece.volume() < 0 or piece.volume() > LOOSE * whole]
    if len(kept) == len(pieces) or not kept:
        return solid
    return manifold3d.Manifold.compose(kept)


def without(solid: Manifold, tools: list[Manifold], part: int, voxel: float) -> Manifold:
    """Return a solid without what the tools take, closed; itself if they take nothing.

    Args:
        solid: part, closed.
        tools: in its frame.
        part: its number, for the log.
        voxel: what is far smaller is tidied away, scene units.
    """
    return tidied(solid, _rest(solid, tools), part, voxel)


def tidied(solid: Manifold, rest: Manifold, part: int, voxel: float) -> Manifold:
    """Return what is left of a solid, closed; the solid if all or nothing is left, or it is torn.

    Arguments as of `without`.
    """
    if rest is solid or rest.is_empty():
        return solid
    rest = rest.as_original()  # or faces of two tools in one plane stay apart, slivers between them
    for step in (FINE * voxel, 0.0):
        tidy = vertices_apart(without_bits(rest.simplify(step) if step else rest), voxel)
        if flaw(tidy) is None:
            return tidy
    logger.warning("part %d: what other parts sweep cannot be cut out of it (%s)", part,
                   flaw(tidy))
    return solid


def _rest(solid: Manifold, tools: list[Manifold]) -> Manifold:
    """Return a solid minus tools; itself if none takes anything."""
    import manifold3d

    if not tools:
        return solid
    rest = solid - manifold3d.Manifold.batch_boolean(tools, manifold3d.OpType.Add)
    return rest if rest.volume() < solid.volume() else solid


def _yielding(solid: Manifold, near: list[Manifold]) -> list[Manifold]:
    """Return the strides to which a moving part yields."""
    import manifold3d

    if not near:
        return []
    lost = solid ^ manifold3d.Manifold.batch_boolean(near, manifold3d.OpType.Add)
    if lost.volume() <= CROSSING * solid.volume():
        return near
    return [tool for tool in near if (solid ^ tool).volume() <= GRAZE * solid.volume()]


def _swept(part: int, carrier: int, pieces: Sequence[Manifold], place: Place,
           voxel: float) -> tuple[list[Manifold], list[Manifold]]:
    """Return, in the carrier's frame, what a part takes in both states and along its strides."""
    values = [j.value for j in place.joints]
    observed = [inverse(chain(carrier, place.joints, place.parents, q))
                @ chain(part, place.joints, place.parents, q)
                for q in ([0.0] * len(values), values)]
    points = [_grown(piece, GAP * voxel) for piece in pieces]
    ends = [np.stack([pose, pose]) for pose in observed]
    strides = _strides(part, carrier, np.concatenate([np.zeros((0, 3)), *points]), place, voxel)
    return ([_between(p, pose) for pose in ends for p in points],
            [_between(p, pair) for pair in strides for p in points])


def _strides(part: int, carrier: int, points: F64, place: Place, voxel: float) -> list[F64]:
    """Return poses [2 or 4, 4, 4] carrier_from_part: corners of every stride on its ways."""
    if not len(points):
        return []
    ends = np.array([points.min(0), points.max(0)])
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = np.where(pick, ends[1], ends[0])
    out: list[F64] = []
    for way in ways(part, carrier, place.joints, place.parents, corners, ARC * voxel):
        poses = np.asarray(inverses(way))
        if np.abs(poses[:, :3, :3] - poses[0, :3, :3]).max() > 0:
            out += [poses[[i, i + 1]] for i in range(len(poses) - 1)]
        else:  # a slide sweeps the hull of its two ends
            out.append(poses[[0, -1]])
    both = both_ways(part, carrier, place.joints, place.parents, corners, ARC * voxel)
    return out + [np.asarray(inverses(poses)) for poses in both]


def _grown(piece: Manifold, gap: float) -> F64:
    """Return [N, 3] corners of a convex solid whose faces moved outward by a gap."""
    from scipy.spatial import HalfspaceIntersection, QhullError

    points, faces = arrays(piece)
    normal = np.cross(points[faces[:, 1]] - points[faces[:, 0]],
                      points[faces[:, 2]] - points[faces[:, 0]])
    length = np.linalg.norm(normal, axis=1)
    normal = normal[length > 0] / length[length > 0, None]
    normal = np.concatenate([normal, np.eye(3), -np.eye(3)])  # a box, so that no sharp edge spikes
    planes = np.column_stack([normal, -(normal @ points.T).max(1) - gap])
    try:
        found = HalfspaceIntersection(np.unique(planes.round(12), axis=0), points.mean(0))
    except QhullError:  # thinner than rounding: as it is
        return points
    return np.asarray(found.intersections, np.float64)


def _between(points: F64, poses: F64) -> Manifold:
    """Return the hull of a convex piece's corners at both ends of a stride."""
    import manifold3d

    both = np.concatenate([apply(pose, points) for pose in poses])
    return manifold3d.Manifold.hull_points(np.ascontiguousarray(both))
