"""Decision: how many parts move, judged by surfels and by images of both states together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from part2gs_robotics.flips import calmed, righted
from part2gs_robotics.judge import Judge, Verdict
from part2gs_robotics.motion_search import Hypothesis
from part2gs_robotics.screws import risen
from part2gs_robotics.study import Study

DOUBT = 0.5  # of the price: what saves this much is tuned before it is turned down
TUNE_ROUNDS = 3  # the third seldom changes anything
TUNE_ANGLE = np.deg2rad(12.0)  # rad; drawers of one cabinet run parallel
TUNE_STEPS = (-0.02, -0.01, -0.005, 0.0, 0.005, 0.01, 0.02)  # of the diagonal
WHOLE = 0.65  # of the poorer state's surfels: most bodies meet more, two under one motion less
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
                break
            grown = two
            say(f"one slide was two: {len(grown.motions)} parts: cost {grown.cost:.4f}")
        best = calmed(judge, grown, pool, say)
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


def _split(judge: Judge, verdict: Verdict, pool: list[Hypothesis],
           say: Callable[[str], None]) -> Verdict:
    """Return the verdict with one motion replaced by two parallel slides, itself if none pays.

    One motion between two drawers' explains both rather well: neither drawer alone is worth adding
    to it, and neither is worth more in its place.
    """
    far = SPLIT * judge.study.diag
    slides = [h for h in pool if not h.kind]
    pairs = [(a, b) for a, b in combinations(slides, 2)
             if a.axis @ b.axis > np.cos(TUNE_ANGLE) and abs(a.value - b.value) > far]
    sets = [[*verdict.motions[:k], *pair, *verdict.motions[k + 1:]]
            for k in np.flatnonzero(judge.met(verdict.motions, verdict.hard) < WHOLE)
            for pair in pairs[:MOST_PAIRS]]
    if not sets:
        return verdict
    found = judge.polished(judge.best_of(sets, verdict))
    price = judge.price(found, verdict.cost)
    if found.cost < verdict.cost + HOPE * price:  # lengths and labels are off until tuned
        found = tune(judge, found, say)
    pays = verdict.cost - found.cost >= price
    return found if pays and found.improves(verdict) else verdict


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
