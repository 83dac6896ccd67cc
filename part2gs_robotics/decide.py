"""Decision: how many parts move, judged by surfels and by images of both states together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from part2gs_robotics import se3
from part2gs_robotics.bodies import at_home, pieces
from part2gs_robotics.flips import calmed, righted
from part2gs_robotics.judge import MIN_SURFELS, PLAIN_ASKEW, Judge, Verdict
from part2gs_robotics.landing import land
from part2gs_robotics.motion_refine import refine
from part2gs_robotics.motion_search import Hypothesis
from part2gs_robotics.screws import risen
from part2gs_robotics.study import Study
from part2gs_robotics.surfels import Surfels

DOUBT = 0.5  # of the price: what saves this much is tuned before it is turned down
TUNE_ROUNDS = 3  # the third seldom changes anything
TUNE_ANGLE = np.deg2rad(12.0)  # rad; drawers of one cabinet run parallel
TUNE_STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal
PIECE_STEPS = (-0.04, -0.02, 0.0, 0.02, 0.04)  # of the diagonal: refinement reaches half a step
WHOLE = 0.8  # of the poorer state's surfels: one body meets 0.66 and more, two under one motion
# 0.22 to 0.65; what pays must pay all the same, so trying costs nothing but time
HOPE = 2.0  # prices: two drawers cost that much more before tuning than after
HOPELESS = 4.0  # prices above the set without it: no other earlier motion mends that
SPLIT = 0.005  # of the diagonal: two slides nearer to each other in length are one
MOST_PAIRS = 20  # of slides tried in the place of each motion; a set takes about 30 ms


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
        grown, price = _grown(judge, best, pool, parts is not None, swap, say)
        gain = best.cost - grown.cost
        say(f"{len(grown.motions)} parts: cost {grown.cost:.4f}, {gain:.4f} less; "
            f"price {price:.4f}")
        if parts is None and (gain < price or not grown.improves(best)):
            say("surfels or images speak against it" if gain >= price else "not worth it")
            two = _split(judge, best, pool, say)
            if two is best:
                two = _two_at_once(judge, best, grown, pool, say)
            if two is best:
                two = _parted(judge, best, say)
            if two is best and gain >= price:
                two = _further(judge, best, grown, pool, swap, say)
            if two is best:
                break
            grown = two
            say(f"two in the place of one: {len(grown.motions)} parts: cost {grown.cost:.4f}")
        best = calmed(judge, grown, pool, say)
        if best.askew >= PLAIN_ASKEW and len(best.motions) != parts:
            # At once: what a false slide leaves unexplained, other false motions would explain.
            best = _split(judge, best, pool, say)
        solid = best if best.coherent else solid
    if not best.coherent:
        bodies = judge.bodies(best)
        solid = min(solid, bodies, key=lambda v: v.cost)
        say(f"only {len(solid.motions)} of {len(best.motions)} parts are bodies of their own")
    short = parts is not None and len(solid.motions) == parts and _short(judge, solid, pool, say)
    found = risen(judge, righted(judge, tune(judge, solid, say), say), pool, say)
    return replace(found, short=short)


def _grown(judge: Judge, best: Verdict, pool: list[Hypothesis], known: bool, swap: bool,
           say: Callable[[str], None]) -> tuple[Verdict, float]:
    """Return the verdict on the best set with one motion more, and what that must save."""
    grown = judge.polished(judge.best_of([[*best.motions, h] for h in pool], best))
    price = judge.price(grown, best.cost)
    if swap and len(grown.motions) > 1 and (known or grown.cost < best.cost + HOPELESS * price):
        grown = _swap(judge, grown, pool, best)
        price = judge.price(grown, best.cost)
    price = 0.0 if known else price
    if price > best.cost - grown.cost > DOUBT * price and grown.coherent:
        # A drawer with nearly its length saves part of what it will: judge it at its best.
        grown = tune(judge, grown, say)
    return grown, price


def _short(judge: Judge, best: Verdict, pool: list[Hypothesis], say: Callable[[str], None]) -> bool:
    """Return whether one motion more would pay."""
    more, price = _grown(judge, best, pool, False, False, say)
    gain = best.cost - more.cost
    say(f"one part more than asked for: {gain:.4f} less; price {price:.4f}")
    return gain > price and more.improves(best)


def _swap(judge: Judge, verdict: Verdict, pool: list[Hypothesis], above: Verdict) -> Verdict:
    """Return the verdict after one earlier motion is replaced, if that helps.

    What improves `above` is not given up for what does not.
    """
    best = verdict
    for k in range(len(verdict.motions) - 1):
        rest = [h for j, h in enumerate(verdict.motions) if j != k]
        trial = judge.best_of([[*rest, h] for h in pool], above)
        if trial.cost < best.cost - 1e-3 and trial.improves(above) >= best.improves(above):
            best = trial
    return best if best is verdict else judge.polished(best)


def _two_at_once(judge: Judge, best: Verdict, grown: Verdict, pool: list[Hypothesis],
                 say: Callable[[str], None]) -> Verdict:
    """Return the verdict with two slides more, bodies both, where neither pays alone, else `best`.

    Args:
        judge: of the study.
        best: verdict so far.
        grown: with one motion more, which did not pay.
        pool: hypotheses.
        say: told every step.
    """
    two = _split(judge, grown, pool, say)
    if two is grown:
        return best
    pays = best.cost - two.cost >= 2 * judge.price(two, best.cost)
    return two if pays and two.coherent and two.improves(best) else best


def _further(judge: Judge, best: Verdict, grown: Verdict, pool: list[Hypothesis], swap: bool,
             say: Callable[[str], None]) -> Verdict:
    """Return the verdict with a motion more than one that pays but is spoken against, or `best`.

    A plain door alone may show the photos worse what a drawer behind it makes up for.
    """
    two, price = _grown(judge, grown, pool, False, swap, say)
    pays = best.cost - two.cost >= 2 * price and grown.cost - two.cost >= price
    say(f"with one more yet: {len(two.motions)} parts: cost {two.cost:.4f}, "
        f"{grown.cost - two.cost:.4f} less; price {price:.4f}")
    return two if pays and two.improves(best) else best


def _parted(judge: Judge, verdict: Verdict, say: Callable[[str], None]) -> Verdict:
    """Return the verdict with one motion replaced by a motion of each of its pieces, if that pays.

    Drawers in far corners that are pulled out by nearly as much look like one body in two pieces.
    Nothing joins them and they move differently: that is told half of what a part is worth.
    """
    study, sets = judge.study, []
    for k, h in enumerate(verdict.motions):
        apart = pieces(h, study.own(verdict.hard, k + 1), study.diag, MIN_SURFELS)
        if len(apart) > 1:
            own = [_own(judge, h, piece) for piece in apart[:2]]
            if _differ(own, apart[1], SPLIT * study.diag):
                sets.append([*verdict.motions[:k], *own, *verdict.motions[k + 1:]])
    if not sets:
        return verdict
    found = judge.polished(judge.best_of(sets, verdict))
    price = judge.price(found, verdict.cost)
    if found.cost < verdict.cost + HOPE * price:
        found = tune(judge, found, say)
    gain, worth = verdict.cost - found.cost, DOUBT * price
    say(f"a part's pieces on their own: {gain:.4f} less; price {worth:.4f}")
    return found if gain >= worth and found.improves(verdict) else verdict


def _own(judge: Judge, h: Hypothesis, piece: tuple[Surfels, Surfels]) -> Hypothesis:
    """Return the motion near h, a slide also shorter or longer, that lands a piece best."""
    study, (zero, one) = judge.study, judge.lands
    ways = (0.0,) if h.kind else PIECE_STEPS
    tries = [refine(replace(h, value=h.value + way * study.diag), piece, judge.lands, study.taus, 4)
             for way in ways]

    def cost(g: Hypothesis) -> float:
        moves = (g.move, piece[0], one), (se3.inverse(g.move), piece[1], zero)
        found = [land(move, own, there, study.tau) for move, own, there in moves]
        return sum(float(np.where(target < 0, miss, match).sum()) for match, target, miss in found)

    return min(tries, key=cost)


def _differ(two: list[Hypothesis], piece: tuple[Surfels, Surfels], far: float) -> bool:
    """Return whether two motions carry a piece to places farther apart than `far`, on average."""
    points = at_home(two[1], piece)
    gaps = se3.apply(two[0].move, points) - se3.apply(two[1].move, points)
    return bool(np.linalg.norm(gaps, axis=1).mean() > far)


def _split(judge: Judge, verdict: Verdict, pool: list[Hypothesis],
           say: Callable[[str], None]) -> Verdict:
    """Return the verdict with one motion replaced by two parallel ones, itself if none pays.

    One motion between two drawers' explains both rather well: neither drawer alone is worth adding
    to it, and neither is worth more in its place. One shut and one opened look like a slide askew,
    and of two doors like one door that swung across.
    """
    far = SPLIT * judge.study.diag
    pairs = [pair for kind in (0, 1) for pair in _parallel(pool, kind, far)[:MOST_PAIRS]]
    doubtful = ((judge.met(verdict.motions, verdict.hard) < WHOLE)
                | (judge.leans(verdict.motions, verdict.hard) >= PLAIN_ASKEW))
    sets = [[*verdict.motions[:k], *pair, *verdict.motions[k + 1:]]
            for k in np.flatnonzero(doubtful) for pair in pairs
            if pair[0].kind == verdict.motions[k].kind]
    if not sets:
        return verdict
    found = judge.polished(judge.best_of(sets, verdict))
    price = judge.price(found, verdict.cost)
    if found.cost < verdict.cost + HOPE * price:  # lengths and labels are off until tuned
        found = tune(judge, found, say)
    pays = verdict.cost - found.cost >= price
    return found if pays and found.improves(verdict) else verdict


def _parallel(pool: list[Hypothesis], kind: int, far: float,
              ) -> list[tuple[Hypothesis, Hypothesis]]:
    """Return the pairs of motions of one kind along parallel axes; slides that differ by `far`."""
    return [(a, b) for a, b in combinations([h for h in pool if h.kind == kind], 2)
            if abs(a.axis @ b.axis) > np.cos(TUNE_ANGLE)
            and (kind or np.linalg.norm(a.axis * a.value - b.axis * b.value) > far)]


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
