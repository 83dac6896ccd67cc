"""Rank correlations of benchmarks/losses_vs_physics.py, with intervals, and their table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Rows = list[dict[str, Any]]
DRAWS, GOAL = 1000, 0.95  # of the bootstrap; asked of the corrected forms
# What a loss is meant to tell, and the measure of it.
MEANT = (("contact", "overlap_volume"), ("contact", "overlap_depth"), ("velocity", "turn"),
         ("velocity", "motion"), ("vector_field", "motion"))  # fmt: skip
WORDS = {"overlap_volume": "overlap, volume", "overlap_depth": "overlap, depth",
         "turn": "motion, its turn", "motion": "motion"}  # fmt: skip


def spearman(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the correlation of ranks, ties sharing theirs; 0 where one does not vary."""
    x, y = (rankdata(v) - (len(v) + 1) / 2 for v in (a, b))
    scale = np.sqrt((x @ x) * (y @ y))
    return float(x @ y / scale) if scale else 0.0


def summary(rows: Rows) -> list[dict[str, Any]]:
    """Return one entry per loss, form and measure: within parts, over all, above floors."""
    return [_entry(rows, loss, form, measure) for loss, measure in MEANT
            for form in ("corrected", "printed")]


def _entry(rows: Rows, loss: str, form: str, measure: str) -> dict[str, Any]:
    key = loss if form == "corrected" else f"{loss}_printed"
    parts = sorted({(r["object"], r["part"]) for r in rows})
    groups = [np.array([[r[key], r[measure]] for r in rows if (r["object"], r["part"]) == p])
              for p in parts]
    rng = np.random.default_rng(0)
    within, pooled, excess = _ways(groups)
    draws = np.array([_ways([g[rng.integers(len(g), size=len(g))] for g in
                             (groups[i] for i in rng.integers(len(groups), size=len(groups)))])
                      for _ in range(DRAWS)])
    low, high = np.quantile(draws, [0.025, 0.975], axis=0).round(3).tolist()
    return {"loss": loss, "form": form, "measure": measure, "parts": len(parts),
            "twins": len(rows), "within": round(within, 3), "within_interval": [low[0], high[0]],
            "pooled": round(pooled, 3), "pooled_interval": [low[1], high[1]],
            "excess": round(excess, 3), "excess_interval": [low[2], high[2]]}


def _ways(groups: list[NDArray[np.float64]]) -> tuple[float, float, float]:
    """Return the mean correlation within groups, that of all, and of all above their floors.

    The floor of a part is the least loss of its broken twins: what noise of sampling leaves, which
    an optimiser sees as well.
    """
    everything = np.concatenate(groups)
    above = np.concatenate([g - [g[:, 0].min(), 0.0] for g in groups])
    return (float(np.mean([spearman(g[:, 0], g[:, 1]) for g in groups])),
            spearman(everything[:, 0], everything[:, 1]), spearman(above[:, 0], above[:, 1]))


def markdown(result: dict[str, Any]) -> str:
    """Return the table of the page."""
    first = result["ranks"][0]
    objects = sorted({r["object"] for r in result["rows"]})
    lines = [f"{first['twins']} broken twins of {first['parts']} parts of {len(objects)} objects "
             f"({', '.join(objects)}).", "",
             "| loss | form | against | within a part | over all parts | above the floor |",
             "|---|---|---|--:|--:|--:|"]
    for e in result["ranks"]:
        cells = []
        for key in ("within", "pooled", "excess"):
            low, high = e[f"{key}_interval"]
            mark = "**" if e[key] >= GOAL else ""
            cells.append(f"{mark}{e[key]:.3f}{mark} ({low:.3f} to {high:.3f})")
        lines.append(f"| {e['loss'].replace('_', ' ')} | {e['form']} | {WORDS[e['measure']]} | "
                     f"{' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
