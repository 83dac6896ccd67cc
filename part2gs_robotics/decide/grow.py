"""Decision: how many parts move, and how. One cost decides about every change of the set."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial

from part2gs_robotics.decide.candidate import Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.leave_out import thinned
from part2gs_robotics.decide.screws import risen
from part2gs_robotics.decide.split import beside, halved
from part2gs_robotics.decide.turn_alternatives import calmed
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.runtime.side_by_side import side_by_side

Search = Callable[[Evidence], list[Joint]]
logger = logging.getLogger(__name__)
FEW = 1  # sets that images see where most of what is tried is hopeless


def decide(judge: Judge, pool: Sequence[Joint], parts: int | None,
           again: Search | None = None) -> tuple[Candidate, bool]:
    """Return the set of motions that costs least of all that were tried.

    Args:
        judge: of the study.
        pool: motions to choose from.
        parts: number of moving parts if known; of what was found without it, the parts that save
            most stay, or what saves most comes to it.
        again: finds more motions from what a set leaves unexplained; None = no second search.

    Returns:
        The candidate, and whether one motion more would pay though their number was given.
    """
    best = judge.judge(on_base([]))
    logger.info("decide: nothing moves: cost %.4f", best.cost)
    best = lowered(judge, best, pool)
    while again and len(best):
        more = neared(judge, best, again(judge.unexplained(best)))
        new = _cheapest(judge, best, more) if more else best
        if new.cost >= best.cost:
            break
        best = lowered(judge, new, pool)
    best, short = (best, False) if parts is None else _counted(judge, best, pool, parts)
    end = judge.renewed(risen(judge, best, pool))
    return (thinned(judge, end) if parts is None else end), short  # anew, others may have it all


def neared(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> list[Joint]:
    """Return motions, each refined from afar on the surfels that it would have beside a set.

    Args:
        judge: of the study.
        best: the set.
        pool: motions.
    """
    found = side_by_side([partial(judge.neared, best.plus(h)) for h in pool])
    moved = sum(new.motions[-1] is not h for new, h in zip(found, pool, strict=True))
    logger.info("decide: %d of %d motions to choose from refined from afar", moved, len(pool))
    return [new.motions[-1] for new in found]


def lowered(judge: Judge, start: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return what a judged candidate becomes while changes of its set lower the cost.

    Args:
        judge: of the study.
        start: judged.
        pool: motions to choose from.
    """
    best = thinned(judge, start)
    while pool:
        name, new = _cheaper(judge, best, pool)
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


def _cheaper(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> tuple[str, Candidate]:
    """Return the first change of a set that lowers the cost, and its name; else the set itself."""
    grown = _one_more(judge, best, pool)
    ways: tuple[tuple[str, Callable[[], Candidate]], ...] = (
        ("one more", lambda: grown),
        ("another in the place of one", lambda: _swapped(judge, best, pool)),
        ("two in the place of one", lambda: _best(judge, best, halved(judge, best, pool))),
        ("one nearly as another", lambda: _best(judge, best, beside(judge, best))),
        # A plain door alone may show the photos worse what a drawer behind it makes up for.
        ("two more", lambda: _one_more(judge, grown, pool)),
    )
    for name, way in ways:
        new = _calm(judge, way(), best, pool)
        if new.cost < best.cost:
            return name, new
    logger.info("decide: one more: %.4f dearer", grown.cost - best.cost)
    return "", best


def _cheapest(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the best of a set with one motion more, or another in the place of one."""
    return min(_one_more(judge, best, pool), _swapped(judge, best, pool), key=lambda c: c.cost)


def _one_more(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the best candidate with one motion more, polished."""
    return judge.polished(judge.best_of([best.plus(h) for h in pool]))


def _swapped(judge: Judge, best: Candidate, pool: Sequence[Joint]) -> Candidate:
    """Return the best candidate with another motion in the place of one; itself where none is."""
    sets = [best.swapped(k, h) for k in range(len(best)) for h in pool if best.free(k)]
    return judge.best_of(sets, FEW) if sets else best


def _best(judge: Judge, best: Candidate, sets: Sequence[Candidate]) -> Candidate:
    """Return the best of some sets, polished; the candidate itself without any."""
    return judge.polished(judge.best_of(sets, FEW)) if sets else best


def _counted(judge: Judge, best: Candidate, pool: Sequence[Joint], parts: int,
             ) -> tuple[Candidate, bool]:
    """Return a set of so many parts, or of fewer without a pool, and whether one more would pay."""
    free = best
    while len(best) > parts:
        best = min((judge.judge(best.without(k)) for k in range(len(best))), key=lambda c: c.cost)
    while pool and len(best) < parts:
        best = _one_more(judge, best, pool)
    more = free if len(free) > parts else _one_more(judge, best, pool) if pool else best
    logger.info("decide: one part more than asked for: %.4f less", best.cost - more.cost)
    return best, more.cost < best.cost
