"""Decision: how many parts move, judged by surfels and by images of both states together."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from part2gs_robotics.decide.candidate import PLAIN_ASKEW, Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.screws import risen
from part2gs_robotics.decide.split import parted, split
from part2gs_robotics.decide.tune_slides import tune
from part2gs_robotics.decide.turn_alternatives import calmed, lessened, righted
from part2gs_robotics.model.joint import Joint

logger = logging.getLogger(__name__)
DOUBT = 0.5  # of the price: what saves this much is tuned before it is turned down
NEARLY = 0.75  # of the price: of two look-alike parts the first alone saved 0.94, the second 2.5
HOPELESS = 4.0  # prices above the set without it: no other earlier motion mends that


def decide(judge: Judge, pool: Sequence[Joint], parts: int | None, swap: bool = True,
           ) -> tuple[Candidate, bool]:
    """Return the set of motions that pays: grown one by one, earlier ones replaceable.

    Args:
        judge: of the study.
        pool: motions to choose from.
        parts: number of moving parts if known; then the price is not asked.
        swap: whether earlier motions are replaceable.

    Returns:
        The candidate, and whether one motion more would pay though their number was given.
    """
    best = solid = judge.judge(on_base([]))
    logger.info("decide: nothing moves: cost %.3f", best.cost)
    while pool and (parts is None or len(best) < parts):
        grown, price = one_more(judge, best, pool, parts is not None, swap)
        gain = best.cost - grown.cost
        logger.info("decide: %d parts: cost %.4f, %.4f less; price %.4f", len(grown), grown.cost,
                    gain, price)
        if parts is None and (gain < price or not grown.improves(best)):
            logger.info("decide: %s", "surfels or images speak against it" if gain >= price
                        else "not worth it")
            two = _otherwise(judge, best, grown, pool, swap, gain / price)
            if two is best:
                break
            grown = two
            logger.info("decide: two in the place of one: %d parts: cost %.4f", len(grown),
                        grown.cost)
        best = calmed(judge, grown, pool)
        if best.scores.askew >= PLAIN_ASKEW and len(best) != parts:
            # At once: what a false slide leaves unexplained, other false motions would explain.
            best = split(judge, best, pool)
        solid = best if best.coherent else solid
    if not best.coherent:
        solid = min(solid, judge.bodies(best), key=lambda c: c.cost)
        logger.info("decide: only %d of %d parts are bodies of their own", len(solid), len(best))
    short = parts is not None and len(solid) == parts and _short(judge, solid, pool)
    solid = tune(judge, lessened(judge, solid, pool))
    return risen(judge, righted(judge, solid), pool), short


def _otherwise(judge: Judge, best: Candidate, grown: Candidate, pool: Sequence[Joint], swap: bool,
               paid: float) -> Candidate:
    """Return a candidate better than `best` where one motion more is not taken, else `best`.

    Args:
        judge: of the study.
        best: so far.
        grown: with one motion more, which was turned down.
        pool: motions to choose from.
        swap: whether earlier motions are replaceable.
        paid: what that motion saves, in prices.
    """
    ways: tuple[Callable[[], Candidate], ...] = (
        lambda: split(judge, best, pool),
        lambda: _two_at_once(judge, best, grown, pool),
        lambda: parted(judge, best),
        lambda: _further(judge, best, grown, pool, swap and paid >= 1) if paid > NEARLY else best,
    )
    return next((found for found in (way() for way in ways) if found is not best), best)


def one_more(judge: Judge, best: Candidate, pool: Sequence[Joint], known: bool, swap: bool,
             ) -> tuple[Candidate, float]:
    """Return the best candidate with one motion more, and what that must save.

    Args:
        judge: of the study.
        best: so far.
        pool: motions to choose from, one at least.
        known: whether the number of parts is given; then the price is not asked.
        swap: whether earlier motions are replaceable.
    """
    grown = judge.polished(judge.best_of([best.plus(h) for h in pool], best))
    price = judge.price(grown, best.cost)
    if swap and len(grown) > 1 and (known or grown.cost < best.cost + HOPELESS * price):
        grown = _swap(judge, grown, pool, best)
        price = judge.price(grown, best.cost)
    price = 0.0 if known else price
    if price > best.cost - grown.cost > DOUBT * price and grown.coherent:
        # A drawer with nearly its length saves part of what it will: judge it at its best.
        grown = tune(judge, grown)
    return grown, price


def _short(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> bool:
    """Return whether one motion more would pay."""
    more, price = one_more(judge, best, pool, False, False)
    gain = best.cost - more.cost
    logger.info("decide: one part more than asked for: %.4f less; price %.4f", gain, price)
    return gain > price and more.improves(best)


def _swap(judge: Judge, found: Candidate, pool: Sequence[Joint], above: Candidate) -> Candidate:
    """Return the candidate after one earlier motion is replaced, if that helps.

    What improves `above` is not given up for what does not.
    """
    best = found
    for k in range(len(found) - 1):
        trial = judge.best_of([found.without(k).plus(h) for h in pool], above)
        if trial.cost < best.cost - 1e-3 and trial.improves(above) >= best.improves(above):
            best = trial
    return best if best is found else judge.polished(best)


def _two_at_once(judge: Judge, best: Candidate, grown: Candidate, pool: Sequence[Joint],
                 ) -> Candidate:
    """Return two slides more, bodies both, where neither pays alone, else `best`.

    Args:
        judge: of the study.
        best: so far.
        grown: with one motion more, which did not pay.
        pool: motions to choose from.
    """
    two = split(judge, grown, pool)
    if two is grown:
        return best
    pays = best.cost - two.cost >= 2 * judge.price(two, best.cost)
    return two if pays and two.coherent and two.improves(best) else best


def _further(judge: Judge, best: Candidate, grown: Candidate, pool: Sequence[Joint], swap: bool,
             ) -> Candidate:
    """Return a candidate with a motion more than one that is not taken alone, or `best`.

    A plain door alone may show the photos worse what a drawer behind it makes up for. Of two
    look-alike drawers the first hides most of what both leave, and saves what the second does too.
    """
    two, price = one_more(judge, grown, pool, False, swap)
    pays = best.cost - two.cost >= 2 * price and grown.cost - two.cost >= price
    logger.info("decide: with one more yet: %d parts: cost %.4f, %.4f less; price %.4f", len(two),
                two.cost, grown.cost - two.cost, price)
    return two if pays and two.improves(best) else best
