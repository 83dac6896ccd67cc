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
from part2gs_robotics.solids import bounds, hull_of, to_mesh
from part2gs_robotics.twin import PartMesh, Twin

if TYPE_CHECKING:
    from manifold3d import Manifold

F64 = NDArray[np.float64]
GAP = 5e-4  # of the size: half a millimetre on a metre, free of contact forces
STEPS = 30  # per joint; 90 degrees in steps of 3: the arc between leaves 0.03 % of the radius
QUARTER = 0.25  # of its width a thin wall gives first
DEEPEST = 0.5  # of its width any piece gives: deeper overlaps are no noise and are left alone
CRUMB = 1e-7  # of the size cubed
SPLINTER = 0.02  # of all collision volume of a part: so small a piece may be given up


@dataclass
class _Piece:
    """A convex body under the knife, in the state-0 frame of the world.

    Below the volume `splinter` it may be dropped.
    """

    part: int
    solid: Manifold
    vertices: F64
    normals: F64
    splinter: float = 0.0

    def recut(self, solid: Manifold) -> None:
        self.solid = solid
        self.vertices, self.normals = _corners(solid)


def separate_pieces(twin: Twin, *, gap: float | None = None) -> Twin:
    """Return the twin with collision pieces that no joint drives into each other.

    Every joint is swept over its range with the others at state 0 and at state 1; wherever pieces of a moved and an unmoved part come closer than `gap`, both are cut back to a
    plane between them. Visual meshes stay as they are.

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
        for solid in (hull_of(p.vertices) for p in part.pieces)
    ]
    before = sum(float(p.solid.volume()) for p in pieces)
    for piece in pieces:
        whole = sum(float(p.solid.volume()) for p in pieces if p.part == piece.part)
        piece.splinter = SPLINTER * whole
    stuck = set[tuple[int, int]]()
    for moved, start, end in _passages(twin):
        stuck |= _separate_at(pieces, moved, start, end, distance)
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


def _passages(twin: Twin) -> list[tuple[frozenset[int], list[F64], list[F64]]]:
    """Return (moved parts, transforms at the start, at the end) of short motions.

    Every joint alone in STEPS steps over its range, then every joint around state 1.
    """
    moving = moving_parts(twin)
    observed = [_value(twin, i) for i in moving]
    out = []
    for slot, index in enumerate(moving):
        moved = frozenset(subtree(twin, index))
        for rest in ([0.0] * len(moving), observed):
            stops = [rest[:slot] + [float(q)] + rest[slot + 1 :] for q in _stops(twin, index)]
            placed = [part_transforms(twin, stop) for stop in stops]
            out += [(moved, a, b) for a, b in zip(placed[:-1], placed[1:], strict=True)]
    return out


def _value(twin: Twin, index: int) -> float:
    joint = twin.parts[index].joint
    assert joint is not None  # moving parts have one
    return joint.value


def _stops(twin: Twin, index: int) -> F64:
    """Return joint positions evenly over the range."""
    low, high = twin.parts[index].limits
    return np.linspace(low, high, STEPS + 1)


def _separate_at(
    pieces: list[_Piece], moved: frozenset[int], start: list[F64], end: list[F64], gap: float
) -> set[tuple[int, int]]:
    """Cut back every pair of moved and unmoved pieces that comes too close on a short motion."""
    at = [[p.vertices @ w[p.part][:3, :3].T + w[p.part][:3, 3] for p in pieces] for w in (start, end)]
    low, high = np.full((len(pieces), 3), np.inf), np.full((len(pieces), 3), -np.inf)
    for i, both in enumerate(zip(*at, strict=True)):
        corners = np.concatenate(both)
        if len(corners):
            low[i], high[i] = corners.min(0), corners.max(0)
    mine = np.array([p.part in moved for p in pieces])
    near = (low[:, None] < high[None] + gap).all(-1) & (low[None] < high[:, None] + gap).all(-1)
    stuck = set[tuple[int, int]]()
    for a, b in np.argwhere(near & mine[:, None] & ~mine[None]):
        one, two = pieces[a], pieces[b]
        moves = [inverse(w[two.part]) @ w[one.part] for w in (start, end)]
        if not _separate(one, two, moves, gap):
            stuck.add((min(one.part, two.part), max(one.part, two.part)))
    return stuck


def _separate(one: _Piece, two: _Piece, two_from_one: list[F64], gap: float) -> bool:
    """Cut two convex bodies back to one plane that parts them at both ends of a motion.

    The hull of a body at both ends holds every place between them of a slide, and of a turn all
    but the arc's height: the plane parts them all the way. False if they are too deep.
    """
    if not len(one.vertices) or not len(two.vertices):
        return True
    corners = np.concatenate([one.vertices @ m[:3, :3].T + m[:3, 3] for m in two_from_one])
    turned = [one.normals @ m[:3, :3].T for m in two_from_one]
    normals = np.concatenate([*turned, -two.normals])  # from the first to the second
    along_a, along_b = normals @ corners.T, normals @ two.vertices.T
    depth = along_a.max(1) - along_b.min(1)
    best = int(np.argmin(depth))
    if depth[best] <= -gap:
        return True
    normal, top, bottom = normals[best], float(along_a[best].max()), float(along_b[best].min())
    width_a = float(np.ptp(one.vertices @ (two_from_one[0][:3, :3].T @ normal)))
    width_b = float(np.ptp(along_b[best]))
    shares = _shares((one, width_a), (two, width_b), float(depth[best]) + gap)
    if shares is None:
        return False
    for move in two_from_one:
        in_one = move[:3, :3].T @ normal
        level = top - shares[0] - float(normal @ move[:3, 3])
        one.recut(one.solid.trim_by_plane((-in_one).tolist(), -level))
    two.recut(two.solid.trim_by_plane(normal.tolist(), bottom + shares[1]))
    return True


def _shares(
    a: tuple[_Piece, float], b: tuple[_Piece, float], cut: float
) -> tuple[float, float] | None:
    """Return how much of a cut each of two (piece, width) takes; None if neither can.

    A slice off the piece with the smaller section costs least volume, but thin walls should stay:
    up to a quarter of its width is taken there, or the whole piece when it is a splinter.
    """
    section = [piece.solid.volume() / max(width, 1e-300) for piece, width in (a, b)]
    small = int(section[0] > section[1])
    (piece, width), other = (a, b)[small], (b, a)[small]
    slim = min(cut, QUARTER * width)
    rest = cut - slim
    loss = slim * section[small] + rest * section[1 - small]
    fits = rest <= DEEPEST * other[1]
    options = [(loss, slim, rest)] if fits else []
    if cut <= DEEPEST * width:
        options.append((2 * cut * section[small], cut, 0.0))
    if piece.solid.volume() <= piece.splinter:
        options.append((3 * float(piece.solid.volume()), 2 * width + cut, 0.0))
    if not options:
        return None
    _, first, second = min(options)
    return (first, second) if small == 0 else (second, first)
