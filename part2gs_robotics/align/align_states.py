"""State 1 onto state 0 by what stayed: their visual hulls, laid over each other robustly.

No texture is asked for, and no background. What stayed has one surface in both states, so the hull
of one ends where that of the other does. What moved does not, and a robust cost that begins wide
and grows narrow (Black and Rangarajan 1996) leaves it out, be it half of the surface. Directions
that outlines do not tell, such as the turn of a round base, stay as they were.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.align.hull_field import HullField, edge_views, hull_field
from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.se3 import apply, inverse, make, rotation_from_rotvec, turn

MARGIN = 0.15  # of the box on every side: offsets as large as are looked for stay inside
REACHES = tuple(0.08 * 0.7**k for k in range(10))  # of the size: from wide to a quarter of a cell
ROUNDS = 4  # Gauss-Newton steps at each reach: the next changes nothing that can be measured
STARTS = 12  # beside rest: one wide start alone slid 5 % along where door and front lie parallel
SPREAD_DEG, SPREAD = 2.0, 0.02  # deviation of a start: what "slightly out of one frame" means
THIN = 4  # one point in so many for what starts far off: it ends in the same place, sooner
LAST = 7  # reach from which all points finish: 0.7 % of the size, half a cell of the grid
BEGIN = 3  # reach of a random start: a third of the widest, it stands nearer
KNOWN = 1e-3  # of the largest curvature: directions with less are not told by outlines
ON_EDGE = 0.003  # of the size, from an outline: a pixel of masks of 400 px
FEWEST_EDGES = 3  # outlines through a point: with fewer only two views' cones meet
MOST_TRUST = 6.0  # further outlines through a point: a corner counts no more than a short edge
STAYED = 0.006  # of the size: half a grid cell, three times the error of hulls of 20 photos
LEAST_STAYED = 0.3  # of the edges; half of a picture's moving leaves more, chance leaves a tenth
MOST_MOVED = 0.12  # of the size: a third more than the widest reach, beyond it nothing was tried
ALREADY = 0.006  # of the size: states in one frame were moved by 0.45 % at most, by hulls alone

States = tuple[StateViews, StateViews]


@dataclass(frozen=True)
class Aligned:
    """How state 1 is carried onto state 0.

    Attributes:
        zero_from_one: [4, 4] rotation and shift.
        moves: the most that it moves a point of the object, share of the object's size.
        stayed: share of both surfaces that agree afterwards.
        before, after: median distance of what stayed from the other state, share of the size.
        free: directions of six that outlines do not tell.
    """

    zero_from_one: F64
    moves: float
    stayed: float
    before: float
    after: float
    free: int


def on_what_stayed(states: States, box: tuple[F64, F64], where: str) -> tuple[StateViews, str]:
    """Return state 1 in the frame of state 0, and what was done in a sentence.

    Args:
        states: both, as read.
        box: corners [3] of a box that holds the object in both states.
        where: names the scene.

    Raises:
        SceneError: too little stayed, or the states are further apart than is looked for.
    """
    found = align_states(states, *box)
    if found.moves >= ALREADY:  # grids are finest where both lie alike in them: once more
        found = after(found, align_states((states[0], carried(states[1], found.zero_from_one)),
                                          *box, nearly=True), box)
    if found.stayed < LEAST_STAYED or found.moves > MOST_MOVED:
        raise SceneError(
            f"{where}: --align found no frame for both states: {found.stayed:.0%} of the edges "
            f"agree after a move of {found.moves:.1%} of the size. Expected at least "
            f"{LEAST_STAYED:.0%} that stayed, and states less than {MOST_MOVED:.0%} apart; "
            "register all photos of both states in one COLMAP run.")
    if found.moves < ALREADY:
        return states[1], (f"--align changed nothing: the states agree to {found.before:.2%} of "
                           "the size on what stayed (median).")
    degrees, told = np.degrees(turn(found.zero_from_one)), ""
    if found.free:
        told = f" {found.free} of 6 directions are told by no outline and stay as they were."
    return carried(states[1], found.zero_from_one), (
        f"State 1 was turned by {degrees:.2f} degrees and moved by up to {found.moves:.2%} of the "
        f"size onto state 0 (--align); what stayed lay {found.before:.2%} apart (median), now "
        f"{found.after:.2%}.{told}")


def carried(state: StateViews, new_from_old: F64) -> StateViews:
    """Return a state's cameras in another frame; photos, masks and depths stay."""
    return replace(state, viewmats=state.viewmats @ inverse(new_from_old))


def after(first: Aligned, second: Aligned, box: tuple[F64, F64]) -> Aligned:
    """Return two alignments one after the other."""
    move = second.zero_from_one @ first.zero_from_one
    return replace(second, zero_from_one=move, moves=_most(move, *box), before=first.before)


