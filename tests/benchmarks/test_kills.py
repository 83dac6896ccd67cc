"""Builds killed at random points end like an undisturbed one: the campaign's figures, and a few."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results/kills.json"


@pytest.fixture(scope="module")
def kills(load):
    return load("kills")


def test_what_is_compared_is_the_twin_and_the_stages(kills, tmp_path):
    for name in ("twin.xml", "assets/base.obj", "report.json", "log.jsonl",
                 "stages/01/arrays.safetensors", "stages/01/data.json", "x.tmp-12"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(name)
    assert set(kills.contents(tmp_path)) == {"twin.xml", "assets/base.obj", "x.tmp-12",
                                             "stages/01/arrays.safetensors"}
    assert kills.leftovers(tmp_path) == ["x.tmp-12"]


@pytest.mark.slow
def test_a_few_kills(kills):
    found = kills.campaign(4, seed=1, minutes=5)
    assert found["kills"] >= 1
    assert not found["different"]


def test_the_large_campaign_was_bit_equal():
    found = json.loads(RESULTS.read_text())
    assert found["kills"] >= 50
    assert not found["different"]
    assert min(found["signals"].values()) >= 20
    assert found["files_compared"] >= 10
