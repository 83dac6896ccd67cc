"""Losses against physics: ranks have closed forms, and every breakage breaks what it says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr
from synth import toy_cabinet_twin


def test_ranks_with_ties_are_those_of_another_computation(load) -> None:
    rng = np.random.default_rng(0)
    a, b = rng.integers(6, size=60).astype(float), rng.integers(5, size=60).astype(float)
    found = load("losses_ranks").spearman(a, b)
    assert found == pytest.approx(spearmanr(a, b).statistic, abs=1e-12)
    assert load("losses_ranks").spearman(a, np.ones(60)) == 0.0


def test_every_breakage_is_seen_by_the_measure_meant_for_it(load, monkeypatch) -> None:
    script = load("losses_vs_physics")
    monkeypatch.setattr(script, "SIZES", np.array([2.0, 16.0]))
    monkeypatch.setattr(script, "PAIR_POINTS", 200)
    monkeypatch.setattr(load("losses_ranks"), "DRAWS", 20)
    rows = script.twin_rows(toy_cabinet_twin(2), "toy")
    assert len(rows) == 2 * 4 * len({r["part"] for r in rows})
    assert all(row["motion"] > 0 for row in rows)
    for row in rows:
        assert (row["turn"] > 0) == (row["kind"] in ("axis tilted", "grown") and (
            row["part"] == "part_2" or row["kind"] == "grown")), row
    small, large = ([r for r in rows if r["size"] == size] for size in (2.0, 16.0))
    shifted = [(s, big) for s, big in zip(small, large, strict=True) 
               if s["kind"] == "shifted" and s["part"] == "part_2"]
    assert all(big["overlap_volume"] > s["overlap_volume"] for s, big in shifted)
    assert all(big["contact"] > s["contact"] for s, big in shifted)
    assert {e["twins"] for e in load("losses_ranks").summary(rows)} == {len(rows)}
