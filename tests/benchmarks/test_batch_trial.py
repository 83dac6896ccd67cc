"""The batch whose workers were killed: what its figures must say."""

from __future__ import annotations

import json
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results/batch.json"


def test_none_was_lost_and_none_came_twice():
    found = json.loads(RESULTS.read_text())
    assert found["on"] == "ray"
    assert found["rows"] == found["scenes"] == 51
    assert found["kills"] >= 10
    assert found["lost"] == found["twice"] == found["different"] == []
    assert found["poison"] == "refused"
    assert found["outcomes"].get("failed", 0) == 0
    assert found["again_kept"]


def test_contents_are_compared_under_one_name(load, tmp_path):
    trial = load("batch")
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "twin.xml").write_text(f'<mujoco model="{name}"/>')
    assert trial.renamed(tmp_path / "one", "one") == trial.renamed(tmp_path / "two", "two")
    (tmp_path / "two/twin.xml").write_text("another")
    assert trial.renamed(tmp_path / "one", "one") != trial.renamed(tmp_path / "two", "two")
    assert trial.workers_below(1 << 30) == []
