"""Decision: how many parts move, and how. One cost decides about every change of the set."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from part2gs_robotics.decide.candidate import PART, Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.leave_out import least, thinned
from part2gs_robotics.decide.screws import risen
from part2gs_robotics.decide.split import halved, in_pieces, tune
from part2gs_robotics.decide.turn_alternatives import calmed, lessened, righted
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.model.joint import Joint

Search = Callable[[Evidence], list[Joint]]
logger = logging.getLogger(__name__)
HOPE = 3.0  # prices: lengths of look-alike slides are off until tuned, which saved up to that
FEW = 1  # sets that images see where most of what is tried is hopeless


def decide(judge: Judge, pool: Sequence[Joint], parts: int | None, swap: bool = True,
           again: Search | None = None) -> tuple[Candidate, bool]:
    """Return the set of motions that costs least of all that were tried.

    Args:
        judge: of the study.
        pool: motions to choose from.
        parts: number of moving parts if known; then its price is not asked.
        swap: whether earlier motions are replaceable.
        again: finds more motions from what a set leaves unexplained; None = no second search.

    Returns:
        The candidate, and whether one motion more would pay though their number was given.
    """
    best = judge.judge(on_base([]))
    logger.info("decide: nothing moves: cost %.4f", best.cost)
    if parts is None:
        best = lowered(judge, best, pool, swap)
        while again and len(best):
            more = again(judge.unexplained(best))
            new = _cheapest(judge, best, more, swap) if more else best
            if new.cost >= best.cost:
                break
            best = lowered(judge, new, pool, swap)
    while pool and parts is not None and len(best) < parts:
        best = _one_more(judge, best, pool)
        if swap and len(best) > 1:
            best = min(best, _swapped(judge, best, pool), key=lambda c: c.scores.left)
    short = parts is not None and len(best) == parts and _short(judge, best, pool)
    best = tune(judge, lessened(judge, best, pool))
    return judge.renewed(risen(judge, righted(judge, best), pool)), short


def lowered(judge: Judge, start: Candidate, pool: Sequence[Joint], swap: bool = True) -> Candidate:
    """Return what a judged candidate becomes while changes of its set lower the cost.

    Args:
        judge: of the study.
        start: judged.
        pool: motions to choose from.
        swap: whether motions of the set are replaceable.
    """
    best = thinned(judge, start)
    while pool:
        name, new = _cheaper(judge, best, pool, swap)
        if new is best:
            break
        logger.info("decide: %s: %d parts, cost %.4f, %.4f less", name, len(new), new.cost,
                    best.cost - new.cost)
        best = new
    return best


def _calm(judge: Judge, new: Candidate, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return a set that costs less than the best, thinned and calmed, which may make it dearer.

    Counted before it is calmed, a turn and its lesser likeness would take each other's place
    without end.
    """
    return calmed(judge, thinned(judge, new), pool) if new.cost < best.cost else new


def _cheaper(judge: Judge, best: Candidate, pool: Sequence[Joint], swap: bool,
             ) -> tuple[str, Candidate]:
    """Return the first change of a set that lowers the cost, and its name; else the set itself."""
    grown = _finished(judge, _one_more(judge, best, pool), best)
    if (new := _calm(judge, grown, best, pool)).cost < best.cost:
        return "one more", new
    ways: tuple[tuple[str, bool, Callable[[], Candidate]], ...] = (
        ("another in the place of one", swap, lambda: _swapped(judge, best, pool)),
        ("two in the place of one", True,
         lambda: _best_of(judge, halved(judge, best, pool), best)),
        ("a part's pieces on their own", True,
         lambda: _best_of(judge, in_pieces(judge, best), best)),
        # A plain door alone may show the photos worse what a drawer behind it makes up for.
        ("two more", True, lambda: _finished(judge, _one_more(judge, grown, pool), best)),
        # Three motions of a wire's stretches may hide that one of them, refined, lands it all.
        ("one less, polished", True, lambda: least(judge, best)),
    )
    for name, allowed, way in ways:
        new = _calm(judge, way(), best, pool) if allowed else best
        if new.cost < best.cost:
            return name, new
    logger.info("decide: one more: %.4f dearer", grown.cost - best.cost)
    return "", best


def _cheapest(judge: Judge, best: Candidate, pool: Sequence[Joint], swap: bool) -> Candidate:
    """Return the best of a set with one motion more, or another in the place of one."""
    grown = _finished(judge, _one_more(judge, best, pool), best)
    return min(grown, _swapped(judge, best, pool), key=lambda c: c.cost) if swap else grown


def _one_more(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the best candidate with one motion more, polished."""
    return judge.polished(judge.best_of([best.plus(h) for h in pool]))


def _swapped(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the best candidate with another motion in the place of one; itself where none is."""
    sets = [best.swapped(k, h) for k in range(len(best)) for h in pool if best.free(k)]
    return judge.best_of(sets, FEW) if sets else best


def _best_of(judge: Judge, sets: Sequence[Candidate], best: Candidate) -> Candidate:
    """Return the best of the sets, finished; `best` where there is none."""
    return _finished(judge, judge.polished(judge.best_of(sets, FEW)), best) if sets else best


def _finished(judge: Judge, new: Candidate, best: Candidate) -> Candidate:
    """Return a candidate with its slides tuned where that may decide about it."""
    return tune(judge, new) if 0 <= new.cost - best.cost < HOPE * PART else new


def _short(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> bool:
    """Return whether one motion more would pay."""
    more = _one_more(judge, best, pool)
    logger.info("decide: one part more than asked for: %.4f less", best.cost - more.cost)
    return more.cost < best.cost
