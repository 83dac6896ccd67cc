"""Free range: how far every joint goes beyond what was photographed before its part meets another.

Two photographed states are two places on a joint's way; a door opens farther than it happened to
stand. From either state outward the part's true surface is moved until it meets another one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.model.arrays import F64, Mask
from part2gs_robotics.model.kinematics import moving_parts, part_transforms, subtree
from part2gs_robotics.model.solids import FLAKE, simpler, size_of, thickness, to_manifold
from part2gs_robotics.model.twin import Twin

if TYPE_CHECKING:
    from manifold3d import Manifold

COARSE = 1e-4  # of the size: parts are compared as simple as that; a third of what contact is
CONTACT = 3e-4  # of the size: overlap as thick in the mean; the deepest point lies twice as deep
DEEP = 0.0015  # of the size, of the deepest point: checks let 0.002 pass, and look elsewhere too
TURN_BACK, SLIDE_BACK = np.deg2rad(0.5), 1e-3  # rad, of the size: room for collision pieces' gap
TURN_STEP = np.deg2rad(2.0)  # a point at half a diagonal moves 1.7 % of it: no wall is missed
SLIDE_STEP = 0.01  # of the size, likewise
REFINED = 6  # halvings of the step that met something: 0.03 deg, 0.02 % of the size
DEEPER = np.deg2rad(0.5)  # beyond the stop, to see how fast the overlap grows: a quarter of a step
MOST_BACK = np.deg2rad(4.0)  # CONTACT at a radius of 1 % of the size, less than a thick door's
MOST_TURN = np.pi  # rad of a whole range: what nothing stops is not known to turn farther
PLACES = 9  # of a range, in combinations of two joints: 20 degrees apart at most
INSIDE = 0.2  # of a slide's length stays within what carries it: farther it falls out

Range = tuple[float, float]


def with_free_ranges(twin: Twin) -> Twin:
    """Return the twin with the contact-free range of every joint as its limits, marked derived.

    The range covers both observed states. Below the lower one the other parts stand as in state 0
    and as in state 1, where the part is free there; likewise above the upper one. Where two parts
    would meet both are held back, unless they do so between the states: then one waits for the
    other.

    Args:
        twin: with closed meshes, in one frame.
    """
    sweep = _Sweep(twin, size_of(tuple(p.mesh for p in twin.parts)))
    limits = {index: sweep.range_of(index) for index in moving_parts(twin)}
    for one, two in combinations(limits, 2):
        limits |= sweep.agreed(one, two, limits)
    parts = list(twin.parts)
    for index, found in limits.items():
        parts[index] = replace(parts[index], limits=found, limits_source="derived")
    return replace(twin, parts=tuple(parts))


@dataclass(frozen=True)
class _Reach:
    """How far a joint goes beyond one of its states, and whether something stopped it there."""

    way: float
    stopped: bool


class _Sweep:
    """Parts as solids, moved by one joint at a time."""

    def __init__(self, twin: Twin, size: float) -> None:
        self.twin, self.size = twin, size
        self.solids = [simpler(to_manifold(part.mesh), COARSE * size) for part in twin.parts]
        self.moving = moving_parts(twin)
        joints = [twin.parts[i].joint for i in self.moving]
        self.observed = [0.0 if joint is None else joint.value for joint in joints]

    def range_of(self, index: int) -> tuple[float, float]:
        """Return the limits of a part's joint."""
        joint = self.twin.parts[index].joint
        assert joint is not None  # moving parts have one
        ends = min(0.0, joint.value), max(0.0, joint.value)
        most = MOST_TURN if joint.turns else float("inf")
        spare = max(most - (ends[1] - ends[0]), 0.0)
        below, above = (self._reach(index, end, sign, spare)
                        for end, sign in zip(ends, (-1.0, 1.0), strict=True))
        down, up = _shared(below, above, spare)
        return ends[0] - down, ends[1] + up

    def agreed(self, one: int, two: int, limits: dict[int, Range]) -> dict[int, Range]:
        """Return the ranges of two joints within which their parts never meet."""
        carried = set(subtree(self.twin, one)), set(subtree(self.twin, two))
        if carried[0] & carried[1]:  # one stands on the other: one joint tells all
            return {}
        first, second = (_values(limits[i], self._ends(i)) for i in (one, two))
        met = np.array([[self._clash(one, two, p, q, carried) for q in second] for p in first])
        seen = [_within(v, self._ends(i)) for v, i in ((first, one), (second, two))]
        if met[np.ix_(*seen)].any():
            return {}
        # What meets another's observed motion is to blame; of two beyond theirs, both are.
        first_bad = np.asarray(met[:, seen[1]].any(1), bool)
        second_bad = np.asarray(met[seen[0]].any(0), bool)
        rest = met & ~(first_bad[:, None] | second_bad)
        return {one: _short_of(first, first_bad | rest.any(1), self._ends(one)),
                two: _short_of(second, second_bad | rest.any(0), self._ends(two))}

    def _ends(self, index: int) -> Range:
        value = self.observed[self.moving.index(index)]
        return min(0.0, value), max(0.0, value)

    def _clash(self, one: int, two: int, p: float, q: float,
               carried: tuple[set[int], set[int]]) -> bool:
        positions = [0.0] * len(self.moving)
        positions[self.moving.index(one)], positions[self.moving.index(two)] = p, q
        placed = part_transforms(self.twin, positions)
        moved = {i: self.solids[i].transform(placed[i][:3]) for i in carried[0] | carried[1]}
        common = (moved[a] ^ moved[b] for a in carried[0] for b in carried[1])
        # Films that noise left between them stop neither: as thick as CONTACT, and hardly deeper.
        return any(thickness(both) > FLAKE * self.size and depth(both) > DEEP * self.size
                   for both in common)

    def _touch(self, both: Manifold) -> bool:
        """Return whether an intersection is as thick, or as deep and no flake, as what touches."""
        thick = thickness(both)
        return thick > CONTACT * self.size or (
            thick > FLAKE * self.size and depth(both) > DEEP * self.size)

    def _reach(self, index: int, start: float, sign: float, most: float) -> _Reach:
        """Return how far a joint goes from a state, up or down, at most so far."""
        joint = self.twin.parts[index].joint
        assert joint is not None
        step = TURN_STEP if joint.turns else SLIDE_STEP * self.size
        limit = most if joint.turns else self._held(index, start, sign)
        rests = [rest for rest in ([0.0] * len(self.moving), self.observed)
                 if self._overlap(index, start, rest) <= CONTACT * self.size]
        if not rests:  # it touches where it was seen: nothing is known beyond
            return _Reach(0.0, True)
        way = 0.0
        while way < limit:
            new = min(way + step, limit)
            if self._meets(index, start + sign * new, rests):
                far = self._refined(index, (start, sign), (way, new), rests)
                if joint.turns:
                    far = self._touched(index, (start, sign), far, rests)
                back = TURN_BACK if joint.turns else SLIDE_BACK * self.size
                return _Reach(max(far - back, 0.0), True)
            way = new
        return _Reach(limit, not joint.turns)

    def _refined(self, index: int, ray: tuple[float, float], between: tuple[float, float],
                 rests: list[list[float]]) -> float:
        """Return the farthest way along a ray (start, sign) without contact, by halving."""
        (start, sign), (free, met) = ray, between
        for _ in range(REFINED):
            middle = 0.5 * (free + met)
            if self._meets(index, start + sign * middle, rests):
                met = middle
            else:
                free = middle
        return free

    def _touched(self, index: int, ray: tuple[float, float], far: float,
                 rests: list[list[float]]) -> float:
        """Return where a turning part touches what it is CONTACT deep in at `far`.

        Near its axis a part turns far until it is as deep: a thick edge beside the hinge. The
        overlap of two faces that meet grows in proportion to the angle, so the line through two of
        them leads back to the touch. One that grows slower is a rub, which began at no one angle.
        """
        start, sign = ray
        near, deep = (max(self._overlap(index, start + sign * (far + more), rest)
                          for rest in rests) for more in (0.0, DEEPER))
        growth = deep - near
        back = near * DEEPER / growth if growth > 0 else np.inf
        return max(far - back, 0.0) if back <= MOST_BACK else far

    def _meets(self, index: int, q: float, rests: list[list[float]]) -> bool:
        return any(self._touch(both) for rest in rests for both in self._common(index, q, rest))

    def _overlap(self, index: int, q: float, rest: list[float]) -> float:
        """Return how thick the overlap of what a joint moves and all else is, scene units."""
        return max(map(thickness, self._common(index, q, rest)), default=0.0)

    def _common(self, index: int, q: float, rest: list[float]) -> Iterator[Manifold]:
        """Yield the intersections of what a joint moves with all else."""
        positions = list(rest)
        positions[self.moving.index(index)] = q
        placed = part_transforms(self.twin, positions)
        moved = set(subtree(self.twin, index))
        solids = [solid.transform(place[:3])
                  for solid, place in zip(self.solids, placed, strict=True)]
        for a in moved:
            for b in set(range(len(solids))) - moved:
                yield solids[a] ^ solids[b]

    def _held(self, index: int, start: float, sign: float) -> float:
        """Return how far a slide goes until INSIDE of its length is left within its carrier."""
        part = self.twin.parts[index]
        assert part.joint is not None
        axis = sign * part.joint.axis
        own, around = (self.twin.parts[i].mesh.vertices @ axis for i in (index, part.parent))
        length = float(np.ptp(own))
        ahead = float(own.min()) + sign * start
        return max(float(around.max()) - INSIDE * length - ahead, 0.0)


def _values(limits: Range, ends: Range) -> F64:
    """Return places on a joint's way at which combinations are tried."""
    return np.unique([*np.linspace(*limits, PLACES), *ends])


def _within(values: F64, ends: Range) -> Mask:
    return (values >= ends[0]) & (values <= ends[1])


def _short_of(values: F64, bad: Mask, ends: Range) -> Range:
    """Return the range of values around the observed one up to the last ones that are not bad."""
    below, above = values[bad & (values < ends[0])], values[bad & (values > ends[1])]
    low, high = max(below, default=-np.inf), min(above, default=np.inf)
    free = values[(values > low) & (values < high)]
    return float(free.min()), float(free.max())


def _shared(below: _Reach, above: _Reach, spare: float) -> tuple[float, float]:
    """Return both ways, together at most `spare`, but as far as two stops that were found."""
    if below.way + above.way <= spare or (below.stopped and above.stopped):
        return below.way, above.way
    if below.stopped != above.stopped:
        down = below.way if below.stopped else spare - above.way
        return max(down, 0.0), max(spare - max(down, 0.0), 0.0)
    share = spare / (below.way + above.way)  # neither is known
    return share * below.way, share * above.way
