"""Many assets: cache, baseline, disabled checks, side by side, pytest; nothing new slips by."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from synth import toy_cabinet_twin

from part2gs_robotics import cli
from part2gs_robotics.ci import Wishes, check_assets
from part2gs_robotics.ci.alone import Request
from part2gs_robotics.ci.cache import key_of
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.sim_checks.result import CheckReport, report_of

LID = """<mujoco><worldbody><body name="lid"><joint name="{name}" type="hinge" axis="0 1 0"
    range="0 60" limited="true"/><geom name="board" type="box" size=".2 .2 .01" mass="1"/></body>
    </worldbody><keyframe><key name="state_1" qpos="1"/></keyframe></mujoco>"""
SHORT = LID.replace("0 60", "0 30")  # state 1 lies beyond its range: `limits` fails


def model(folder: Path, text: str = LID, name: str = "hinge") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "lid.xml"
    file.write_text(text.format(name=name))
    return file


def bad(report: CheckReport) -> set[str]:
    return {r.name for r in report.results if r.status in ("fail", "incomplete")}


def test_a_report_comes_back_from_the_cache_as_it_was(tmp_path: Path) -> None:
    file, wishes = model(tmp_path / "a"), Wishes(steps=5, cache=tmp_path / "cache")
    (first,), (second,) = check_assets([file], wishes), check_assets([file], wishes)
    assert replace(second, seconds=first.seconds, notes=first.notes) == first
    assert second.seconds < 0.2, "that is what a cache is for"
    assert second.notes[-1].startswith("from the cache")
    assert report_of(json.loads(json.dumps(first.to_dict()))).results == first.results
    moved = model(tmp_path / "b")
    assert check_assets([moved], wishes)[0].path == str(moved), "content counts, not the place"
    assert check_assets([moved], wishes)[0].notes[-1].startswith("from the cache")


def test_whatever_changes_a_verdict_changes_the_key(tmp_path: Path) -> None:
    file = model(tmp_path / "a")
    asked = Request(str(file))
    key = key_of(asked)
    hows = [replace(asked, steps=5), replace(asked, samples=9), replace(asked, stress=True),
            replace(asked, root=str(tmp_path))]
    assert key == key_of(asked)
    assert len({key, *map(key_of, hows)}) == 5
    (file.parent / "mesh.obj").write_text("v 0 0 0")
    beside = key_of(asked)
    file.write_text(LID.format(name="other"))
    assert len({key, beside, key_of(asked)}) == 3
    for other, same in (("beside.obj", False), (".git/index", True), ("kept/a.json", True)):
        before = key_of(hows[-1], tmp_path / "kept")  # what --root lets it name counts as well
        (tmp_path / other).parent.mkdir(exist_ok=True)
        (tmp_path / other).write_text("v 0 0 0")
        assert (key_of(hows[-1], tmp_path / "kept") == before) == same


def test_a_damaged_cache_is_no_verdict(tmp_path: Path) -> None:
    file, cache = model(tmp_path / "a", SHORT), tmp_path / "cache"
    first = check_assets([file], Wishes(steps=5, cache=cache))[0]
    for text in ("", "{}", '{"checks": 3}', "[1]"):
        (cache / f"{key_of(Request(str(file), steps=5))}.json").write_text(text)
        again = check_assets([file], Wishes(steps=5, cache=cache))[0]
        assert again.results == first.results
        assert not again.ok


def test_known_failures_pass_and_new_ones_fail(tmp_path: Path) -> None:
    file, baseline = model(tmp_path / "a", SHORT), tmp_path / "ci" / "known.json"
    baseline.parent.mkdir()
    before = check_assets([file], Wishes(steps=5))[0]
    assert "limits" in bad(before)
    wishes = Wishes(steps=5, baseline=baseline, rewrite=True)
    assert check_assets([file], wishes)[0].exit_code == 0
    assert list(json.loads(baseline.read_text())["accepted"]) == ["../a/lid.xml"]
    known = check_assets([file], Wishes(steps=5, baseline=baseline))[0]
    assert known.exit_code == 0
    assert any(r.status == "warn" and "accepted by" in r.detail for r in known.results)
    renamed = model(tmp_path / "a", SHORT, "another")  # its failure is about another joint: new
    new = check_assets([renamed], Wishes(steps=5, baseline=baseline))[0]
    assert new.exit_code == 1
    assert any("does not fail any more" in note for note in new.notes)
    other = model(tmp_path / "b", SHORT)
    assert check_assets([other], Wishes(steps=5, baseline=baseline))[0].exit_code == 1


def test_a_disabled_check_says_why_and_hides_no_other(tmp_path: Path) -> None:
    file = model(tmp_path / "a", SHORT)
    before = check_assets([file], Wishes(steps=5))[0]
    after = check_assets([file], Wishes(steps=5, disabled={"limits": "a stop is to come"}))[0]
    assert bad(after) == bad(before) - {"limits"}
    (row,) = [r for r in after.results if r.name == "limits"]
    assert row.status == "skipped"
    assert "disabled (a stop is to come); it said fail" in row.detail
    assert "limits is disabled: a stop is to come" in after.notes


def test_side_by_side_says_the_same_in_the_same_order(tmp_path: Path) -> None:
    files = [model(tmp_path / "a"), model(tmp_path / "b", SHORT)]
    alone = [check_assets([f], Wishes(steps=5))[0] for f in files]
    both = check_assets(files, Wishes(steps=5, jobs=2))
    assert [r.path for r in both] == [str(f) for f in files]
    assert [r.results for r in both] == [r.results for r in alone]
    assert [r.exit_code for r in both] == [0, 1]


@pytest.mark.parametrize(("flags", "said"), [
    (["--disable", "limits"], "says no reason"),
    (["--disable", "limitz=why"], "no such check id"),
    (["--baseline", "none.json"], "is no baseline"),
    (["--write-baseline"], "has no file"),
    (["--samples", "5"], "holds no twin.yaml"),
    (["nowhere"], "does not exist"),
    (["--jobs", "-1"], "whole number from 0 up"),
])  # fmt: skip
def test_bad_wishes_are_bad_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                  flags: list[str], said: str) -> None:
    assert cli.main(["check", str(model(tmp_path)), *flags]) == 2
    assert said in capsys.readouterr().err


def test_the_worst_asset_is_the_exit_code(tmp_path: Path,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    files = [str(model(tmp_path / "a")), str(model(tmp_path / "b", SHORT))]
    assert cli.main(["check", *files, "--jobs", "1"]) == 1
    out = capsys.readouterr().out
    assert out.count("verdict: ") == 2
    assert cli.main(["check", *files, "--jobs", "1", "--disable", "limits=a stop is to come",
                     "--disable", "hold=the same", "--disable", "passive=the same"]) == 0


def test_a_cache_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckError, match="cannot keep results"):
        check_assets([model(tmp_path / "a")], Wishes(steps=5, cache=tmp_path / "file" / "cache"))


def test_sizes_that_are_not_known_come_back(tmp_path: Path) -> None:
    report = CheckReport("x", "mujoco", ())
    assert math.isnan(report_of(report.to_dict()).size)


def test_pytest_collects_a_twin_one_test_a_check(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(1)
    part = replace(twin.parts[1], limits=(0.0, 0.1))  # does not hold state 1
    twin = replace(twin, parts=(twin.parts[0], part))
    for write in (write_mjcf, write_urdf, write_twin_yaml):
        write(twin, tmp_path)
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rf", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True, text=True, cwd=tmp_path, check=False)
    assert found.returncode == 1, found.stdout + found.stderr
    failed = {line.split("::")[-1].split()[0] for line in found.stdout.splitlines()
              if line.startswith("FAILED")}
    assert "limits" in failed
    assert "outside: state_1" in found.stdout
    assert "Traceback" not in found.stdout
    assert " passed" in found.stdout
