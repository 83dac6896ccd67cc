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
