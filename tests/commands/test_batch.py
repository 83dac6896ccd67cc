"""Many scenes: one row each, what is done stays, what broke is tried again, pages that hold."""

from __future__ import annotations

import csv
import json
import shutil
import signal
from pathlib import Path
from xml.etree import ElementTree

import pytest
from synth_photos import write_tiny_scene

from part2gs_robotics import cli
from part2gs_robotics.commands import batch_job
from part2gs_robotics.commands.batch import BatchWishes, run_batch, words_of
from part2gs_robotics.commands.batch_job import Job, Row, read_row, run_job
from part2gs_robotics.commands.batch_page import as_csv, as_html, as_junit
from part2gs_robotics.config import resolve
from part2gs_robotics.errors import ConfigError, SceneError
from part2gs_robotics.flags import command_options, parse

EVIL = "<script>alert(1)</script>"


@pytest.fixture
def scenes(tmp_path):
    out = []
    for name in ("a", "b", "c"):
        (tmp_path / "scenes" / name).mkdir(parents=True)
        (tmp_path / "scenes" / name / "transforms.json").write_text(name)
        out.append(tmp_path / "scenes" / name)
    return out


@pytest.fixture
def builds(monkeypatch):
    """Put a child process that ends as told in the place of `build`; return what was started."""
    started, ends = [], {}

    def built(job):
        started.append(job.name)
        codes = ends.get(job.name, [0])
        code = codes.pop(0) if len(codes) > 1 else codes[0]
        Path(job.out).mkdir(parents=True, exist_ok=True)
        checks = [{"name": "overlap", "status": "fail"}] if code == 1 else []
        (Path(job.out) / "report.json").write_text(json.dumps(
            {"joints": [{}, {}], "checks": {"checks": checks}}))
        return code, f"error: {job.name} said {EVIL}" if code else ""

    monkeypatch.setattr(batch_job, "_built", built)
    return started, ends


def run(scenes, out, **values):
    return run_batch(scenes, BatchWishes(out, quiet=True, **values))[0]


def test_every_scene_gets_a_row_and_a_second_run_does_nothing(scenes, builds, tmp_path):
    started, ends = builds
    ends["b"] = [1]
    rows = run(scenes, tmp_path / "twins")
    assert [(row.name, row.outcome, row.parts) for row in rows] == [
        ("a", "built", 2), ("b", "built, checks fail", 2), ("c", "built", 2)]
    assert rows[1].failing == ("overlap",)
    assert run(scenes, tmp_path / "twins") == rows
    assert sorted(started) == ["a", "b", "c"]
    (scenes[1] / "transforms.json").write_text("another")
    run(scenes, tmp_path / "twins")
    run(scenes, tmp_path / "twins", words=("--seed=1",))
    assert sorted(started) == ["a", "a", "b", "b", "b", "c", "c"]


def test_killed_builds_are_tried_again_and_refused_scenes_are_not(scenes, builds, tmp_path):
    started, ends = builds
    ends |= {"a": [-9, 3, 0], "b": [2], "c": [-9]}
    rows = run(scenes, tmp_path / "twins", retries=2)
    assert [(row.outcome, row.tries, row.code) for row in rows] == [
        ("built", 3, 0), ("refused", 1, 2), ("failed", 3, -9)]
    ends["c"] = [0]
    assert run(scenes, tmp_path / "twins")[2].outcome == "built", "a failure is no result"
    assert started.count("a") == 3, "the others keep their rows"


@pytest.mark.parametrize("place", ["local", "slurm here"])
def test_workers_share_the_scenes(scenes, tmp_path, place):
    """Real children, which are refused at once: these scenes hold no cameras."""
    rows = run(scenes, tmp_path / "twins", place=place, workers=2)
    assert [row.outcome for row in rows] == ["refused"] * 3
    assert all("not valid JSON" in row.said for row in rows)


@pytest.mark.slow
def test_workers_of_ray_share_the_scenes(scenes, tmp_path):
    pytest.importorskip("ray")
    rows = run(scenes, tmp_path / "twins", place="ray", workers=2)
    assert [row.outcome for row in rows] == ["refused"] * 3


