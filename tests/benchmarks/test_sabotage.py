"""Sabotage is done, found by the check meant for it, and counted; a clean twin stays clean."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

RESULTS = Path(__file__).resolve().parents[2] / "benchmarks/results"
EVERY = 13  # of the kinds: all of them take minutes


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return tmp_path_factory.mktemp("sabotage")


def test_every_thirteenth_kind_is_caught_again_as_stored(load, clean) -> None:
    sabotage = load("sabotage")
    twin = sabotage.cabinet(clean / "cabinet")
    stored = {r["kind"]: r for r in json.loads((RESULTS / "sabotage.json").read_text())[0]["rows"]}
    assert set(stored) <= {k.name for k in sabotage.KINDS}
    for kind in sabotage.KINDS:
        if kind.name not in stored:  # of two textures, for one: other twins have them
            with pytest.raises(load("sabotage_tools").NotHereError):
                kind.deed(twin)
    for kind in [k for k in sabotage.KINDS if k.name in stored][::EVERY]:
        copy = clean / "broken"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(twin, copy)
        kind.deed(copy)
        verdict, report, _ = sabotage.asked(copy, ("files",), set())
        names = {r.name for r in report.results if r.status == "fail"} if report else set()
        found = stored[kind.name]
        if found["verdict"] == "refused":
            assert verdict == "refused", kind.name
        else:
            assert found["check"] in names or verdict == "passed", kind.name


def test_kinds_are_many_and_their_names_differ(load) -> None:
    kinds = load("sabotage").KINDS
    assert len({k.name for k in kinds}) == len(kinds) >= 100
    catalogue = load("part2gs_robotics.agree.catalogue").CHECKS
    assert {check for k in kinds for check in k.meant} <= set(catalogue)


def test_what_is_not_there_is_not_counted(load, clean) -> None:
    tools = load("sabotage_tools")
    (clean / "twin.xml").write_text("<mujoco/>")
    with pytest.raises(tools.NotHereError):
        tools.put("twin.xml", ".//joint", "axis", "1 0 0")(clean)
    with pytest.raises(tools.NotHereError):
        tools.file("none.obj", None)(clean)


def test_the_table_counts_what_rows_say(load) -> None:
    row = {"kind": "k", "verdict": "caught", "check": "same mass", "named": True,
           "physics": "passed", "cause": "", "simcheck": "caught", "sha256": "catches"}
    rows = [row, row | {"verdict": "passed", "named": False, "simcheck": "not read",
                        "sha256": "names"}]
    text = load("sabotage").markdown([{"twin": "t", "commit": "c", "clean": [], "seconds": 2.0,
                                       "files_seconds": 0.2, "rows": rows}])
    assert "2 kinds; 1 caught by the check meant for it, 0 by another, 0 refused" in text
    assert "1 passed; 1 name the file at fault. 1 are caught by the sha256 of files alone" in text
    assert "By physics alone 0 caught, 0 refused, 0 crashed, 2 passed" in text
    assert "simcheck catches 1, passes 0, and does not read what 1 change" in text


def test_sha256_are_asked_after_all_else(load, clean) -> None:
    sabotage = load("sabotage")
    twin = sabotage.cabinet(clean / "signed")
    kinds = {k.name: k for k in sabotage.KINDS}
    found = sabotage.sabotaged(twin, [kinds["texture: mirrored"], kinds["texture black"]],
                               clean, alone=False)["rows"]
    assert [(r["verdict"], r["check"], r["sha256"]) for r in found] == [
        ("caught", "assets", "catches"), ("caught", "same look", "")]


def test_the_table_of_twins_counts_what_entries_say(load) -> None:
    odd = {"kind": "k", "verdict": "other", "check": "compile", "named": False, "cause": ""}
    entry = {"twin": "t", "commit": "c", "clean": [], "joints": 2, "kinds": 50, "named": 49,
             "counts": {"caught": 45, "refused": 4, "other": 1}, "odd": [odd]}
    text = load("sabotage").table_of_twins([entry, entry | {
        "twin": "u", "clean": ["mesh: a"], "sha256": ["k", "l"]}])
    assert "100 broken copies of 2 twins: 98 (98.0%) caught" in text
    assert "Rows that fail on clean twins: 1" in text
    assert "2 are caught by the sha256 of files alone" in text
    assert "By sha256 alone, and of how many twins: k (1), l (1)." in text
    assert "- t: k: other by compile, file not named" in text


def test_simcheck_is_asked_what_changed(load, clean) -> None:
    rival = load("sabotage_rival")
    one, two = clean / "one", clean / "two"
    for folder in (one, two):
        (folder / "assets").mkdir(parents=True)
        for name in (*rival.READS, "twin.yaml", "assets/a.obj"):
            (folder / name).write_text("same")
    assert rival.changed(one, two) == []
    (two / "twin.yaml").write_text("other")
    assert rival.changed(one, two) == []
    (two / "twin.urdf").write_text("other")
    assert rival.changed(one, two) == ["twin.urdf"]
    (two / "assets/a.obj").write_text("other")
    assert set(rival.changed(one, two)) == {"twin.xml", "twin.urdf"}
