"""The lesser of two motions that save nearly as much: a drawer slides, it turns about no back.

Of look-alike drawers the slide of one hides most of what the other leaves, and a large turn about a
line elsewhere may happen to hide the rest as well as the other's own slide does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from part2gs_robotics.decide.judge import NEAR, Judge, Verdict, arm_of
from part2gs_robotics.decide.turn_alternatives import lesser
from part2gs_robotics.search.hypothesis import Hypothesis

LARGE = np.deg2rad(45.0)  # a lesser turn is no odder than a slide
# Of what the turn saves: a drawer's own slide saved 0.92 of what a false turn did; the best lesser
# motion in the place of 30 true turns, 36 to 110 degrees in 19 builds, 0.57 at most.
NEARLY = 0.8
RAW = 0.5  # likewise, before it is polished: that slide 0.8; what saves less is not polished


def lessened(judge: Judge, verdict: Verdict, pool: list[Hypothesis], say: Callable[[str], None],
             ) -> Verdict:
    """Return the verdict with large turns made less where that saves nearly as much.

    Args:
        judge: of the study.
        verdict: decided.
        pool: hypotheses, that may have the place of a turn.
        say: told of every turn that changes.
    """
    best = verdict
    for k, h in enumerate(verdict.motions):
        if h.kind != 1 or h.carrier is not None or abs(h.value) < LARGE:
            continue
        own, near = judge.study.own(best.hard, k + 1), NEAR * judge.study.diag
        # The line of a turn that is a hinge goes through its part or lies beside it.
        less = [new for new in lesser(h, pool) if not new.kind or arm_of(new, own) < near]
        if not less:
            continue
        before, after = best.motions[:k], best.motions[k + 1:]
        trial = judge.best_of([[*before, new, *after] for new in less])
        rest = judge.judge([*before, *after])
        saved = rest.cost - best.cost
        if rest.cost - trial.cost <= RAW * saved:
            continue
        trial = judge.polished(trial)
        if trial.coherent and rest.cost - trial.cost > NEARLY * saved > 0.0:
            say(f"part {k + 1} may as well move less: cost {trial.cost:.4f}, was {best.cost:.4f}, "
                f"without it {rest.cost:.4f}")
            best = trial
    return best