@pytest.mark.slow
def test_a_batch_of_real_builds_is_interrupted_and_goes_on(tmp_path, monkeypatch):
    first = write_tiny_scene(tmp_path / "one")
    second = Path(shutil.copytree(first, tmp_path / "two"))
    true, killed = batch_job.subprocess.run, []

    def once(words, **rest):
        if not killed:
            killed.append(words)
            signal.raise_signal(signal.SIGINT)
        return true(words, **rest)

    monkeypatch.setattr(batch_job.subprocess, "run", once)
    words = ["batch", str(first), str(second), "-o", str(tmp_path / "twins"), "--quiet"]
    codes = [cli.main(words) for _ in range(2)]
    assert codes[-1] in (0, 1)
    with (tmp_path / "twins/batch.csv").open() as file:
        assert [row["name"] for row in csv.DictReader(file)] == ["one", "two"]


def test_a_worker_that_died_after_its_row_does_no_work_twice(scenes, builds, tmp_path):
    started, _ = builds
    job = Job("a", str(scenes[0]), str(tmp_path / "out"), str(tmp_path / "row.json"), "key")
    row = run_job(job)
    assert run_job(job) == row
    assert started == ["a"]
    assert read_row(tmp_path / "row.json", "another key") is None
    (tmp_path / "row.json").write_text("{")
    assert read_row(tmp_path / "row.json", "key") is None


def test_flags_reach_every_build(tmp_path):
    options = command_options("batch")
    given = parse("batch x --preset draft --no-stereo --up 0 -1 0 --parts 2 --material oakk "
                  "--max-side 99 --depth".replace("oakk", "hardwood").split()).flags
    words = words_of(given, options)
    assert parse(["build", "scene", *words]).flags == given
    assert resolve(given).read.up == (0.0, -1.0, 0.0)


@pytest.mark.parametrize(("wishes", "error", "text"), [
    ({"workers": 0}, ConfigError, "--workers is 0"),
    ({"retries": -1}, ConfigError, "--retries is -1"),
    ({"place": "slurm"}, ConfigError, "--on slurm finds no sbatch"),
])
def test_what_cannot_work_is_said(scenes, tmp_path, wishes, error, text):
    with pytest.raises(error, match=text):
        run(scenes, tmp_path / "twins", **wishes)


def test_scenes_that_cannot_be_are_said_before_anything_starts(scenes, builds, tmp_path):
    twin = tmp_path / "other/a"
    twin.mkdir(parents=True)
    with pytest.raises(ConfigError, match=r"other/a and .*scenes/a would both be"):
        run([*scenes, twin], tmp_path / "twins")
    with pytest.raises(SceneError, match="nothing: is missing"):
        run([tmp_path / "nothing"], tmp_path / "twins")
    assert not builds[0]
    assert not (tmp_path / "twins").exists()
    assert cli.main(["batch", "-o", str(tmp_path / "twins")]) == 2
    assert cli.main(["batch", str(scenes[0]), "--parts", "0"]) == 2


def rows(folder):
    common = {"scene": "s", "key": "k", "tries": 1, "seconds": 1.5, "bytes": 10}
    return [Row(name="good", out=str(folder / "good"), outcome="built", code=0, parts=1,
                failing=(), said="", **common),
            Row(name=EVIL, out=str(folder / EVIL), outcome="refused", code=2, parts=0, failing=(),
                said=f'=cmd()|"{EVIL}\x00\x1b', **common),
            Row(name="half", out=str(folder / "half"), outcome="built, checks fail", code=1,
                parts=3, failing=("overlap",), said="", **common)]


def test_pages_hold_whatever_was_said(tmp_path):
    found = rows(tmp_path)
    page = as_html(tmp_path, found)
    assert EVIL not in page
    assert page.index("&lt;script&gt;") < page.index("good"), "the worst comes first"
    suite = ElementTree.fromstring(as_junit(found))
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("3", "1", "1")
    assert suite.findall("testcase")[1].get("name") == EVIL
    table = list(csv.DictReader(as_csv(found).splitlines()))
    assert [row["outcome"] for row in table] == ["built", "refused", "built, checks fail"]
    assert table[1]["said"].startswith("'="), "no formula for a spreadsheet"
