"""Judge: what a set of motions leaves unexplained in surfels and in images of both states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.decide.cross_render import both_cost
from part2gs_robotics.decide.labelling import STARTS, Unary, label, roughly, unary_costs
from part2gs_robotics.decide.made_joints import askew, crooked, square
from part2gs_robotics.decide.pieces import at_home
from part2gs_robotics.evidence.landing import unclaimed
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.hypothesis import Hypothesis
from part2gs_robotics.search.refine import refine

PART_PRICE = 0.003  # of cost per object pixel plus cost per surfel: what one more part must save
PART_SHARE = 0.015  # of the cost left: what noise saves grows with it
SLOW = 0.05  # of the diagonal: bent depth looks like parts that move less (seen: 4.3 %)
SLOW_SHARE = 0.027  # of the cost left, with such a part: the bend of a bin saved 2.0 to 2.3 %
AGAINST = 0.01  # of a cost: less is noise of the labelling; a bin's false lid landed 1.8 % worse
WHOLER = 0.03  # of the image cost, where bodies become whole: a third drawer's was 1.7 % worse
MORE_MET = 0.1  # of the surfels of the part that meets least: that drawer's front raised it by 0.34
INCOHERENT = 0.05  # while parts are missing one motion must hide the others' surfels as well
MIN_SURFELS = 25  # in either state: less is the size of a floater
# Of the poorer state's surfels, as many meet their own kind under a motion that is surely right,
# one that may be, and one that only hides them: two drawers under one slide met 0.22 to 0.4.
ALL_MET, MIN_MET, NONE_MET = 0.5, 0.35, 0.25
PLAIN_ASKEW = 0.5  # halfway from the worst true drawer to a diagonal between two
NEAR = 0.05  # of the diagonal: hinges of eleven scenes pass their parts by 0.036 at most
SORTED = 10  # sets per step, the best by a rough labelling, that are labelled to the end
SHOWN = 5  # sets per step that are rendered


@dataclass(frozen=True)
class Verdict:
    """A set of motions with its labelling.

    Attributes:
        motions: K motions.  hard: [N0 + N1] surfel labels, 0 = static.
        surfel_cost: labelling energy per surfel.
        image_cost: cross-rendering cost per object pixel.
        met: of the motion that does so least, the share of its own surfels of one state that it
            carries onto those of the other.
        air: 0..1, how far the line of a turn passes its part, 1 = surely no hinge.
        askew: 0..1, the most that a motion leaves walls and edges, 1 = surely no joint's.
        short: whether one more motion would pay though their number was given.
        pool: the motions that were to choose from, for parts that do not stay.
    """

    motions: tuple[Hypothesis, ...]
    hard: NDArray[np.int64]
    surfel_cost: float
    image_cost: float
    met: float = 1.0
    air: float = 0.0
    askew: float = 0.0
    short: bool = False
    pool: tuple[Hypothesis, ...] = ()

    @property
    def coherent(self) -> bool:
        """Whether every motion carries a body of its own."""
        return self.met >= MIN_MET

    @property
    def cost(self) -> float:
        """Cost without the price of the parts; dearer with a part that no made thing has.

        That is one which is hardly one body, turns about a line in the air or slides askew.
        """
        torn = (ALL_MET - self.met) / (ALL_MET - NONE_MET)
        strange = min(max(torn, 0.0), 1.0) + self.air + self.askew
        return self.surfel_cost + self.image_cost + INCOHERENT * strange

    def improves(self, other: Verdict) -> bool:
        """Return whether this set costs less and neither surfels nor images speak against it.

        A false part can show the photos what one state never saw, such as the inside of a lid, by
        moving something else there; then surfels land worse. A true part helps both. Bodies need
        only cost less than what is none: that can hide the surfels of two parts rather well; so can
        a slide askew. Where one motion that met few becomes two that meet theirs, images may speak
        against it a little.
        """
        if (self.coherent and not other.coherent) or self.askew < PLAIN_ASKEW <= other.askew:
            return self.cost < other.cost
        images = WHOLER if self.met > other.met + MORE_MET else AGAINST
        return (self.surfel_cost + self.image_cost < other.surfel_cost + other.image_cost
                and self.surfel_cost < (1 + AGAINST) * other.surfel_cost
                and self.image_cost < (1 + images) * other.image_cost)


def arm_of(h: Hypothesis, own: tuple[Surfels, Surfels]) -> float:
    """Return how far the line of a turn passes its part, scene units; infinite without any part."""
    gaps = np.linalg.norm(np.cross(at_home(h, own) - h.origin, h.axis), axis=1)
    return float(gaps.min(initial=np.inf))


class Judge:
    """Scores sets of motions; landing costs of a motion are computed once."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.lands = unclaimed(study.lands[0]), unclaimed(study.lands[1])
        self._normals = np.concatenate([s.normals for s in study.surfels])
        self._square = square(study.straight.directions)
        self._columns: dict[int, tuple[Hypothesis, Unary]] = {}
        self.static = unary_costs([np.eye(4)], study.surfels, self.lands, study.tau)

    def _column(self, h: Hypothesis) -> Unary:
        if id(h) not in self._columns:  # the hypothesis is kept beside, so its id stays its own
            self._columns[id(h)] = (
                h,
                unary_costs([h.move], self.study.surfels, self.lands, self.study.tau),
            )
        return self._columns[id(h)][1]

    def met(self, motions: Sequence[Hypothesis], hard: NDArray[np.int64]) -> F64:
        """Return [K] what share of its poorer state every motion carries onto its richer one."""
        n0, shares = len(self.study.surfels[0]), np.zeros(len(motions))
        for k, h in enumerate(motions):
            own = np.flatnonzero(hard == k + 1)
            zero, one = own[own < n0], own[own >= n0]
            poorer = zero if len(zero) < len(one) else one
            target = self._column(h).target[poorer, 0]
            if len(poorer) >= MIN_SURFELS:
                shares[k] = ((target >= 0) & (hard[np.maximum(target, 0)] == k + 1)).mean()
        return shares

    def shared(self, motions: Sequence[Hypothesis], hard: NDArray[np.int64]) -> F64:
        """Return [K] what share of its richer state's surfels every motion lands on its own."""
        zero, one = (np.bincount(part, minlength=len(motions) + 1)[1:] for part in
                     np.split(hard, [len(self.study.surfels[0])]))
        least, most = np.minimum(zero, one), np.maximum(zero, one)
        return self.met(motions, hard) * least / np.maximum(most, 1)

    def sort_out(self, motions: list[Hypothesis], starts: tuple[float, ...] = STARTS,
                 ) -> tuple[NDArray[np.int64], float]:
        """Return the labelling of the surfels under the motions and its cost per surfel."""
        unary = self._unary(motions)
        hard, energy = label(unary, self.study.graph, unary.resting, starts)
        return hard, energy / len(hard)

    def _roughly(self, motions: list[Hypothesis]) -> tuple[float, float]:
        """Return what a set costs by a rough labelling, and the start of it that was better."""
        unary = self._unary(motions)
        hard, energy, start = roughly(unary, self.study.graph, unary.resting)
        return self._likely(motions, (hard, energy / len(hard))), start

    def costs(self, motions: list[Hypothesis], hard: NDArray[np.int64]) -> F64:
        """Return [N0 + N1] what every surfel's landing costs under its label."""
        cost = self._unary(motions).cost(np.eye(len(motions) + 1)[hard])
        return np.asarray(cost[np.arange(len(hard)), hard])

    def _unary(self, motions: list[Hypothesis]) -> Unary:
        columns = [self.static, *(self._column(h) for h in motions)]
        return Unary(
            np.concatenate([c.match for c in columns], 1),
            np.concatenate([c.target for c in columns], 1),
            np.concatenate([c.miss for c in columns], 1),
        )

    def best_of(self, sets: list[list[Hypothesis]], above: Verdict | None = None) -> Verdict:
        """Return the best of several sets; the images see only the best by surfels.

        Args:
            sets: of motions.
            above: sets that improve this verdict come before those that do not.
        """
        for motion in {id(h): h for s in sets for h in s}.values():
            self._column(motion)  # before several threads ask for it
        rough = side_by_side([partial(self._roughly, s) for s in sets])
        order = sorted(range(len(sets)), key=lambda n: (rough[n][0], n))[:SORTED]
        few = [sets[n] for n in order]
        # From the start that was better roughly: to ask again would take a third of the time.
        found = side_by_side([partial(self.sort_out, sets[n], (rough[n][1],)) for n in order])
        ranked = sorted(zip(found, few, strict=True),
                        key=lambda pair: self._likely(pair[1], pair[0]))[:SHOWN]
        shown = side_by_side([partial(self.judge, s, known) for known, s in ranked])
        return min(shown, key=lambda v: (above is not None and not v.improves(above), v.cost))

    def _likely(self, motions: list[Hypothesis], known: tuple[NDArray[np.int64], float]) -> float:
        """Return what a set costs before images see it: a few dozen sets must be sorted fast."""
        return known[1] + INCOHERENT * float(self.leans(motions, known[0]).max(initial=0.0))

    def judge(
        self, motions: list[Hypothesis], known: tuple[NDArray[np.int64], float] | None = None
    ) -> Verdict:
        """Return the verdict on a set of motions; `known` is what `sort_out` said."""
        hard, surfel_cost = known or self.sort_out(motions)
        labels = self.study.gaussian_labels(hard)
        image = both_cost(
            self.study.gaussians,
            labels,
            [np.eye(4), *(h.move for h in motions)],
            self.study.views,
            self.study.source_weight,
            self.study.light,
        )
        met = float(self.met(motions, hard).min(initial=1.0))
        leans = float(self.leans(motions, hard).max(initial=0.0))
        return Verdict(tuple(motions), hard, surfel_cost, image, met, self.air(motions, hard),
                       leans)

    def leans(self, motions: Sequence[Hypothesis], hard: NDArray[np.int64]) -> F64:
        """Return [K] how surely every motion is one that no made thing's joint makes, 0..1."""
        return np.array([max(askew(h, self._normals[hard == k + 1]), crooked(h, self._square))
                         for k, h in enumerate(motions)])

    def air(self, motions: Sequence[Hypothesis], hard: NDArray[np.int64]) -> float:
        """Return the largest of what Verdict.air says of every turn."""
        gaps = [arm_of(h, self.study.own(hard, k + 1)) / self.study.diag
                for k, h in enumerate(motions) if h.kind]
        return max((min(max(gap / NEAR - 1.0, 0.0), 1.0) for gap in gaps if gap < np.inf),
                   default=0.0)

    def bodies(self, verdict: Verdict) -> Verdict:
        """Return the verdict without motions that carry no body of their own, worst first."""
        while not verdict.coherent:
            worst = int(self.met(verdict.motions, verdict.hard).argmin())
            rest = [h for k, h in enumerate(verdict.motions) if k != worst]
            verdict = self.polished(self.judge(rest))
        return verdict

    def price(self, grown: Verdict, left: float) -> float:
        """Return what one more part must save of the cost left: more if a part hardly moves."""
        ways = [self.way(grown, k) for k in range(len(grown.motions))]
        slow = min((w for w in ways if w is not None), default=0.0) < SLOW * self.study.diag
        return max(PART_PRICE, (SLOW_SHARE if slow else PART_SHARE) * left)

    def way(self, verdict: Verdict, k: int) -> float | None:
        """Return how far motion k moves its surfels on average, scene units; None without any."""
        points = np.concatenate([s.points for s in self.study.surfels])[verdict.hard == k + 1]
        gaps = se3.apply(verdict.motions[k].move, points) - points
        return float(np.linalg.norm(gaps, axis=1).mean()) if len(points) else None

    def confidence(self, verdict: Verdict, k: int) -> float:
        """Return the share of motion k's surfels that no other label explains as well."""
        columns = [self.static, *(self._column(h) for h in verdict.motions)]
        own = verdict.hard == k + 1
        costs = np.stack([c.cost(np.ones((len(own), 1)))[own, 0] for c in columns], 1)
        rest = np.delete(costs, k + 1, 1).min(1)
        return (
            float((costs[:, k + 1] < rest - 0.05).mean()) if own.any() else 0.0
        )  # 0.05: a colour step

    def polished(self, verdict: Verdict) -> Verdict:
        """Return the verdict with motions refined on their own surfels where that helps."""
        motions = list(verdict.motions)
        best = verdict
        for k, h in enumerate(verdict.motions):
            own = self.study.own(best.hard, k + 1)
            trial = [*motions]
            trial[k] = refine(h, own, self.lands, self.study.taus)
            new = self.judge(trial)
            if new.cost < best.cost:
                best, motions = new, trial
        return best
