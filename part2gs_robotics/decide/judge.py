"""Judge: what a set of motions leaves unexplained in surfels and in images of both states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from part2gs_robotics.decide.candidate import PART, STRANGE, Candidate, Scores
from part2gs_robotics.decide.claim import STAYS, claim
from part2gs_robotics.decide.labelling import (
    STARTS,
    Unary,
    energy_of,
    label,
    roughly,
    unary_costs,
    vanished,
)
from part2gs_robotics.decide.made_joints import askew, crooked, square
from part2gs_robotics.evidence.cross_render import both_cost
from part2gs_robotics.evidence.landing import unclaimed
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.evidence.surfels import Surfels, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.refine import refine

UNEXPLAINED = 0.5  # landing cost: halfway from an unobserved place to one seen empty
MIN_SURFELS = 25  # in either state: less is the size of a floater
NEAR = 0.05  # of the diagonal: hinges of eleven scenes pass their parts by 0.036 at most
SORTED = 10  # sets per step, the best by a rough labelling, that are labelled to the end
# Of the image cost: other labels of the same motions saved 12 %, or cost less without images too.
TELLS = 0.25
SHOWN = 2  # sets per step, the best by surfels, whose labels are claimed and rendered


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
        self._judged: dict[tuple[object, ...], tuple[tuple[Joint, ...], Labels, Scores]] = {}
        self.static = unary_costs([np.eye(4)], study.surfels, self.lands, study.tau)

    def _column(self, h: Joint) -> Unary:
        if id(h) not in self._columns:  # the hypothesis is kept beside, so its id stays its own
            self._columns[id(h)] = (
                h,
                unary_costs([h.move], self.study.surfels, self.lands, self.study.tau),
            )
        return self._columns[id(h)][1]

    def sort_out(self, motions: Sequence[Joint], starts: tuple[float, ...] = STARTS,
                 ) -> tuple[Labels, float]:
        """Return the labelling of the surfels under the motions and its cost per surfel."""
        unary = self._unary(motions)
        rest = unary.resting
        hard, energy = label(unary, self.study.graph, rest, starts)
        return hard, (energy + vanished(rest, hard)) / len(hard)

    def _roughly(self, motions: Sequence[Joint]) -> tuple[float, float]:
        """Return what a set costs by a rough labelling, and the start of it that was better."""
        unary = self._unary(motions)
        rest = unary.resting
        hard, energy, start = roughly(unary, self.study.graph, rest)
        energy += vanished(rest, hard)
        return self._likely(motions, (hard, energy / len(hard))), start

    def costs(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [N0 + N1] what every surfel's landing costs under its label."""
        return self._unary(motions).own(hard)

    def _unary(self, motions: Sequence[Joint]) -> Unary:
        columns = [self.static, *(self._column(h) for h in motions)]
        return Unary(
            np.concatenate([c.match for c in columns], 1),
            np.concatenate([c.target for c in columns], 1),
            np.concatenate([c.miss for c in columns], 1),
        )

    def best_of(self, sets: Sequence[Candidate], shown: int = SHOWN) -> Candidate:
        """Return the best of several candidates; the images see only the best by surfels.

        Args:
            sets: candidates, not judged yet; one at least.
            shown: how many the images see.
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
                        key=lambda pair: self._likely(pair[1].motions, pair[0]))[:shown]
        judged = side_by_side([partial(self.judge, s, known[0]) for known, s in ranked])
        return min(judged, key=lambda c: c.cost)

    def _likely(self, motions: Sequence[Joint], known: tuple[Labels, float]) -> float:
        """Return what a set costs before images see it: a few dozen sets must be sorted fast."""
        return known[1] + STRANGE * self.strange(motions, known[0]) + PART * len(motions)

    def judge(self, found: Candidate, known: Labels | None = None) -> Candidate:
        """Return the candidate with labels and scores; `known` are labels to start from.

        A set is judged once: its motions are kept beside, so their ids stay their own.
        """
        key = (*map(id, found.motions), *found.parents)
        if key not in self._judged:
            hard = self.sort_out(found.motions)[0] if known is None else known
            tried = [hard]
            if found.motions:
                start = replace(found, labels=hard)
                tried.append(claim(self.study, self.lands, start, STAYS, sparing=True)[0])
            self._judged[key] = found.motions, *self.cheapest(found, tried)
        return replace(found, labels=self._judged[key][1], judged=self._judged[key][2])

    def cheapest(self, found: Candidate, tried: Sequence[Labels]) -> tuple[Labels, Scores]:
        """Return the labels of a set that cost least of those tried, and their scores."""
        first, *others = sorted(((self._unseen(found, hard), n) for n, hard in enumerate(tried)),
                                key=lambda pair: (pair[0].cost, pair[1]))
        best, number = self._seen(found, tried[first[1]], first[0]), first[1]
        for scores, n in others:
            if scores.cost + (1.0 - TELLS) * best.images < best.cost:
                new = self._seen(found, tried[n], scores)
                best, number = (new, n) if new.cost < best.cost else (best, number)
        return tried[number], best

    def scores(self, found: Candidate, hard: Labels) -> Scores:
        """Return what surfels and photos say of a set of motions under given labels."""
        return self._seen(found, hard, self._unseen(found, hard))

    def _unseen(self, found: Candidate, hard: Labels) -> Scores:
        """Return the scores of a set without its images."""
        motions, study = found.motions, self.study
        unary = self._unary(motions).resting
        surfels = (energy_of(unary, study.graph, hard) + vanished(unary, hard)) / len(hard)
        cut = study.bonds * (hard[:, None] != hard[study.graph.neighbors])
        carried = sum(parent > 0 for parent in found.parents)
        return Scores(surfels, 0.0, float(cut.sum(dtype=np.float64)) / len(hard),
                      self.strange(motions, hard), len(found) + carried)

    def _seen(self, found: Candidate, hard: Labels, unseen: Scores) -> Scores:
        """Return the scores of a set with its images."""
        study = self.study
        return replace(unseen, images=both_cost(
            study.gaussians, study.gaussian_labels(hard),
            [np.eye(4), *(h.move for h in found.motions)], study.views, study.source_weight,
            study.light))

    def strange(self, motions: Sequence[Joint], hard: Labels) -> float:
        """Return what `Scores.strange` says of all motions together."""
        return float((self.leans(motions, hard) + self.air(motions, hard)).sum())

    def leans(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [K] how surely every motion is one that no made thing's joint makes, 0..1."""
        return np.array([max(askew(h, self._normals[hard == k + 1]), crooked(h, self._square))
                         for k, h in enumerate(motions)])

    def air(self, motions: Sequence[Joint], hard: Labels) -> F64:
        """Return [K] 0..1, how far the line of every turn passes its part; 0 without any part."""
        arms = np.array([arm_of(h, self.study.own(hard, k + 1)) if h.turns else 0.0
                         for k, h in enumerate(motions)]) / self.study.diag
        return np.where(np.isfinite(arms), np.clip(arms / NEAR - 1.0, 0.0, 1.0), 0.0)

    def unexplained(self, found: Candidate) -> Evidence:
        """Return the surfels that a judged candidate carries to where nothing like them is."""
        poor = self.costs(found.motions, found.labels) > UNEXPLAINED
        return Evidence(*(s.select(own) for s, own in zip(
            self.study.surfels, np.split(poor, [len(self.study.surfels[0])]), strict=True)))

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
