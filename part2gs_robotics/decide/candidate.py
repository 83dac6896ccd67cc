"""Candidate: a set of motions that may explain both states, with what carries and shows them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint

STRANGE = 0.05  # the most that a slide saved which no made thing's joint makes was 0.045
# One more part, or carrier: of 17 objects true ones saved 0.0028 up, false 0.0018, one since 0.003.
PART = 0.0023
# Saved per surfel of small parts: two true ones 0.74 and 0.95, the best of the false ones 0.21.
BORDER = 0.5


def price(share: F64 | float) -> F64:
    """Return what telling of a part costs, in units of `PART`; share: of all surfels, that it has.

    Half of it tells of the joint. The rest is the part's border: as much as a half of a small
    part's surfels saves where they were contradicted, at most another half.
    """
    return np.clip(BORDER * np.asarray(share, np.float64) / PART, 0.5, 1.0)


@dataclass(frozen=True)
class Scores:
    """What surfels and photos of both states say of a set of motions: terms of one cost.

    Attributes:
        surfels: labelling energy per surfel, and what parts only make vanish.
        images: cross-rendering cost per object pixel beyond what no motion could mend.
        seams: per surfel, bonds of neighbours that the labels cut.
        strange: of all motions together, how surely each is no made thing's, 0..1 each: a turn
            about a line in the air, a motion askew to walls and edges, one through what is in its
            way.
        parts: prices of all moving parts, see `price`; a carried one's counts twice, since what
            carries it must be told as well. And of what hangs on them by nothing seen.
    """

    surfels: float
    images: float
    seams: float = 0.0
    strange: float = 0.0
    parts: float = 0.0

    @property
    def left(self) -> float:
        """What the motions leave unexplained, whatever their number."""
        return self.surfels + self.images + self.seams + STRANGE * self.strange

    @property
    def cost(self) -> float:
        """What is left, and what telling of the parts costs."""
        return self.left + PART * self.parts


@dataclass(frozen=True)
class Candidate:
    """K motions that together may explain both states.

    Attributes:
        motions: of parts 1..K, carriers' motions within.
        labels: [N0 + N1] part of every surfel, state 1 after state 0; empty until sorted out.
        judged: scores; None until it is judged, and where a motion has changed since.
        parents: part that carries each, 0 = base.
        known: of every part, its number when joints began to be settled, 0 = found since.
        fresh: parts whose motion is newer than the labels.
    """

    motions: tuple[Joint, ...]
    labels: Labels
    judged: Scores | None
    parents: tuple[int, ...]
    known: tuple[int, ...]
    fresh: tuple[int, ...] = ()

    def __len__(self) -> int:
        """Return the number of moving parts."""
        return len(self.motions)

    @property
    def scores(self) -> Scores:
        """What surfels and photos say of it."""
        assert self.judged is not None, "a candidate's scores are asked for before it is judged"
        return self.judged

    @property
    def cost(self) -> float:
        """See `Scores.cost`."""
        return self.scores.cost

    def free(self, k: int) -> bool:
        """Return whether part k neither carries nor is carried."""
        return not self.parents[k] and k + 1 not in self.parents

    def plus(self, motion: Joint, parent: int = 0) -> Candidate:
        """Return the candidate, not judged yet, with one motion more at its end."""
        return replace(self, motions=(*self.motions, motion), judged=None,
                       parents=(*self.parents, parent), known=(*self.known, 0),
                       fresh=(*self.fresh, len(self) + 1))

    def without(self, k: int) -> Candidate:
        """Return the candidate, not judged yet, without motion k, which carries none."""
        parents, hard = self.parents[:k] + self.parents[k + 1:], self.labels
        return replace(self, motions=self.motions[:k] + self.motions[k + 1:], judged=None,
                       labels=np.where(hard == k + 1, 0, hard - (hard > k + 1)),
                       parents=tuple(p - (p > k + 1) for p in parents),
                       known=self.known[:k] + self.known[k + 1:],
                       fresh=tuple(n - (n > k + 1) for n in self.fresh if n != k + 1))

    def swapped(self, k: int, motion: Joint, parent: int | None = None) -> Candidate:
        """Return the candidate, not judged yet, with another motion, or parent too, of part k."""
        parent = self.parents[k] if parent is None else parent
        return replace(self, motions=(*self.motions[:k], motion, *self.motions[k + 1:]),
                       judged=None, fresh=(*self.fresh, k + 1),
                       parents=(*self.parents[:k], parent, *self.parents[k + 1:]))

    def with_motions(self, motions: Iterable[Joint]) -> Candidate:
        """Return the candidate, not judged yet, with the motions of all its parts changed.

        What carries a part goes where its own motion takes it now.
        """
        new = list(motions)
        for k, parent in enumerate(self.parents):
            if parent:
                new[k] = replace(new[k], carrier=new[parent - 1].state1_from_0)
        return replace(self, motions=tuple(new), judged=None)

    def carriers_first(self) -> Candidate:
        """Return the candidate with carriers before what they carry."""
        order = sorted(range(len(self)), key=lambda k: self.parents[k] > 0)
        place = np.zeros(len(order) + 1, np.int64)
        place[np.array(order, np.int64) + 1] = np.arange(1, len(order) + 1)
        return replace(self, motions=tuple(self.motions[k] for k in order),
                       labels=place[self.labels], known=tuple(self.known[k] for k in order),
                       parents=tuple(int(place[self.parents[k]]) for k in order),
                       fresh=tuple(int(place[n]) for n in self.fresh))


def on_base(motions: Iterable[Joint], labels: Labels | None = None) -> Candidate:
    """Return a candidate, not judged yet, of parts that all hang on the base."""
    found = tuple(motions)
    every = tuple(range(1, len(found) + 1))
    if labels is None:
        return Candidate(found, np.zeros(0, np.int64), None, (0,) * len(found), every, every)
    return Candidate(found, labels, None, (0,) * len(found), every)
