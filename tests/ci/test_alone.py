"""Many assets at once, each in a process of its own: one that brings it down stops no other."""

from __future__ import annotations

import json
import os
import re
import signal
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.ci import Wishes, alone, check_assets
from part2gs_robotics.ci.alone import Request, check_alone, check_here
from part2gs_robotics.cli import main
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml

SLIDE = """<mujoco><worldbody><body name="b"><joint name="j" type="slide" range="0 1"
  limited="true"/><geom type="box" size=".1 .1 .1"/></body>{more}</worldbody></mujoco>"""
WALL = '<geom type="box" pos="0 0 .5" size=".1 .1 .1"/>'


@pytest.fixture
def assets(tmp_path: Path) -> list[Path]:
    folder = tmp_path / "assets"  # what stands beside them is part of a key
    folder.mkdir()
    texts = {"good.xml": SLIDE.format(more=""), "jammed.xml": SLIDE.format(more=WALL),
             "broken.xml": "<mujoco>"}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return [folder / name for name in texts]


def test_each_asset_has_its_own_report(assets: list[Path], tmp_path: Path) -> None:
    wishes = Wishes(steps=2, cache=tmp_path / "cache", baseline=tmp_path / "known.json",
                    rewrite=True, disabled={"compile": "nobody looks"})
    for _ in range(2):  # once to check, once from the cache
        reports = check_assets(assets, wishes)
        assert [r.path for r in reports] == [str(path) for path in assets]
        assert [r.exit_code for r in reports] == [0, 0, 2], "what cannot be used is never accepted"
        assert "broken.xml" in reports[2].unusable
        assert len(list((tmp_path / "cache").iterdir())) == 2, "nor kept"
    assert list(json.loads((tmp_path / "known.json").read_text())["accepted"]) == [
        "assets/jammed.xml"]


@pytest.mark.parametrize(("body", "said"), [
    ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "ended with SIGSEGV"),
    ("import os; os.abort()", "ended with SIGABRT"),
    ("raise RuntimeError('odd')", r"ended with code 1 on it \(RuntimeError: odd\)"),
    ("import time; time.sleep(60)", "takes more than")])
def test_whatever_ends_the_process_is_an_answer(monkeypatch: pytest.MonkeyPatch, assets: list[Path],
                                                body: str, said: str) -> None:
    monkeypatch.setattr(alone, "SECONDS", 2.0)
    monkeypatch.setattr(alone, "START", body)
    report = check_alone(Request(str(assets[0])))
    assert report.exit_code == 2
    assert re.search(said, report.unusable)


def test_who_interrupts_waits_for_no_check(monkeypatch: pytest.MonkeyPatch,
                                           assets: list[Path]) -> None:
    monkeypatch.setattr(alone, "START", "import time; time.sleep(60)")
    threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        check_assets(assets, Wishes(jobs=2))
    assert time.monotonic() - began < 30


def test_memory_is_limited(monkeypatch: pytest.MonkeyPatch, assets: list[Path]) -> None:
    def greedy(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("part2gs_robotics.sim_checks.check", greedy)
    assert "needs more than" in check_here(Request(str(assets[0]))).unusable


def test_the_folder_one_stands_in_is_not_imported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
                                                  assets: list[Path]) -> None:
    (tmp_path / "json.py").write_text("raise RuntimeError('of somebody')")
    monkeypatch.chdir(tmp_path)
    assert check_alone(Request("assets/broken.xml")).unusable.startswith("assets/broken.xml")


def test_every_format_tells_one_that_cannot_be_used_among_others(
        assets: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [str(path) for path in assets]
    said = {}
    for kind in ("text", "json", "junit", "sarif", "github", "html"):
        assert main(["check", *words, "--sweep-values", "3", "--cache", str(tmp_path / "cache"),
                     "--format", kind]) == 2
        said[kind], err = capsys.readouterr()
        assert err.count("error: ") == 1
        assert "broken.xml" in err
    assert said["text"].count("verdict: ") == 2
    trees = json.loads(said["json"])["assets"]
    assert [(t["path"], t["exit_code"], "error" in t) for t in trees] == [
        (words[0], 0, False), (words[1], 1, False), (words[2], 2, True)]
    assert [suite.get("name") for suite in ET.fromstring(said["junit"].encode())] == words
    found = json.loads(said["sarif"])["runs"][0]["results"]
    places = {r["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] for r in found
              if r["level"] == "error"}
    assert places == {path.as_uri() for path in assets[1:]}
    assert f"::error file={words[2]},line=1" in said["github"]
    assert said["html"].count("<section>") == 3


def test_one_that_cannot_be_used_is_told_alone_too(assets: list[Path],
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(assets[2]), "--json"]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["exit_code"] == 2
    assert json.loads(out)["error"] in err
    assert main(["check", str(assets[2])]) == 2
    assert not capsys.readouterr().out
    assert main(["check"]) == 2


def test_a_twin_folder_that_brings_the_engine_down_is_refused(tmp_path: Path) -> None:
    """MuJoCo puts an unknown class into a format: the C library aborts the process on %n."""
    write_mjcf(toy_cabinet_twin(1), tmp_path / "twin")
    file = tmp_path / "twin/twin.xml"
    write_twin_yaml(toy_cabinet_twin(1), tmp_path / "twin")
    text = file.read_text()
    broken = text.replace('class="toy_cabinet_visual" name="part_1_visual"',
                          'class="%s%n" name="part_1_visual"')
    assert broken != text
    file.write_text(broken)
    (report,) = check_assets([tmp_path / "twin"], Wishes(steps=2))
    assert report.exit_code == 2
    assert "twin" in report.unusable
