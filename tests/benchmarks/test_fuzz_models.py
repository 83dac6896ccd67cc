"""A seeded handful of mutants: none crashes, hangs, or is read outside its folder."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

MUTANTS = 20  # of twenty thousand: a few seconds


def test_a_handful_of_mutants_does_no_harm(load, tmp_path: Path) -> None:
    fuzz = load("fuzz_models")
    found = fuzz.fuzz(tmp_path, range(20_000, 20_000 + MUTANTS), 300.0)
    assert found["mutants"] == MUTANTS == sum(found["verdicts"].values())
    assert set(found["verdicts"]) <= {"passes", "fails", "refused"}
    assert not found["wrong"]
    assert len(found["models"]) >= 3


def test_a_seed_makes_one_mutant(load, tmp_path: Path) -> None:
    fuzz = load("fuzz_models")
    data = b'<a b="1" c="x y"><d e="2.5"/></a>\n<f g="h"/>'
    for deed in fuzz.DEEDS:
        assert deed(data, random.Random(3)) == deed(data, random.Random(3))
        assert deed(b"", random.Random(3)) is not None


@pytest.mark.parametrize(("code", "verdict"), [(0, "passes"), (1, "fails"), (2, "refused"),
                                               (3, "crashed"), (77, "crashed")])
def test_exit_codes_are_verdicts(load, monkeypatch, code: int, verdict: str) -> None:
    fuzz = load("fuzz_models")
    monkeypatch.setattr(fuzz, "code_of", lambda *_: code)
    assert fuzz.checked(Path("none"), None) == verdict


def test_signals_are_verdicts(load, monkeypatch) -> None:
    import os
    import signal

    fuzz = load("fuzz_models")
    for number, verdict in ((signal.SIGSEGV, "killed"), (signal.SIGALRM, "hung")):
        monkeypatch.setattr(fuzz, "code_of", lambda *_, n=number: os.kill(os.getpid(), n))
        assert fuzz.checked(Path("none"), None) == verdict


def test_two_runs_add_up(load) -> None:
    run = {"commit": "a", "mutants": 2, "seconds": 1, "slowest": 0.5, "verdicts": {"fails": 2},
           "models": {"URDF": {"fails": 2}}, "wrong": []}
    other = run | {"commit": "b", "slowest": 0.7, "models": {"USD": {"fails": 2}}}
    found = load("fuzz_models").added(run, other)
    assert (found["mutants"], found["slowest"], found["commit"]) == (4, 0.7, "a, b")
    assert found["verdicts"] == {"fails": 4}
    assert set(found["models"]) == {"URDF", "USD"}
