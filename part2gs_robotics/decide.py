"""Decision: how many parts move, judged by surfels and by images of both states together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics import se3
from part2gs_robotics.cross_render import both_cost
from part2gs_robotics.labelling import Unary, label, unary_costs
from part2gs_robotics.landing import unclaimed
from part2gs_robotics.motion_refine import refine
from part2gs_robotics.motion_search import Hypothesis
from part2gs_robotics.study import Study

F64 = NDArray[np.float64]
PART_PRICE = 0.003  # of cost per object pixel plus cost per surfel: what one more part must save
PART_SHARE = 0.015  # of the cost left: what noise saves grows with it
SLOW = 0.05  # of the diagonal: bent depth looks like parts that move less (seen: 4.3 %)
SLOW_SHARE = 0.027  # of the cost left, with such a part: the bend of a bin saved 2.0 to 2.3 %
AGAINST = 0.01  # of a cost: less is noise of the labelling; a bin's false lid landed 1.8 % worse
DOUBT = 0.5  # of the price: what saves this much is tuned before it is turned down
INCOHERENT = 0.05  # while parts are missing one motion must hide the others' surfels as well
TUNE_ROUNDS = 3  # the third seldom changes anything
TUNE_ANGLE = np.deg2rad(12.0)  # rad; drawers of one cabinet run parallel
TUNE_STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal
MIN_SURFELS = 25  # in either state: less is the size of a floater
MIN_MET = 0.5  # of the poorer state's surfels: a wrong motion that hides them meets fewer
SORTED = 10  # sets per step, the best by a rough labelling, that are labelled to the end
SHOWN = 5  # sets per step that are rendered


@dataclass(frozen=True)
class Verdict:
    """A set of motions with its labelling.

    Attributes:
        motions: K motions.  hard: [N0 + N1] surfel labels, 0 = static.
        surfel_cost: labelling energy per surfel.
        image_cost: cross-rendering cost per object pixel.
        coherent: whether every motion carries its own surfels of one state onto those of the other.
    """

    motions: tuple[Hypothesis, ...]
    hard: NDArray[np.int64]
    surfel_cost: float
    image_cost: float
    coherent: bool = True

    @property
    def cost(self) -> float:
        """Cost without the price of the parts; dearer with a part that is not one body."""
        return self.surfel_cost + self.image_cost + (0.0 if self.coherent else INCOHERENT)

    def improves(self, other: Verdict) -> bool:
        """Return whether this set costs less and neither surfels nor images speak against it.

        A false part can show the photos what one state never saw, such as the inside of a lid, by
        moving something else there; then surfels land worse. A true part helps both.
        """
        return (self.surfel_cost + self.image_cost < other.surfel_cost + other.image_cost
                and self.surfel_cost < (1 + AGAINST) * other.surfel_cost
                and self.image_cost < (1 + AGAINST) * other.image_cost)


class Judge:
    """Scores sets of motions; landing costs of a motion are computed once."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.lands = unclaimed(study.lands[0]), unclaimed(study.lands[1])
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

    def sort_out(self, motions: list[Hypothesis], rough: bool = False,
                 ) -> tuple[NDArray[np.int64], float]:
        """Return the labelling of the surfels under the motions and its cost per surfel."""
        hard, energy = label(self._unary(motions), self.study.graph, rough)
        return hard, energy / len(hard)

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
        rough = sorted(((self.sort_out(s, rough=True)[1], n) for n, s in enumerate(sets)))
        ranked = sorted(((self.sort_out(sets[n]), sets[n]) for _, n in rough[:SORTED]),
                        key=lambda pair: pair[0][1])
        return min((self.judge(s, known) for known, s in ranked[:SHOWN]),
                   key=lambda v: (above is not None and not v.improves(above), v.cost))

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
        )
        coherent = bool((self.met(motions, hard) >= MIN_MET).all())
        return Verdict(tuple(motions), hard, surfel_cost, image, coherent)

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
            trial[k] = refine(h, own, self.lands, self.study.taus, 4)
            new = self.judge(trial)
            if new.cost < best.cost:
                best, motions = new, trial
        return best


