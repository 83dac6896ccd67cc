"""Judge: what a set of motions leaves unexplained in surfels and in images of both states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from part2gs_robotics.decide.candidate import INCOHERENT, Candidate, Scores
from part2gs_robotics.decide.labelling import STARTS, Unary, label, roughly, unary_costs
from part2gs_robotics.decide.made_joints import askew, crooked, square
from part2gs_robotics.evidence.cross_render import both_cost
from part2gs_robotics.evidence.landing import unclaimed
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfels import Surfels, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.refine import refine

PART_PRICE = 0.003  # of cost per object pixel plus cost per surfel: what one more part must save
PART_SHARE = 0.015  # of the cost left: what noise saves grows with it
SLOW = 0.05  # of the diagonal: bent depth looks like parts that move less (seen: 4.3 %)
SLOW_SHARE = 0.027  # of the cost left, with such a part: bent depth saved 2.0 to 2.3 %
MIN_SURFELS = 25  # in either state: less is the size of a floater
NEAR = 0.05  # of the diagonal: hinges of eleven scenes pass their parts by 0.036 at most
SORTED = 10  # sets per step, the best by a rough labelling, that are labelled to the end
SHOWN = 5  # sets per step that are rendered


def arm_of(h: Joint, own: tuple[Surfels, Surfels]) -> float:
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
        self._columns: dict[int, tuple[Joint, Unary]] = {}
        self.static = unary_costs([np.eye(4)], study.surfels, self.lands, study.tau)

    def _column(self, h: Joint) -> Unary:
        if id(h) not in self._columns:  # the hypothesis is kept beside, so its id stays its own
            self._columns[id(h)] = (
                h,
                unary_costs([h.move], self.study.surfels, self.lands, self.study.tau),
            )
        return self._columns[id(h)][1]

    def met(self, motions: Sequence[Joint], hard: Labels) -> F64:
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

    def shared(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [K] what share of its richer state's surfels every motion lands on its own."""
        zero, one = (np.bincount(part, minlength=len(motions) + 1)[1:] for part in
                     np.split(hard, [len(self.study.surfels[0])]))
        least, most = np.minimum(zero, one), np.maximum(zero, one)
        return self.met(motions, hard) * least / np.maximum(most, 1)

    def sort_out(self, motions: Sequence[Joint], starts: tuple[float, ...] = STARTS,
                 ) -> tuple[Labels, float]:
        """Return the labelling of the surfels under the motions and its cost per surfel."""
        unary = self._unary(motions)
        hard, energy = label(unary, self.study.graph, unary.resting, starts)
        return hard, energy / len(hard)

    def _roughly(self, motions: Sequence[Joint]) -> tuple[float, float]:
        """Return what a set costs by a rough labelling, and the start of it that was better."""
        unary = self._unary(motions)
        hard, energy, start = roughly(unary, self.study.graph, unary.resting)
        return self._likely(motions, (hard, energy / len(hard))), start

    def costs(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [N0 + N1] what every surfel's landing costs under its label."""
        cost = self._unary(motions).cost(np.eye(len(motions) + 1)[hard])
        return np.asarray(cost[np.arange(len(hard)), hard])

    def _unary(self, motions: Sequence[Joint]) -> Unary:
        columns = [self.static, *(self._column(h) for h in motions)]
        return Unary(
            np.concatenate([c.match for c in columns], 1),
            np.concatenate([c.target for c in columns], 1),
            np.concatenate([c.miss for c in columns], 1),
        )

    def best_of(self, sets: Sequence[Candidate], above: Candidate | None = None) -> Candidate:
        """Return the best of several candidates; the images see only the best by surfels.

        Args:
            sets: candidates, not judged yet.
            above: candidates that improve this one come before those that do not.
        """
        for motion in {id(h): h for s in sets for h in s.motions}.values():
            self._column(motion)  # before several threads ask for it
        rough = side_by_side([partial(self._roughly, s.motions) for s in sets])
        order = sorted(range(len(sets)), key=lambda n: (rough[n][0], n))[:SORTED]
        few = [sets[n] for n in order]
        # From the start that was better roughly: to ask again would take a third of the time.
        found = side_by_side([partial(self.sort_out, sets[n].motions, (rough[n][1],))
                              for n in order])
        ranked = sorted(zip(found, few, strict=True),
                        key=lambda pair: self._likely(pair[1].motions, pair[0]))[:SHOWN]
        shown = side_by_side([partial(self.judge, s, known) for known, s in ranked])
        return min(shown, key=lambda c: (above is not None and not c.improves(above), c.cost))

    def _likely(self, motions: Sequence[Joint], known: tuple[Labels, float]) -> float:
        """Return what a set costs before images see it: a few dozen sets must be sorted fast."""
        return known[1] + INCOHERENT * float(self.leans(motions, known[0]).max(initial=0.0))

    def judge(self, found: Candidate, known: tuple[Labels, float] | None = None) -> Candidate:
        """Return the candidate with labels and scores; `known` is what `sort_out` said."""
        motions = found.motions
        hard, surfels = known or self.sort_out(motions)
        images = both_cost(
            self.study.gaussians,
            self.study.gaussian_labels(hard),
            [np.eye(4), *(h.move for h in motions)],
            self.study.views,
            self.study.source_weight,
            self.study.light,
        )
        met = float(self.met(motions, hard).min(initial=1.0))
        leans = float(self.leans(motions, hard).max(initial=0.0))
        scores = Scores(surfels, images, met, self.air(motions, hard), leans)
        return replace(found, labels=hard, judged=scores)

    def leans(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [K] how surely every motion is one that no made thing's joint makes, 0..1."""
        return np.array([max(askew(h, self._normals[hard == k + 1]), crooked(h, self._square))
                         for k, h in enumerate(motions)])

    def air(self, motions: Sequence[Joint], hard: Labels) -> float:
        """Return the largest of what Scores.air says of every turn."""
        gaps = [arm_of(h, self.study.own(hard, k + 1)) / self.study.diag
                for k, h in enumerate(motions) if h.turns]
        return max((min(max(gap / NEAR - 1.0, 0.0), 1.0) for gap in gaps if gap < np.inf),
                   default=0.0)

    def bodies(self, found: Candidate) -> Candidate:
        """Return the candidate without motions that carry no body of their own, worst first."""
        while not found.coherent:
            worst = int(self.met(found.motions, found.labels).argmin())
            found = self.polished(self.judge(found.without(worst)))
        return found

    def price(self, grown: Candidate, left: float) -> float:
        """Return what one more part must save of the cost left: more if a part hardly moves."""
        ways = [self.way(grown, k) for k in range(len(grown))]
        slow = min((w for w in ways if w is not None), default=0.0) < SLOW * self.study.diag
        return max(PART_PRICE, (SLOW_SHARE if slow else PART_SHARE) * left)

    def way(self, found: Candidate, k: int) -> float | None:
        """Return how far motion k moves its surfels on average, scene units; None without any."""
        points = np.concatenate([s.points for s in self.study.surfels])[found.labels == k + 1]
        gaps = se3.apply(found.motions[k].move, points) - points
        return float(np.linalg.norm(gaps, axis=1).mean()) if len(points) else None

    def confidence(self, found: Candidate, k: int) -> float:
        """Return the share of motion k's surfels that no other label explains as well."""
        columns = [self.static, *(self._column(h) for h in found.motions)]
        own = found.labels == k + 1
        costs = np.stack([c.cost(np.ones((len(own), 1)))[own, 0] for c in columns], 1)
        rest = np.delete(costs, k + 1, 1).min(1)
        return (
            float((costs[:, k + 1] < rest - 0.05).mean()) if own.any() else 0.0
        )  # 0.05: a colour step

    def polished(self, found: Candidate) -> Candidate:
        """Return the candidate with motions refined on their own surfels where that helps."""
        best = found
        for k, h in enumerate(found.motions):
            own = self.study.own(best.labels, k + 1)
            new = self.judge(best.swapped(k, refine(h, own, self.lands, self.study.taus)))
            if new.cost < best.cost:
                best = new
        return best
