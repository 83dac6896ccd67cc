"""Judge: what a set of motions leaves unexplained in surfels and in images of both states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from part2gs_robotics.decide.candidate import STRANGE, Candidate, Scores, price
from part2gs_robotics.decide.labelling import MOVES, Unary, energy_of, label, unary_costs
from part2gs_robotics.decide.loose import behind, bodies_of, hanging, hung, vanished
from part2gs_robotics.decide.made_joints import askew, crooked, square, way_over
from part2gs_robotics.decide.passage import Seen, through
from part2gs_robotics.evidence.cross_render import both_cost
from part2gs_robotics.evidence.landing import MATCHED, UNEXPLAINED, unclaimed
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.evidence.surfels import Surfels, apart, at_home
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64, Labels, Mask
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side
from part2gs_robotics.search.refine import refine

NEAR = 0.05  # of the diagonal: hinges of eleven scenes pass their parts by 0.036 at most
STILL = 1e-5  # of the diagonal: of 40 refinements 21 moved a part by less, the others by 3e-4 up
# Of the matching distance, before the usual ones: half as far, a wire 3 % off is met as well.
AFAR = 4.0, 2.0
FEW = 400  # surfels of each state that a motion is refined on from afar: a patch has as many
SHOWN = 2  # sets per step, the best by surfels, that images see


def arm_of(h: Joint, own: tuple[Surfels, Surfels]) -> float:
    """Return how far the line of a turn passes its part, scene units; infinite without any part."""
    gaps = np.linalg.norm(np.cross(at_home(h, own) - h.origin, h.axis), axis=1)
    return float(gaps.min(initial=np.inf))


class Judge:
    """Scores sets of motions; landing costs of a motion are computed once."""

    def __init__(self, study: Study) -> None:
        self.study = study
        self.lands = unclaimed(study.lands[0]), unclaimed(study.lands[1])
        self._points, self._normals = (np.concatenate([getattr(s, name) for s in study.surfels])
                                       for name in ("points", "normals"))
        self._late = np.arange(len(self._points)) >= len(study.surfels[0])
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

    def sort_out(self, found: Candidate, asked: Sequence[int] | None = None) -> Candidate:
        """Return the candidate with the labels that surfels and bonds make cheapest.

        Args:
            found: its labels are where the search starts.
            asked: labels that are tried, each once; None = all, until none helps.
        """
        hard = found.labels if len(found.labels) else np.zeros(len(self._normals), np.int64)
        unary = self._unary(found.motions).resting
        hard = self._reached(found, unary, label(unary, self.study.web, hard, asked))
        return replace(found, labels=hard, fresh=() if asked is None else found.fresh)

    def _reached(self, found: Candidate, unary: Unary, hard: Labels) -> Labels:
        """Return labels whose turns reach their lines, where the surface lets them and it pays.

        What is round about a line looks the same turned or not, and rests: of a lever and its cap
        the lever alone turns, about a line in the air. No exchange that makes surfels cheaper
        gives it the cap.
        """
        away = 1 + np.flatnonzero(self.air(found.motions, hard))
        lands = unary.cost(np.ones_like(unary.match)) < MATCHED + MOVES if len(away) else hard
        far, start = np.zeros_like(unary.match), hard.copy()
        for part in away:
            alike = lands[:, part] & (hard == 0)
            start[self._way_to_line(found.motions[part - 1], start == part, alike)] = part
            far[alike, part] -= MOVES
        if (start == hard).all():
            return hard
        start = label(replace(unary, far=far), self.study.web, start, away.tolist())
        lost = (unary.own(start) > MATCHED + MOVES) & (unary.own(hard) <= MATCHED + MOVES)
        if 2 * lost.sum() > (start != hard).sum():
            return hard  # it would turn amid what rests, and rest where it has turned
        costs = [self.unseen(found, told).cost for told in (hard, start)]
        return start if costs[1] < costs[0] else hard

    def _way_to_line(self, h: Joint, own: Mask, alike: Mask) -> Labels:
        """Return rows of surfels on the shortest way from a turn's part to its line in each state.

        Args:
            h: a turn.
            own: [N] of the part.
            alike: [N] where a way may go on.
        """
        points = self._points.copy()
        points[self._late] = se3.apply(se3.inverse(h.move), points[self._late])
        near = np.linalg.norm(np.cross(points - h.origin, h.axis), axis=1) < NEAR * self.study.diag
        ends = (alike & near & ~self._late, alike & near & self._late)
        return way_over(self.study.ways, own, alike, ends)

    def _roughly(self, found: Candidate) -> Candidate:
        """Return the candidate with the labels that its new motions may take, or give back."""
        new = tuple(dict.fromkeys(found.fresh))
        stays = all(n == len(found) for n in new)  # a motion more: what it leaves stays as it was
        return self.sort_out(found, new if stays else (*new, 0))

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
        rough = side_by_side([partial(self._likely, s) for s in sets])
        likely = self._free_ones([rough[n] for n in sorted(
            range(len(sets)), key=lambda n: (rough[n][0], n))], shown)
        judged = side_by_side([partial(self.judge, found) for found in likely])
        return min(judged, key=lambda c: c.cost)

    def _free_ones(self, likely: list[tuple[float, Candidate]], count: int) -> list[Candidate]:
        """Return the cheapest of some sets once what goes through others has its cost.

        Args:
            likely: costs without it, least first, and the sets.
            count: how many.
        """
        told = list[tuple[float, int]]()
        for n, (least, found) in enumerate(likely):
            if len(told) >= count and sorted(told)[count - 1][0] <= least:
                break  # what comes later costs as much even where nothing is in its way
            way = float(self.through(found, found.labels).sum())
            told.append((least + STRANGE * way, n))
        return [likely[n][1] for _, n in sorted(told)[:count]]

    def _likely(self, found: Candidate) -> tuple[float, Candidate]:
        """Return what a set costs before images see it, and the set with labels so far.

        A few dozen sets must be sorted fast.
        """
        found = self._roughly(found)
        return self.unseen(found, found.labels).cost, found

    def judge(self, found: Candidate) -> Candidate:
        """Return the candidate with labels and scores.

        A set is judged once: its motions are kept beside, so their ids stay their own.
        """
        key = (*map(id, found.motions), *found.parents)
        if key not in self._judged:
            hard = self.sort_out(found).labels
            self._judged[key] = found.motions, hard, self.scores(found, hard)
        return replace(found, labels=self._judged[key][1], judged=self._judged[key][2], fresh=())

    def given(self, found: Candidate) -> Candidate:
        """Return the candidate judged with its labels as they are."""
        return replace(found, judged=self.scores(found, found.labels), fresh=())

    def renewed(self, found: Candidate) -> Candidate:
        """Return the judged candidate, with labels from another start where these cost less.

        A surface met must come along, so that exchanges end short of the least, or among labels
        that are as good to surfels and not to photos. The other start is what every surfel would
        choose if all that it meets came along, whatever set the candidate was made from.
        """
        unary = self._unary(found.motions).resting
        alone = unary.cost(np.ones_like(unary.match)).argmin(1)
        hard = self._reached(found, unary, label(unary, self.study.web, alone))
        told = self.scores(found, hard)
        if told.cost >= found.cost:
            return found
        self._judged[(*map(id, found.motions), *found.parents)] = found.motions, hard, told
        return replace(found, labels=hard, judged=told)

    def scores(self, found: Candidate, hard: Labels) -> Scores:
        """Return what surfels and photos say of a set of motions under given labels."""
        study, resting = self.study, self._unary(found.motions).resting
        seen = vanished(resting, hard)[1]  # photos gain by hiding as surfels do
        told = self.unseen(found, hard)
        return replace(told, strange=told.strange + float(self.through(found, hard).sum()),
                       images=both_cost(
            study.gaussians, study.gaussian_labels(seen),
            [np.eye(4), *(h.move for h in found.motions)], study.views, study.source_weight,
            study.light))

    def unseen(self, found: Candidate, hard: Labels) -> Scores:
        """Return the scores of a set under given labels without its images, every way free."""
        motions, study = found.motions, self.study
        unary = self._unary(motions).resting
        surfels = (energy_of(unary, study.graph, hard) + vanished(unary, hard)[0]) / len(hard)
        cut = study.bonds * (hard[:, None] != hard[study.graph.neighbors])
        shares = np.bincount(hard, minlength=len(found) + 1)[1:] / len(hard)
        body = self._bodies(unary, hard)
        told = (price(shares) * np.where(found.parents, 2, 1)).sum()
        axes = [None if h.turns or n else h.axis
                for h, n in zip(motions, found.parents, strict=True)]
        told += hung(hanging(hard, body) & ~behind(body, hard, self._points, axes), body)
        return Scores(surfels, 0.0, float(cut.sum(dtype=np.float64)) / len(hard),
                      self.strange(motions, hard), float(told))

    def _bodies(self, unary: Unary, hard: Labels) -> Labels:
        """Return [N] the body of its part that every moving surfel is in."""
        met = unary.target[np.arange(len(hard)), hard]
        met = np.where((met >= 0) & (hard[met] == hard), met, -1)
        return bodies_of(hard, met, self.study.graph.neighbors, self.study.touching)

    def strange(self, motions: Sequence[Joint], hard: Labels) -> float:
        """Return what `Scores.strange` says of all motions together, every way free."""
        return float((self.leans(motions, hard) + self.air(motions, hard)).sum())

    def through(self, found: Candidate, hard: Labels) -> F64:
        """Return [K] 0..1, how surely every part would have gone through what lands elsewhere."""
        landed = self.costs(found.motions, hard) < MATCHED
        seen = Seen(self._points, self._normals, self._late,
                    landed[:, None] & (hard[:, None] == np.arange(len(found) + 1)))
        return through(seen, found.motions, found.parents, self.study.lands[0].voxel)

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
        points = self._points[found.labels == k + 1]
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

    def neared(self, found: Candidate) -> Candidate:
        """Return a set, not judged, its newest motion refined from afar if surfels gain by it.

        A motion of a patch lands that patch: what else of a wire it should land may be far off.
        """
        (cost, told), h = self._likely(found), found.motions[-1]
        own = self.study.own(told.labels, len(found))
        zero, one = (s.select(slice(None, None, 1 + len(s) // FEW)) for s in own)
        taus = (*(far * self.study.tau for far in AFAR), *self.study.taus)
        fine = refine(h, (zero, one), self.lands, taus)
        if apart(fine, h, own) < STILL * self.study.diag:
            return found
        new = found.swapped(len(found) - 1, fine)
        return new if self._likely(new)[0] < cost else found

    def polished(self, found: Candidate) -> Candidate:
        """Return the candidate with motions refined on their own surfels where that helps."""
        best = found
        for k, h in enumerate(found.motions):
            own = self.study.own(best.labels, k + 1)
            fine = refine(h, own, self.lands, self.study.taus)
            if apart(fine, h, own) < STILL * self.study.diag:
                continue
            new = self.judge(best.swapped(k, fine))
            best = new if new.cost < best.cost else best
        return best