def align_states(states: States, low: F64, high: F64, nearly: bool = False) -> Aligned:
    """Return how state 1 lies to state 0 where both are nearly in one frame.

    Args:
        states: both, with masks.
        low: [3] corner of a box that holds the object in both states.
        high: [3] the opposite corner.
        nearly: they are in one frame but for a last bit: nothing far off is tried.
    """
    size, middle = float(np.linalg.norm(high - low)), (low + high) / 2
    edge = MARGIN * (high - low).max()
    fields = hull_field(states[0], low - edge, high + edge), hull_field(
        states[1], low - edge, high + edge)
    clouds = [_edges(state, field, size) for state, field in zip(states, fields, strict=True)]
    pair = _Pair(fields, (clouds[0][0], clouds[1][0]), np.concatenate([c[1] for c in clouds]),
                 middle, size / 2)
    move, free = _best(pair, [] if nearly else list(_starts(middle, size)))
    gaps, first = pair.gaps(move)[0], pair.gaps(np.eye(4))[0]
    near = np.abs(gaps) < STAYED * size
    medians = [float(np.median(np.abs(g[near]))) / size if near.any() else np.inf
               for g in (first, gaps)]
    return Aligned(move, _most(move, low, high), float(near.mean()), medians[0], medians[1], free)


def _best(pair: _Pair, starts: list[F64]) -> tuple[F64, int]:
    """Return the motion on which most agrees, and directions left untold, from rest and starts."""
    tries = [pair.settled(np.eye(4), LAST)[0], np.eye(4)]
    if starts:
        thin = pair.thinned()
        tries += [thin.settled(np.eye(4), begin)[0] for begin in (0, BEGIN)]
        tries += [thin.settled(start, BEGIN)[0] for start in starts]
    return pair.settled(max(tries, key=pair.agreement), LAST)


def _starts(middle: F64, size: float) -> Iterator[F64]:
    """Yield motions about a middle, small and of all directions."""
    rng = np.random.default_rng(0)
    for _ in range(STARTS):
        turned = rotation_from_rotvec(np.deg2rad(SPREAD_DEG) * rng.normal(size=3))
        yield make(turned, middle - turned @ middle + SPREAD * size * rng.normal(size=3))


def _most(move: F64, low: F64, high: F64) -> float:
    """Return how far a motion moves the corners of a box, at most, share of its diagonal."""
    corners = np.stack(np.meshgrid(*np.stack([low, high], 1), indexing="ij"), -1).reshape(-1, 3)
    off = np.linalg.norm(apply(move, corners) - corners, axis=1).max()
    return float(off / np.linalg.norm(high - low))


def _edges(state: StateViews, field: HullField, size: float) -> tuple[F64, F64]:
    """Return points [N, 3] where several outlines meet, and how far to trust each [N]."""
    points = field.surface()
    more = np.clip(edge_views(state, points, ON_EDGE * size) - FEWEST_EDGES + 1, 0, MOST_TRUST)
    return points[more > 0], more[more > 0].astype(float)


@dataclass(frozen=True)
class _Pair:
    """Both states' fields and surfaces; steps are taken about a middle, in units of a radius."""

    fields: tuple[HullField, HullField]
    surfaces: tuple[F64, F64]
    trust: F64
    middle: F64
    radius: float

    def gaps(self, move: F64) -> tuple[F64, F64]:
        """Return how far each surface is from the other, and how a small step changes that.

        Args:
            move: [4, 4] x_0 = move x_1.

        Returns:
            [N0 + N1] scene units, and [N0 + N1, 6] per radian and per radius.
        """
        first, second = self.surfaces
        back, moved = inverse(move), apply(move, second)
        zero, slope_one = self.fields[1].at(apply(back, first))
        one, slope_zero = self.fields[0].at(moved)
        slopes = np.concatenate([-slope_one @ back[:3, :3], slope_zero])
        away = np.concatenate([first, moved]) - self.middle
        steps = np.concatenate([np.cross(away, slopes), self.radius * slopes], axis=1)
        return np.concatenate([zero, one]), steps

    def thinned(self) -> _Pair:
        """Return the same with fewer points."""
        first, second = self.surfaces
        trust = np.concatenate([self.trust[:len(first)][::THIN], self.trust[len(first):][::THIN]])
        return replace(self, surfaces=(first[::THIN], second[::THIN]), trust=trust)

    def settled(self, move: F64, begin: int) -> tuple[F64, int]:
        """Return the motion after steps at ever narrower reaches, and directions left untold."""
        free = 0
        for reach in REACHES[begin:]:
            for _ in range(ROUNDS):
                move, free = self.improved(move, 2 * self.radius * reach)
        return move, free

    def agreement(self, move: F64) -> float:
        """Return how much of the edges lies on the other state's surface, by trust."""
        gaps = self.gaps(move)[0] / (2 * self.radius * REACHES[-1])
        return float((self.trust / (1 + gaps**2)).sum())

    def improved(self, move: F64, reach: float) -> tuple[F64, int]:
        """Return the motion after one robust Gauss-Newton step, and directions left untold."""
        gaps, steps = self.gaps(move)
        weight = self.trust * (reach**2 / (reach**2 + gaps**2)) ** 2  # Geman-McClure
        curve, lean = (steps * weight[:, None]).T @ steps, (steps * weight[:, None]).T @ gaps
        values, axes = np.linalg.eigh(curve)
        told = values > KNOWN * values[-1]
        step = -axes[:, told] @ ((axes[:, told].T @ lean) / values[told])
        turned = rotation_from_rotvec(step[:3])
        shift = self.middle - turned @ self.middle + self.radius * step[3:]
        return make(turned, shift) @ move, int((~told).sum())
