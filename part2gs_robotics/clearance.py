"""Clearance: collision pieces of neighbours kept apart along the motion of every joint.

Hulls of noisy walls stick out a little; where a drawer runs 3 mm beside a wall, a little is enough
to block it. Two convex bodies have a separating plane: both are cut back to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.kinematics import moving_parts, part_transforms, subtree
from part2gs_robotics.se3 import inverse
from part2gs_robotics.solids import bounds, to_manifold, to_mesh
from part2gs_robotics.twin import PartMesh, Twin

if TYPE_CHECKING:
    from manifold3d import Manifold

F64 = NDArray[np.float64]
GAP = 5e-4  # of the size: half a millimetre on a metre, free of contact forces
POSES = 25  # per joint; 90 degrees in steps of 4: the arc between leaves 0.06 % of the radius
DEEPEST = 0.5  # of a piece's own width: deeper overlaps are no noise and are left alone
CRUMB = 1e-7  # of the size cubed


@dataclass
class _Piece:
    """A convex body under the knife: state-0 frame of the world."""

    part: int
    solid: Manifold
    vertices: F64
    normals: F64

    def recut(self, solid: Manifold) -> None:
        self.solid = solid
        self.vertices, self.normals = _corners(solid)


def separate_pieces(twin: Twin, *, gap: float | None = None) -> Twin:
    """Return the twin with collision pieces that no joint drives into each other.

    Every joint is swept over its range with the others at state 0, and all joints stand at state
    1; wherever pieces of a moved and an unmoved part come closer than `gap`, both are cut back to a
    plane between them, each in proportion to its width. Visual meshes stay as they are.

    Args:
        twin: with convex pieces.
        gap: scene units; 5e-4 of the size when None.

    Returns:
        A twin with new pieces and a note of what was cut off and what could not be separated.
    """
    low, high = bounds(tuple(p.mesh for p in twin.parts))
    size = float(np.linalg.norm(high - low))
    distance = GAP * size if gap is None else gap
    pieces = [
        _Piece(i, solid, *_corners(solid))
        for i, part in enumerate(twin.parts)
        for solid in (to_manifold(p).hull() for p in part.pieces)
    ]
    before = sum(float(p.solid.volume()) for p in pieces)
    stuck = set[tuple[int, int]]()
    for moved, positions in _poses(twin):
        stuck |= _separate_at(pieces, moved, part_transforms(twin, positions), distance)
    if before <= 0:
        return twin
    lost = 1 - sum(float(p.solid.volume()) for p in pieces) / before
    return replace(
        twin,
        parts=tuple(
            replace(part, pieces=_finished(pieces, i, part.pieces, CRUMB * size**3))
            for i, part in enumerate(twin.parts)
        ),
        notes=(*twin.notes, *_notes(twin, lost, distance, stuck)),
    )


def _notes(twin: Twin, lost: float, gap: float, stuck: set[tuple[int, int]]) -> tuple[str, ...]:
    notes = []
    if lost > 0:
        notes.append(
            f"collision pieces cut back by {100 * lost:.2g} % of their volume to stay {gap:.2g} "
            "units apart along all joints"
        )
    names = sorted({f"{twin.parts[a].name} and {twin.parts[b].name}" for a, b in stuck})
    if names:
        notes.append(f"collision pieces overlap too deep to cut back: {', '.join(names)}")
    return tuple(notes)


def _finished(
    pieces: list[_Piece], part: int, old: tuple[PartMesh, ...], crumb: float
) -> tuple[PartMesh, ...]:
    mine = [p for p in pieces if p.part == part]
    color = old[0].colors[0] if old else np.zeros(3, np.uint8)
    rgb = (int(color[0]), int(color[1]), int(color[2]))
    kept = [to_mesh(p.solid, rgb) for p in mine if p.solid.volume() > crumb]
    return tuple(kept) or old[:1]


def _corners(solid: Manifold) -> tuple[F64, F64]:
    """Return [V, 3] corners and [N, 3] distinct face normals of a convex solid."""
    raw = solid.to_mesh64()
    vertices = np.array(raw.vert_properties[:, :3])
    tri = vertices[np.array(raw.tri_verts, np.int64)]
    cross = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    normals = cross[length[:, 0] > 0] / length[length[:, 0] > 0]
    return vertices, np.unique(normals.round(6), axis=0)


def _poses(twin: Twin) -> list[tuple[frozenset[int], list[float]]]:
    """Return (moved parts, joint positions): every joint alone, then all at state 1."""
    moving, out = moving_parts(twin), []
    for slot, index in enumerate(moving):
        for q in np.linspace(*twin.parts[index].limits, POSES):
            positions = [float(q) if i == slot else 0.0 for i in range(len(moving))]
            out.append((frozenset(subtree(twin, index)), positions))
    observed = []
    for index in moving:
        joint = twin.parts[index].joint
        assert joint is not None  # moving parts have one
        observed.append(joint.value)
    out += [(frozenset(subtree(twin, i)), observed) for i in moving]
    return out


def _separate_at(
    pieces: list[_Piece], moved: frozenset[int], world_from_0: list[F64], gap: float
) -> set[tuple[int, int]]:
    """Cut back every pair of moved and unmoved pieces that is too close at one pose."""
    placed = [p.vertices @ world_from_0[p.part][:3, :3].T + world_from_0[p.part][:3, 3] for p in pieces]
    low = np.array([v.min(0) if len(v) else np.full(3, np.inf) for v in placed])
    high = np.array([v.max(0) if len(v) else np.full(3, -np.inf) for v in placed])
    mine = np.array([p.part in moved for p in pieces])
    near = (low[:, None] < high[None] + gap).all(-1) & (low[None] < high[:, None] + gap).all(-1)
    stuck = set[tuple[int, int]]()
    for a, b in np.argwhere(near & mine[:, None] & ~mine[None]):
        one, two = pieces[a], pieces[b]
        if not _separate(one, two, world_from_0[one.part], world_from_0[two.part], gap):
            stuck.add((min(one.part, two.part), max(one.part, two.part)))
    return stuck


def _separate(one: _Piece, two: _Piece, world_from_one: F64, world_from_two: F64, gap: float) -> bool:
    """Cut two convex bodies back to a plane between them; False if they are too deep."""
    if not len(one.vertices) or not len(two.vertices):
        return True
    two_from_one = inverse(world_from_two) @ world_from_one
    rot = two_from_one[:3, :3]
    a = one.vertices @ rot.T + two_from_one[:3, 3]  # everything in the frame of the second
    normals = np.concatenate([one.normals @ rot.T, -two.normals])  # from the first to the second
    along_a, along_b = normals @ a.T, normals @ two.vertices.T
    depth = along_a.max(1) - along_b.min(1)
    best = int(np.argmin(depth))
    if depth[best] <= -gap:
        return True
    width_a, width_b = np.ptp(along_a[best]), np.ptp(along_b[best])
    share = float(width_a / max(width_a + width_b, 1e-300))
    cut = float(depth[best]) + gap
    if cut * share > DEEPEST * width_a or cut * (1 - share) > DEEPEST * width_b:
        return False
    normal = normals[best]
    top, bottom = float(along_a[best].max()), float(along_b[best].min())
    in_one = rot.T @ normal
    level = top - cut * share - float(normal @ two_from_one[:3, 3])
    one.recut(one.solid.trim_by_plane((-in_one).tolist(), -level))
    two.recut(two.solid.trim_by_plane(normal.tolist(), bottom + cut * (1 - share)))
    return True
