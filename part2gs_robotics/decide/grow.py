"""Decision: how many parts move, judged by surfels and by images of both states together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from part2gs_robotics.decide.judge import PLAIN_ASKEW, Judge, Verdict
from part2gs_robotics.decide.lesser import lessened
from part2gs_robotics.decide.screws import risen
from part2gs_robotics.decide.split import parted, split
from part2gs_robotics.decide.tune_slides import tune
from part2gs_robotics.decide.turn_alternatives import calmed, righted
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.search.hypothesis import Hypothesis

DOUBT = 0.5  # of the price: what saves this much is tuned before it is turned down
# Of the price: of two look-alike drawers the first alone saved 0.94 of it, the second then 2.5.
NEARLY = 0.75
HOPELESS = 4.0  # prices above the set without it: no other earlier motion mends that


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
        grown, price = one_more(judge, best, pool, parts is not None, swap, say)
        gain = best.cost - grown.cost
        say(f"{len(grown.motions)} parts: cost {grown.cost:.4f}, {gain:.4f} less; "
            f"price {price:.4f}")
        if parts is None and (gain < price or not grown.improves(best)):
            say("surfels or images speak against it" if gain >= price else "not worth it")
            two = _otherwise(judge, best, grown, pool, swap, gain / price, say)
            if two is best:
                break
            grown = two
            say(f"two in the place of one: {len(grown.motions)} parts: cost {grown.cost:.4f}")
        best = calmed(judge, grown, pool, say)
        if best.askew >= PLAIN_ASKEW and len(best.motions) != parts:
            # At once: what a false slide leaves unexplained, other false motions would explain.
            best = split(judge, best, pool, say)
        solid = best if best.coherent else solid
    if not best.coherent:
        bodies = judge.bodies(best)
        solid = min(solid, bodies, key=lambda v: v.cost)
        say(f"only {len(solid.motions)} of {len(best.motions)} parts are bodies of their own")
    short = parts is not None and len(solid.motions) == parts and _short(judge, solid, pool, say)
    solid = tune(judge, lessened(judge, solid, pool, say), say)
    found = risen(judge, righted(judge, solid, say), pool, say)
    return replace(found, short=short, pool=tuple(pool))


def _otherwise(judge: Judge, best: Verdict, grown: Verdict, pool: list[Hypothesis], swap: bool,
               paid: float, say: Callable[[str], None]) -> Verdict:
    """Return a verdict better than `best` where one motion more is not taken, `best` if none is.

    Args:
        judge: of the study.
        best: verdict so far.
        grown: with one motion more, which was turned down.
        pool: hypotheses.
        swap: whether earlier motions are replaceable.
        paid: what that motion saves, in prices.
        say: told every step.
    """
    ways: tuple[Callable[[], Verdict], ...] = (
        lambda: split(judge, best, pool, say),
        lambda: _two_at_once(judge, best, grown, pool, say),
        lambda: parted(judge, best, say),
        lambda: _further(judge, best, grown, pool, swap and paid >= 1, say)
        if paid > NEARLY else best,
    )
    return next((found for found in (way() for way in ways) if found is not best), best)


def one_more(judge: Judge, best: Verdict, pool: list[Hypothesis], known: bool, swap: bool,
             say: Callable[[str], None]) -> tuple[Verdict, float]:
    """Return the verdict on the best set with one motion more, and what that must save.

    Args:
        judge: of the study.
        best: verdict so far.
        pool: hypotheses, one at least.
        known: whether the number of parts is given; then the price is not asked.
        swap: whether earlier motions are replaceable.
        say: told every step.
    """
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
    more, price = one_more(judge, best, pool, False, False, say)
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
    two = split(judge, grown, pool, say)
    if two is grown:
        return best
    pays = best.cost - two.cost >= 2 * judge.price(two, best.cost)
    return two if pays and two.coherent and two.improves(best) else best


def _further(judge: Judge, best: Verdict, grown: Verdict, pool: list[Hypothesis], swap: bool,
             say: Callable[[str], None]) -> Verdict:
    """Return the verdict with a motion more than one that is not taken alone, or `best`.

    A plain door alone may show the photos worse what a drawer behind it makes up for. Of two
    look-alike drawers the first hides most of what both leave, and saves what the second does too.
    """
    two, price = one_more(judge, grown, pool, False, swap, say)
    pays = best.cost - two.cost >= 2 * price and grown.cost - two.cost >= price
    say(f"with one more yet: {len(two.motions)} parts: cost {two.cost:.4f}, "
        f"{grown.cost - two.cost:.4f} less; price {price:.4f}")
    return two if pays and two.improves(best) else best
