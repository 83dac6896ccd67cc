"""Candidate: a set of motions that may explain both states, with what carries and shows them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.model.arrays import Labels
from part2gs_robotics.model.joint import Joint

AGAINST = 0.01  # of a cost: less is noise of the labelling; false parts land 1.8 % worse
WHOLER = 0.03  # of the image cost, where bodies become whole: true parts cost up to 1.7 % more
MORE_MET = 0.1  # of the surfels of the part that meets least: what makes a body whole adds 0.34
INCOHERENT = 0.05  # while parts are missing one motion must hide the others' surfels as well
# Of the poorer state's surfels met: surely right, may be, only hides; two parts in one 0.22 to 0.4.
ALL_MET, MIN_MET, NONE_MET = 0.5, 0.35, 0.25
PLAIN_ASKEW = 0.5  # halfway from the worst true slide to a diagonal between two


@dataclass(frozen=True)
class Scores:
    """What surfels and photos of both states say of a set of motions.

    Attributes:
        surfels: labelling energy per surfel.
        images: cross-rendering cost per object pixel.
        met: of the motion that does so least, the share of its own surfels of one state that it
            carries onto those of the other.
        air: 0..1, how far the line of a turn passes its part, 1 = surely no hinge.
        askew: 0..1, the most that a motion leaves walls and edges, 1 = surely no joint's.
    """

    surfels: float
    images: float
    met: float = 1.0
    air: float = 0.0
    askew: float = 0.0

    @property
    def coherent(self) -> bool:
        """Whether every motion carries a body of its own."""
        return self.met >= MIN_MET

    @property
    def left(self) -> float:
        """What the motions leave unexplained."""
        return self.surfels + self.images

    @property
    def cost(self) -> float:
        """What is left, without the price of the parts; dearer with a part that no made thing has.

        That is one which is hardly one body, turns about a line in the air or slides askew.
        """
        torn = (ALL_MET - self.met) / (ALL_MET - NONE_MET)
        strange = min(max(torn, 0.0), 1.0) + self.air + self.askew
        return self.surfels + self.images + INCOHERENT * strange

    def improves(self, other: Scores) -> bool:
        """Return whether a set costs less and neither surfels nor images speak against it.

        A false part can show the photos what one state never saw, such as the inside of a lid, by
        moving something else there; then surfels land worse. A true part helps both. Bodies need
        only cost less than what is none: that can hide the surfels of two parts rather well; so can
        a slide askew. Where one motion that met few becomes two that meet theirs, images may speak
        against it a little.
        """
        if (self.coherent and not other.coherent) or self.askew < PLAIN_ASKEW <= other.askew:
            return self.cost < other.cost
        images = WHOLER if self.met > other.met + MORE_MET else AGAINST
        return (self.left < other.left and self.surfels < (1 + AGAINST) * other.surfels
                and self.images < (1 + images) * other.images)


@dataclass(frozen=True)
class Candidate:
    """K motions that together may explain both states.

    Attributes:
        motions: of parts 1..K, carriers' motions within.
        labels: [N0 + N1] part of every surfel, state 1 after state 0; empty until sorted out.
        judged: scores; None until it is judged, and where a motion has changed since.
        parents: part that carries each, 0 = base.
        known: of every part, its number when joints began to be settled, 0 = found since.
    """

    motions: tuple[Joint, ...]
    labels: Labels
    judged: Scores | None
    parents: tuple[int, ...]
    known: tuple[int, ...]

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

    @property
    def coherent(self) -> bool:
        """See `Scores.coherent`."""
        return self.scores.coherent

    def improves(self, other: Candidate) -> bool:
        """See `Scores.improves`."""
        return self.scores.improves(other.scores)

    def plus(self, motion: Joint, parent: int = 0) -> Candidate:
        """Return the candidate, not judged yet, with one motion more at its end."""
        return replace(self, motions=(*self.motions, motion), judged=None,
                       parents=(*self.parents, parent), known=(*self.known, 0))

    def without(self, k: int) -> Candidate:
        """Return the candidate, not judged yet, without motion k, which carries none."""
        parents = self.parents[:k] + self.parents[k + 1:]
        return replace(self, motions=self.motions[:k] + self.motions[k + 1:], judged=None,
                       parents=tuple(p - (p > k + 1) for p in parents),
                       known=self.known[:k] + self.known[k + 1:])

    def swapped(self, k: int, motion: Joint, parent: int | None = None) -> Candidate:
        """Return the candidate, not judged yet, with another motion, or parent too, of part k."""
        parent = self.parents[k] if parent is None else parent
        return replace(self, motions=(*self.motions[:k], motion, *self.motions[k + 1:]),
                       judged=None, parents=(*self.parents[:k], parent, *self.parents[k + 1:]))

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
                       parents=tuple(int(place[self.parents[k]]) for k in order))


def on_base(motions: Iterable[Joint], labels: Labels | None = None) -> Candidate:
    """Return a candidate, not judged yet, of parts that all hang on the base."""
    found = tuple(motions)
    return Candidate(found, np.zeros(0, np.int64) if labels is None else labels, None,
                     (0,) * len(found), tuple(range(1, len(found) + 1)))
