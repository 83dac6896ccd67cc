"""Plan and log: what a build says before, while and after it runs."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from synth_photos import write_ball_scene

from part2gs_robotics import plan as plan_room
from part2gs_robotics.config import Config, ReadConfig, resolve
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.plan import TERMS, Plan, PlanItem, make_plan
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.runtime import log


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return read_scene(write_ball_scene(tmp_path_factory.mktemp("b") / "scene"), ReadConfig())


def test_plan_says_why_for_every_item(scene: Scene) -> None:
    plan = make_plan(scene, Config())
    assert all(item.reason for item in plan.items)
    assert len({item.name for item in plan.items}) == len(plan.items)
    assert len(plan.lines()) == len(plan.items) == len(plan.rows())


def test_depth_term_follows_the_scene(scene: Scene) -> None:
    assert not make_plan(scene, Config())["depth term"].used
    shape = scene.states[0].alphas.shape
    deep = replace(scene.states[0], depths=np.ones(shape, np.float32))
    with_depth = replace(scene, states=(deep, scene.states[1]))
    assert make_plan(with_depth, Config())["depth term"].used
    assert "one state" in make_plan(with_depth, Config())["depth term"].reason


def test_part_competition_follows_the_number_of_parts(scene: Scene) -> None:
    one, two, unknown = (make_plan(scene, resolve(flags))["part competition"]
                         for flags in ({"parts": 1}, {"parts": 2}, {}))
    assert (one.used, one.decided) == (False, "before")
    assert (two.used, two.decided) == (True, "before")
    assert unknown.decided == "during"


def test_search_only_without_parts_and_centres_are_never_averaged(scene: Scene) -> None:
    assert make_plan(scene, Config())["search for number of parts"].used
    assert not make_plan(scene, resolve({"parts": 1}))["search for number of parts"].used
    assert not make_plan(scene, Config())["centre averaging"].used
    assert not make_plan(scene, resolve({"paper_mode": True}))["centre averaging"].used


def test_every_term_is_in_the_plan_and_follows_its_flag(scene: Scene) -> None:
    for name, title in TERMS.items():
        on, off = (make_plan(scene, resolve({name: value}))[title] for value in (True, False))
        assert (on.used, on.decided, off.used, off.decided) == (True, "during", False, "before")
        assert f"--{name.replace('_', '-')} switches it on" in off.reason
        assert "as printed" in make_plan(scene, resolve({name: True, "paper_mode": True}))[
            title].reason
    for name, title in {"identity": "part identities", "alignment": "alignment to images"}.items():
        assert make_plan(scene, Config())[title].used
        off = make_plan(scene, resolve({name: False}))[title]
        assert not off.used
        assert off.reason.startswith(f"off by --no-{name}")
    assert not make_plan(scene, resolve({"paper_mode": True}))["alignment to images"].used


def test_the_plan_quotes_what_the_ablation_measured(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / plan_room.MEASURED).write_text('{"repel": "no difference; 9 runs"}')
    monkeypatch.setattr(plan_room.resources, "files", lambda _: tmp_path)
    plan = make_plan(scene, Config())
    assert plan["repel points"].reason.endswith("switches it on; ablation: no difference; 9 runs")
    assert "ablation" not in plan["contact loss"].reason


def test_images_leave_a_term_out_of_a_scene_where_they_keep_no_pull(scene: Scene) -> None:
    plan = make_plan(scene, resolve({"repel": True}))
    kept, left = (plan.settle_terms(3, pulled, 40, paper=False) for pulled in (2, 0))
    for title in ("contact loss", "vector-field loss"):
        assert kept[title].used
        assert "images keep the pull on 2 of 3 joints" in kept[title].reason
        assert not left[title].used
    assert kept["repel points"].reason.startswith("40 points between parts; images keep")
    assert not plan.settle_terms(3, 2, 0, paper=False)["repel points"].used
    assert kept["velocity loss"] == plan["velocity loss"], "off, so nothing to decide"
    assert "paper mode" in plan.settle_terms(3, 3, 40, paper=True)["contact loss"].reason


def test_settling_changes_one_item() -> None:
    plan = Plan((PlanItem("a", True, "open", "during"), PlanItem("b", True, "always")))
    settled = plan.settle("a", False, "nothing to do")
    assert settled["a"] == PlanItem("a", False, "nothing to do", "during")
    assert settled["b"] == plan["b"]


def test_log_writes_json_lines_and_keeps_old_ones(tmp_path: Path,
                                                  capsys: pytest.CaptureFixture[str]) -> None:
    for number in ("31.2 dB", "loaded"):
        with log.logging_to(tmp_path):
            log.log_stage("fit_0", 12.5, number)
            logging.getLogger("part2gs_robotics.fit.fit_state").debug("detail")
    events = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert [event.get("number") for event in events] == ["31.2 dB", None, "loaded", None]
    assert events[0]["stage"] == "fit_0"
    assert events[0]["seconds"] == 12.5
    shown = capsys.readouterr().err
    assert "31.2 dB" in shown
    assert "detail" not in shown


@pytest.mark.parametrize(("quiet", "verbose", "lines"), [
    (False, False, 2), (True, False, 1), (False, True, 3)])
def test_loudness(quiet: bool, verbose: bool, lines: int,
                  capsys: pytest.CaptureFixture[str]) -> None:
    logger = logging.getLogger("part2gs_robotics.test")
    with log.logging_to(None, quiet, verbose):
        logger.debug("a")
        logger.info("b")
        logger.warning("c")
    assert len(capsys.readouterr().err.splitlines()) == lines


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_on_a_terminal_shows_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 10.0, 10.1, 20.0])
    monkeypatch.setattr(log.time, "monotonic", lambda: next(clock))
    stream = Terminal()
    with log.logging_to(None):
        progress = log.Progress("fit", "dB", stream)
        for step in (10, 11, 20):
            progress(step, 100, 30.0)
    assert stream.getvalue().count("\r") == 2, "not more often than the eye sees"
    assert stream.getvalue().split("\r")[1].endswith("fit: 10/100, 30 dB"), "no pace known yet"
    assert "fit: 20/100, 30 dB, 1:20 left" in stream.getvalue()


def test_progress_without_a_terminal_is_a_line_per_half_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:
    clock = iter(float(second) for second in range(100))
    monkeypatch.setattr(log.time, "monotonic", lambda: next(clock))
    with log.logging_to(None):
        progress = log.Progress("fit", stream=StringIO())
        for step in range(1, 91):
            progress(step, 100)
    assert capsys.readouterr().err.splitlines() == ["fit: 30/100, 1:10 left",
                                                    "fit: 60/100, 0:40 left",
                                                    "fit: 90/100, 0:10 left"]
