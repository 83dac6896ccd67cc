"""Twins of two commits are compared byte by byte, but for words and times."""

from __future__ import annotations

import json

import pytest


@pytest.fixture
def same_twins(load):
    return load("same_twins")


def twin(folder, mesh="v 0 0 0\n", mass=1.0, note="as photographed"):
    folder.mkdir()
    (folder / "base_visual.obj").write_text(mesh)
    (folder / "twin.yaml").write_text(
        f"mass: {mass}\nnotes:\n- {note}\nbuild: {{version: {note}}}\n")
    (folder / "report.json").write_text(json.dumps({"seconds": note}))
    (folder / "config.yaml").write_text(f"out: {folder}\n")
    return folder


def test_words_and_times_are_no_part_of_a_twin(same_twins, tmp_path):
    one, two = twin(tmp_path / "one"), twin(tmp_path / "two", note="another commit")
    assert same_twins.hashes(one) == same_twins.hashes(two)
    assert set(same_twins.hashes(one)) == {"base_visual.obj", "twin.yaml"}


@pytest.mark.parametrize("change", [{"mesh": "v 0 0 1e-9\n"}, {"mass": 1.0000001}])
def test_the_last_digit_is_seen(same_twins, tmp_path, change):
    before, after = (same_twins.hashes(f) for f in
                     (twin(tmp_path / "one"), twin(tmp_path / "two", **change)))
    table, same = same_twins.comparison({"draft": {"files": before, "seconds": 1.0}},
                                        {"draft": {"files": after, "seconds": 2.0}})
    assert not same
    assert ("base_visual.obj" if "mesh" in change else "twin.yaml") in table


def test_a_file_that_one_commit_lacks_is_a_difference(same_twins, tmp_path):
    before = same_twins.hashes(twin(tmp_path / "one"))
    after = {name: value for name, value in before.items() if name.endswith(".yaml")}
    rows = [{"draft": {"files": files, "seconds": 0.0}} for files in (before, after)]
    assert not same_twins.comparison(*rows)[1]
    assert same_twins.comparison(rows[0], rows[0])[1]


def test_every_way_of_building_is_asked_for_once(same_twins, tmp_path):
    known = same_twins.builds(tmp_path)
    words = [tuple(w) for w in known.values()]
    assert len(set(words)) == len(words)
    assert {name for name in known if name.startswith("draft_")} == {
        f"draft_{name}" for name in same_twins.OBJECTS}