def decide(
    study: Study, pool: list[Hypothesis], parts: int | None, say: Callable[[str], None],
    swap: bool = True,
) -> Verdict:
    """Return the set of motions that pays: grown one by one, earlier ones replaceable.

    Args:
        study: both states.
        pool: hypotheses.
        parts: number of moving parts if known; then the price is not asked.
        say: told every step.
        swap: whether earlier motions are replaceable.
    """
    judge = Judge(study)
    best = solid = judge.judge([])
    say(f"nothing moves: cost {best.cost:.3f}")
    while pool and (parts is None or len(best.motions) < parts):
        grown = judge.polished(judge.best_of([[*best.motions, h] for h in pool], best))
        grown = _swap(judge, grown, pool) if swap and len(grown.motions) > 1 else grown
        price = 0.0 if parts is not None else judge.price(grown, best.cost)
        if price > best.cost - grown.cost > DOUBT * price and grown.coherent:
            # A drawer with nearly its length saves part of what it will: judge it at its best.
            grown = tune(judge, grown, say)
        gain = best.cost - grown.cost
        say(f"{len(grown.motions)} parts: cost {grown.cost:.4f}, {gain:.4f} less; "
            f"price {price:.4f}")
        if parts is None and (gain < price or not grown.improves(best)):
            say("surfels or images speak against it" if gain >= price else "not worth it")
            break
        best, solid = grown, grown if grown.coherent else solid
    if not best.coherent:
        bodies = judge.bodies(best)
        solid = min(solid, bodies, key=lambda v: v.cost)
        say(f"only {len(solid.motions)} of {len(best.motions)} parts are bodies of their own")
    return tune(judge, solid, say)


def _swap(judge: Judge, verdict: Verdict, pool: list[Hypothesis]) -> Verdict:
    """Return the verdict after one earlier motion is replaced, if that helps."""
    best = verdict
    for k in range(len(verdict.motions) - 1):
        rest = [h for j, h in enumerate(verdict.motions) if j != k]
        trial = judge.best_of([[*rest, h] for h in pool])
        if trial.cost < best.cost - 1e-3:
            best = trial
    return best if best is verdict else judge.polished(best)


def tune(judge: Judge, verdict: Verdict, say: Callable[[str], None]) -> Verdict:
    """Return the verdict after every slide tried other lengths and its neighbours' directions.

    Look-alike drawers share surfels while their lengths are wrong, and the lengths stay wrong
    while they share surfels: both are changed together. One moving part needs none of this.
    """
    best = verdict
    for _ in range(TUNE_ROUNDS if len(verdict.motions) > 1 else 0):
        before = best.cost
        for k in range(len(best.motions)):
            sets = [
                [*best.motions[:k], h, *best.motions[k + 1 :]]
                for h in _variants(best.motions, k, judge.study.diag)
            ]
            trial = judge.best_of(sets) if sets else best
            best = trial if trial.cost < best.cost else best
        say(f"tuned: cost {best.cost:.4f}, {before - best.cost:.4f} less")
        if before - best.cost < 1e-4:  # a tenth of what one wrong surfel in a thousand costs
            break
    return best


def _variants(motions: tuple[Hypothesis, ...], k: int, diag: float) -> list[Hypothesis]:
    own = motions[k]
    if own.kind:
        return []
    axes = [own.axis]
    for other in motions:
        cosine = float(other.axis @ own.axis)
        if other is not own and not other.kind and abs(cosine) > np.cos(TUNE_ANGLE):
            axis = other.axis * np.sign(cosine)
            if all(float(axis @ known) < 1 - 1e-9 for known in axes):  # parallel ones are one try
                axes.append(axis)
    return [
        replace(own, axis=axis, value=own.value + float(step) * diag)
        for axis in axes
        for step in TUNE_STEPS
    ]
