"""Paired t-tests of the ablation: mean difference, interval, effect size, Holm's correction."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student
from scipy.stats import ttest_rel

LEVEL = 0.05  # of the whole family of tests


@dataclass(frozen=True)
class Paired:
    """A paired comparison: after minus before.

    Attributes:
        n: number of pairs.
        mean: of the differences.
        low: end of the 95 % interval of the mean, NaN below two pairs.
        high: other end.
        p: two-sided p-value, NaN below two pairs, 1 when every difference is 0.
        effect: Cohen's d of paired differences, mean / standard deviation; NaN where that is 0.
        better: pairs in which the value is better afterwards.
        worse: pairs in which it is worse.
    """

    n: int
    mean: float
    low: float
    high: float
    p: float
    effect: float
    better: int
    worse: int


def paired(before: Sequence[float], after: Sequence[float], larger_is_better: bool) -> Paired:
    """Return the paired t-test of two lists in the same order.

    Args:
        before: values without the term.
        after: values with it.
        larger_is_better: which side counts as better.
    """
    difference = np.asarray(after, float) - np.asarray(before, float)
    n, mean = len(difference), float(difference.mean())
    sign = 1 if larger_is_better else -1
    better, worse = int((sign * difference > 0).sum()), int((sign * difference < 0).sum())
    spread = float(difference.std(ddof=1)) if n > 1 else math.nan
    if n > 1 and spread == 0.0:  # the test divides by the spread: nothing or a constant was added
        return Paired(n, mean, mean, mean, 1.0 if mean == 0 else 0.0, math.nan, better, worse)
    if n < 2:
        return Paired(n, mean, math.nan, math.nan, math.nan, math.nan, better, worse)
    half = float(student.ppf(0.975, n - 1)) * spread / math.sqrt(n)
    p = float(ttest_rel(after, before).pvalue)
    return Paired(n, mean, mean - half, mean + half, p, mean / spread, better, worse)


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """Return Holm's adjusted p-values of a family of tests; NaN stays NaN and is not counted."""
    known = sorted((p, key) for key, p in p_values.items() if not math.isnan(p))
    adjusted = dict.fromkeys(p_values, math.nan)
    so_far = 0.0
    for rank, (p, key) in enumerate(known):
        so_far = max(so_far, min(1.0, (len(known) - rank) * p))
        adjusted[key] = so_far
    return adjusted


def verdict(test: Paired, adjusted: float, larger_is_better: bool) -> str:
    """Return "helps", "hurts", "no difference shown", or "not tested" below two pairs."""
    if math.isnan(adjusted):
        return "not tested"
    if adjusted >= LEVEL:
        return "no difference shown"
    return "helps" if (test.mean > 0) == larger_is_better else "hurts"


def together(verdicts: Sequence[str]) -> str:
    """Return one word on a term from its verdicts on all metrics."""
    found = set(verdicts) & {"helps", "hurts"}
    if len(found) == 2:
        return "helps and hurts"
    if found:
        return found.pop()
    return "not tested" if set(verdicts) == {"not tested"} else "no difference shown"
