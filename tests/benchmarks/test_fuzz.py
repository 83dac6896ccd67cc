"""Mutated files: the changes are seeded and change something; a small campaign runs."""

from __future__ import annotations

import json
import random
from pathlib import Path

import pytest

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results/fuzz.json"


@pytest.fixture(scope="module")
def fuzz(load):
    return load("fuzz")


def test_mutations_are_seeded_and_change_the_file(fuzz):
    good = b'{"fl_x": 60.0, "frames": [1, 2, 3]}'
    found = [fuzz.mutated(good, random.Random(n)) for n in range(200)]
    assert found == [fuzz.mutated(good, random.Random(n)) for n in range(200)]
    assert sum(data != good for data in found) > 180
    assert fuzz.mutated(b"", random.Random(0))


def test_a_planted_fault_is_found(fuzz, tmp_path, monkeypatch):
    from part2gs_robotics.readers import read_scene

    def careless(scene, config):
        raise IndexError("list index out of range")

    monkeypatch.setattr(read_scene, "read_cameras", careless)
    seeds = fuzz.write_seeds(tmp_path)
    outcomes = [fuzz.run_case("paris", seeds["paris"], random.Random(n))[1] for n in range(40)]
    assert any(outcome.startswith("raised: IndexError") for outcome in outcomes)


def test_a_small_campaign_finds_nothing(fuzz, tmp_path):
    seeds = fuzz.write_seeds(tmp_path)
    for number in range(10**6, 10**6 + 250):  # seeds that the large one never used
        rng = random.Random(number)
        kind = rng.choice(sorted(seeds))
        _, outcome, _ = fuzz.run_case(kind, seeds[kind], rng)
        assert outcome in ("read", "refused"), (number, kind, outcome)


def test_two_campaigns_are_added(fuzz):
    one = json.loads(RESULTS.read_text()) | {"first_seed": 0}
    both = fuzz.added(one, one | {"slowest_seconds": 9.0, "faults": [["x"]]})
    assert both["cases"] == 2 * one["cases"] == sum(both["outcomes"].values())
    assert both["slowest_seconds"] == 9.0
    assert both["faults"] == [["x"]]


def test_the_large_campaign_found_nothing():
    found = json.loads(RESULTS.read_text())
    assert not found["faults"] + found["crashes"] + found["slow"]
    assert sum(found["outcomes"].values()) == found["cases"]
    assert found["outcomes"]["refused"] > found["cases"] / 3, "harmless changes prove little"
