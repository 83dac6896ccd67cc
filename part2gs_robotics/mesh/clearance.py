"""Clearance: collision pieces of neighbours kept apart along the motion of every joint.

Hulls of noisy walls stick out a little; where a drawer runs 3 mm beside a wall, a little is enough
to block it. Two convex bodies have a separating plane: both are cut back to it. Where that costs
too much, one of them closes an opening that the other passes: it is cut up around the passage.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from part2gs_robotics.collision.few_corners import few_cornered
from part2gs_robotics.mesh.cut_pieces import Piece, piece_of
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moving_parts, part_transforms, subtree
from part2gs_robotics.model.se3 import inverse
from part2gs_robotics.model.solids import hull_of, simpler, size_of, to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin

GAP = 2e-3  # of the size: engines that collide with a margin still see a gap
LEAST_GAP = 2.2e-3  # metres: Bullet puts 1 mm round every piece, and rounds
MOST_GAP = 0.01  # of the size: a small thing would lose more of its walls to the gap than it gains
STEPS = 30  # per joint at least
TURN = np.deg2rad(3.0)  # of a hinge between them at most: the arc leaves 0.03 % of the radius
COARSE = 1.5e-3  # of the size: copy of a part against which losses are weighed
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of a cut that the first of two pieces takes
SPARE = 0.03  # of its volume a part may lose in one cut; more is a real crossing, left alone
CRUMB = 1e-7  # of the size cubed
REPEATS = 3  # per short motion, while pieces are cut up: a wall has few openings
MOST_PIECES = 300  # of the twin; one of four doors and drawers has about 110


@dataclass(frozen=True)
class _Way:
    """A short motion: the part whose joint moves, its two values, what moves, and both poses."""

    index: int
    way: tuple[float, float]
    moved: frozenset[int]
    start: list[F64]
    end: list[F64]


@dataclass(frozen=True)
class _Stuck:
    """A pair of parts whose pieces cannot be parted while a joint moves between two values."""

    pair: tuple[int, int]
    index: int
    way: tuple[float, float]


def gap_share(twin: Twin, share: float, metres: float) -> float:
    """Return the gap between pieces of two parts, of the size, that engines with margins see too.

    Args:
        twin: with meshes.
        share: wanted, of the size; 0 asks for none.
        metres: of a unit.
    """
    size = size_of(tuple(p.mesh for p in twin.parts)) * metres
    return max(share, min(LEAST_GAP / size, MOST_GAP)) if share > 0 else 0.0


def _pieces(twin: Twin, size: float) -> list[Piece]:
    out = []
    for index, part in enumerate(twin.parts):
        whole = simpler(to_manifold(part.mesh), COARSE * size)
        for piece in part.pieces:
            hull = hull_of(piece.vertices)
            out.append(piece_of(index, hull, hull ^ whole, SPARE * float(whole.volume())))
    return out


def with_apart_pieces(twin: Twin, share: float = GAP) -> Twin:
    """Return the twin with collision pieces apart on the whole range of every joint, if they can.

    Where pieces of two parts overlap too deep to be cut back, beyond what was observed, the range
    of the joint that moves them ends there.

    Args:
        twin: with convex pieces.
        share: gap between pieces of two parts, of the size of the object.
    """
    gap = share * size_of(tuple(p.mesh for p in twin.parts))
    apart, stuck = _separated(twin, gap)
    parts = [_short_of(part, [one for one in stuck if one.index == i])
             for i, part in enumerate(twin.parts)]
    short = [new.name for new, old in zip(parts, twin.parts, strict=True)
             if new.limits != old.limits]
    if not short:
        return apart
    note = f"range ends where collision pieces would overlap: {', '.join(sorted(short))}"
    return separate_pieces(replace(twin, parts=tuple(parts), notes=(*twin.notes, note)), gap=gap)


def _short_of(part: Part, stuck: list[_Stuck]) -> Part:
    """Return a part whose derived range ends where it would be stuck, outside of what was seen."""
    if part.limits_source != "derived" or part.joint is None:
        return part
    low, high = min(0.0, part.joint.value), max(0.0, part.joint.value)
    below = [min(low, max(one.way)) for one in stuck if min(one.way) < low]
    above = [max(high, min(one.way)) for one in stuck if max(one.way) > high]
    limits = max([part.limits[0], *below]), min([part.limits[1], *above])
    return part if limits == part.limits else replace(part, limits=limits)


def separate_pieces(twin: Twin, *, gap: float | None = None) -> Twin:
    """Return the twin with collision pieces that no joint drives into each other.

    Every joint is swept over its range with the others at state 0 and at state 1; wherever pieces
    of a moved and an unmoved part come closer than `gap`, both are cut back to a plane between
    them, where it costs the real parts least. Visual meshes stay as they are.

    Args:
        twin: with convex pieces.
        gap: scene units; GAP of the size when None.

    Returns:
        A twin with new pieces and a note of what was cut off and what could not be separated.
    """
    return _separated(twin, gap)[0]


def _separated(twin: Twin, gap: float | None) -> tuple[Twin, list[_Stuck]]:
    """Return `separate_pieces`, and where which parts could not be separated."""
    size = size_of(tuple(p.mesh for p in twin.parts))
    distance = GAP * size if gap is None else gap
    pieces = _pieces(twin, size)
    before = sum(float(p.solid.volume()) for p in pieces)
    stuck = list[_Stuck]()
    for one in _passages(twin):
        for _ in range(REPEATS):
            count = len(pieces)
            now = _separate_at(pieces, one.moved, one.start, one.end, distance)
            if len(pieces) == count:  # new pieces are asked as well
                break
        stuck += [_Stuck(pair, one.index, one.way) for pair in sorted(now)]
    if before <= 0:
        return twin, stuck
    lost = 1 - sum(float(p.solid.volume()) for p in pieces) / before
    parts = tuple(
        replace(part, pieces=_finished(pieces, i, part.pieces, CRUMB * size**3))
        for i, part in enumerate(twin.parts)
    )
    notes = (*twin.notes, *_notes(twin, lost, distance / size, {one.pair for one in stuck}))
    return replace(twin, parts=parts, notes=notes), stuck


def _notes(twin: Twin, lost: float, gap: float, stuck: set[tuple[int, int]]) -> tuple[str, ...]:
    notes = []
    if lost > 0:
        notes.append(
            f"collision pieces cut back by {100 * lost:.2g} % of their volume to stay "
            f"{100 * gap:.2g} % of the size apart along all joints"
        )
    names = sorted({f"{twin.parts[a].name} and {twin.parts[b].name}" for a, b in stuck})
    if names:
        notes.append(f"collision pieces overlap too deep to cut back: {', '.join(names)}")
    return tuple(notes)


def _finished(
    pieces: list[Piece], part: int, old: tuple[PartMesh, ...], crumb: float
) -> tuple[PartMesh, ...]:
    mine = [p for p in pieces if p.part == part]
    color = old[0].colors[0] if old else np.zeros(3, np.uint8)
    rgb = (int(color[0]), int(color[1]), int(color[2]))
    kept = [to_mesh(few_cornered(p.solid), rgb) for p in mine if p.solid.volume() > crumb]
    return tuple(kept) or old[:1]


def _passages(twin: Twin) -> list[_Way]:
    """Return short motions.

    Every joint alone in small steps over its range, then every joint around state 1.
    """
    moving = moving_parts(twin)
    observed = [_value(twin, i) for i in moving]
    out = []
    for slot, index in enumerate(moving):
        moved = frozenset(subtree(twin, index))
        for rest in ([0.0] * len(moving), observed):
            values = [float(q) for q in _stops(twin, index)]
            placed = [part_transforms(twin, [*rest[:slot], q, *rest[slot + 1 :]]) for q in values]
            out += [_Way(index, way, moved, a, b) for way, (a, b)
                    in zip(pairwise(values), pairwise(placed), strict=True)]
    return out


def _value(twin: Twin, index: int) -> float:
    joint = twin.parts[index].joint
    assert joint is not None  # moving parts have one
    return joint.value


def _stops(twin: Twin, index: int) -> F64:
    """Return joint positions evenly over the range."""
    joint, (low, high) = twin.parts[index].joint, twin.parts[index].limits
    turns = joint is not None and joint.turns
    steps = max(STEPS, int(np.ceil((high - low) / TURN))) if turns else STEPS
    value = _value(twin, index)  # what was seen is one of them, at either end
    return np.unique([*np.linspace(low, high, steps + 1), 0.0, value])


def _separate_at(
    pieces: list[Piece], moved: frozenset[int], start: list[F64], end: list[F64], gap: float
) -> set[tuple[int, int]]:
    """Cut back every pair of moved and unmoved pieces that comes too close on a short motion."""
    at = [
        [p.vertices @ w[p.part][:3, :3].T + w[p.part][:3, 3] for p in pieces] for w in (start, end)
    ]
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
        back = [inverse(m) for m in moves]
        if not (_separate(one, two, moves, gap) or _opened(pieces, b, one, moves, gap)
                or _opened(pieces, a, two, back, gap)):
            stuck.add((min(one.part, two.part), max(one.part, two.part)))
    return stuck


def _opened(pieces: list[Piece], index: int, other: Piece, moves: list[F64], gap: float) -> bool:
    """Cut a piece up around another one at both ends of a motion; False if that costs too much.

    Args:
        pieces: of all parts; the piece's own place is taken by one of its shares, others follow.
        index: of the piece.
        other: what passes.
        moves: [4, 4] of its frame into the piece's, at both ends.
        gap: scene units.
    """
    if len(pieces) >= MOST_PIECES:
        return False
    passing = np.concatenate([other.vertices @ m[:3, :3].T + m[:3, 3] for m in moves])
    shares = pieces[index].around(passing, gap)
    if shares:
        pieces[index] = shares[0]
        pieces.extend(shares[1:])
    return bool(shares)


def _separate(one: Piece, two: Piece, two_from_one: list[F64], gap: float) -> bool:
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
    along = float(along_a[best].max()), float(along_b[best].min())
    return _cut(one, two, two_from_one, normals[best], along, gap)


def _cut(
    one: Piece,
    two: Piece,
    two_from_one: list[F64],
    normal: F64,
    ends: tuple[float, float],
    gap: float,
) -> bool:
    """Cut along a normal where it costs least of the real parts: mostly phantom goes.

    The plane goes to the end of the first body, of the second, or between them.
    """
    top, bottom = ends
    best: tuple[float, list[tuple[F64, float]], list[tuple[F64, float]]] | None = None
    for share in SHARES:
        level = top - share * (top - bottom + gap)
        planes = [(-(m[:3, :3].T @ normal), float(normal @ m[:3, 3]) - level) for m in two_from_one]
        other = [(normal, level + gap)]
        losses = one.loss(planes), two.loss(other)
        cost = max(losses[0] / one.spare, losses[1] / two.spare)
        if best is None or cost < best[0]:
            best = cost, planes, other
    if best is None or best[0] > 1.0:
        return False
    one.trim(best[1])
    two.trim(best[2])
    return True
