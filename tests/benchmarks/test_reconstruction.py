"""Error against run time: fabricated builds give the table, figure and plan they must give."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", "docs/results.md", "docs/ablation.md")
NAMES = ("reconstruction", "reconstruction_figure", "reconstruction_runs", "reconstruction_table",
         "reconstruction_suite", "plan_table")

# A kit whose builds take no time: errors halve with twice the steps, all is in flags and folder.
KIT = """
import argparse, json, pathlib
p = argparse.ArgumentParser()
for word in ("--out", "--cmd", "--views", "--size", "--seed"):
    p.add_argument(word, required=True)
p.add_argument("--objects", nargs="+", required=True)
a = p.parse_args()
words, name = a.cmd.split(), a.objects[0]
steps = float(words[words.index("--steps") + 1]) if "--steps" in words else 100.0
out = pathlib.Path(a.out, "runs", "tag", name)
log = pathlib.Path(__file__).with_name("calls")
log.write_text((log.read_text() if log.exists() else "") + a.cmd + chr(10))
again = (out / "log.jsonl").exists()
out.mkdir(parents=True, exist_ok=True)
(out / "report.json").write_text(json.dumps({
    "scene": {"held_out_psnr_0": 30.0, "held_out_psnr_1": 34.0},
    "curves": [{"seconds": [1, 2], "psnr_db": [20, 30]}, {"seconds": [3, 5], "psnr_db": [24, 34]}],
}))
event = lambda stage, s, old: json.dumps(
    {"event": "stage", "stage": stage, "seconds": s, "resumed": old}) + chr(10)
with (out / "log.jsonl").open("a") as f:
    f.write(event("read", 1.0, False) + event("fit_0", 0.1 if again else 9.0, again)
            + '{"event": "note"}' + chr(10) + event("mesh", 2.0 if again else 6.0, False)
            + event("export and check", 5.0, False))
cd = {"cd": 2.0, "cd_floor": 0.5}
score = {"parts_found": 1, "parts_unmatched": 0, "types_right": 1, "base_watertight": True,
         "compiles": True, "parts": [{"matched": True, "watertight": True}],
         "segmentation": {"miou": 0.9}, "static": cd, "whole": cd, "moving_floor": {"cd": 0.5},
         "matched_only": {"angle_deg": 40 / steps, "line_pct": 0.4, "motion_deg": 0.5,
                          "motion_units": None, "cd": 3.0},
         "with_misses": {"angle_deg": 40 / steps, "line_pct": 0.4, "motion_deg": 0.5,
                         "motion_units": None, "cd": 3.0}}
row = {"name": name, "parts_true": 1, "score": score,
       "run": {"exit": 0, "seconds": steps / 10, "peak_mb": 900.0}}
pathlib.Path(a.out, "results.json").write_text(json.dumps({
    "options": {"views": int(a.views), "size": int(a.size)}, "cmd": a.cmd, "rows": [row]}))
"""


@pytest.fixture(scope="module")
def modules(load: Callable[[str], ModuleType]) -> dict[str, ModuleType]:
    return {name: load(name) for name in NAMES}


@pytest.fixture
def kit(tmp_path: Path) -> Path:
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit/suite.py").write_text(KIT)
    return tmp_path / "kit"


def build(share: float, **more: Any) -> dict[str, Any]:
    """Return a fabricated row."""
    errors = {"angle_deg": 0.1 / share, "line_pct": 0.2 / share, "motion_deg": 0.3 / share,
              "motion_units": None}
    row = {"object": "box", "preset": "draft", "device": "cpu", "share": share, "steps": 400,
           "parts_true": 1, "parts_found": 1, "parts_extra": 0, "types_right": 1, "miou": 0.9,
           "seconds": 60.0 * share, "peak_mb": 800.0, "psnr_db": 33.0, "cd_m": 2.0,
           "cd_m_floor": 0.25, "cd_s": 1.0, "cd_s_floor": 0.5, "cd_w": 1.5, "cd_w_floor": 0.5,
           "curve": [[1.0, 20.0], [2.0, 30.0], [10.0, 33.0]], "missed": errors | {"cd": 2.0},
           **errors}
    return row | more


def result(rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {"rows": rows, "options": {"views": 64, "size": 400}, "machine": "2 CPU cores, x86_64",
            "commit": "abc", "date": "2026-01-01"}


def test_the_table_holds_medians_worst_and_completeness(modules: dict[str, ModuleType]) -> None:
    rows = [build(1.0), build(1.0, object="bin", angle_deg=0.3, seconds=80.0),
            build(1.0, object="cup", angle_deg=0.2, parts_extra=1),
            build(0.25, angle_deg=None, parts_found=0, types_right=0, peak_mb=None)]
    text = modules["reconstruction_table"].markdown(result(rows))
    lines = text.splitlines()
    assert lines[2].startswith("| draft | 1/4 | 15 | 0 of 1 | - | 0.80 | 1.20 | - |")
    assert lines[3].startswith("| draft | 1 | 60 (80) | 2 of 3 | 0.20 (0.30) | 0.20 (0.20) |")
    assert "| 1.00 [0.50] | 2.00 [0.25] | 1.50 [0.50] | 0.900 (0.900) | 33.0 | 800 |" in lines[3]
    assert "Medians over 3 objects" in lines[-1]
    columns = {line.count("|") for line in lines[:4]}
    assert len(columns) == 1


def test_groups_come_by_device_preset_and_share(modules: dict[str, ModuleType]) -> None:
    rows = [build(1.0, preset="high"), build(1.0), build(0.5), build(1.0, device="cuda"),
            build(1.0, preset="standard")]
    found = list(modules["reconstruction_table"].grouped(rows))
    assert found == [("cpu", "draft", 0.5), ("cpu", "draft", 1.0), ("cpu", "standard", 1.0),
                     ("cpu", "high", 1.0), ("cuda", "draft", 1.0)]


def test_curves_are_of_objects_built_with_every_share(modules: dict[str, ModuleType]) -> None:
    rows = [*(build(share, object="a", preset="standard") for share in (1.0, 0.5)),
            build(1.0, object="b", preset="standard"), build(1.0, object="b", preset="draft")]
    assert modules["reconstruction_table"].comparable(rows) == [*rows[:2], rows[3]]


def test_rows_of_earlier_runs_stay_unless_built_anew(modules: dict[str, ModuleType],
                                                     tmp_path: Path) -> None:
    out = tmp_path / "found.json"
    old = [build(1.0, object="a", miou=0.1), build(1.0, object="b")]
    merged = modules["reconstruction"].merged
    assert merged(out, old) == old
    out.write_text(json.dumps({"rows": old}))
    new = build(1.0, object="a", miou=0.9)
    assert merged(out, [new]) == [new, old[1]]


def test_the_figure_shows_every_preset_in_its_colour(modules: dict[str, ModuleType],
                                                     tmp_path: Path) -> None:
    figure = modules["reconstruction_figure"]
    rows = [build(share, preset=preset, seconds=60 * share * k)
            for k, preset in enumerate(figure.COLORS, 1) for share in (0.25, 0.5, 1.0)]
    figure.draw(result(rows), tmp_path / "sub/figure.png")
    image = cv2.imread(str(tmp_path / "sub/figure.png"))
    assert image.shape[:2] == (2 * figure.TALL // 2, 4 * figure.WIDE // 2)
    for color in figure.COLORS.values():
        assert (np.abs(image.astype(int) - color).max(2) < 8).sum() > 200
    assert figure.color("draft", "cuda") != figure.color("draft", "cpu")


@pytest.mark.parametrize("row", [
    build(1.0, missed={}, miou=None, curve=[]),
    build(1.0, missed={"angle_deg": 0.0, "line_pct": 0.0, "motion_deg": 0.0, "cd": 0.0}, miou=1.0,
          curve=[[0.0, 20.0], [0.0, 20.0]]),
])
def test_a_figure_of_nothing_or_of_no_error_can_be_drawn(
        modules: dict[str, ModuleType], tmp_path: Path, row: dict[str, Any]) -> None:
    modules["reconstruction_figure"].draw(result([row]), tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 0


def test_shorter_builds_stand_left_of_longer_ones(modules: dict[str, ModuleType]) -> None:
    figure = modules["reconstruction_figure"]
    groups = modules["reconstruction_table"].grouped([build(s) for s in (1 / 16, 1.0)])
    dots = figure.error(groups, "axis", figure.missed("angle_deg"))
    rows, cols = np.nonzero(np.abs(dots.astype(int) - figure.COLORS["draft"]).max(2) < 8)
    low, high = rows[cols < cols.min() + 10].mean(), rows[cols > cols.max() - 10].mean()
    assert low < high  # images grow downwards: the shorter build's error is larger


def test_a_quick_run_resumes_and_leaves_the_repository_alone(
        modules: dict[str, ModuleType], kit: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--kit", str(kit), "--work", str(tmp_path / "work"), "--quick", "--objects", "box"]
    before = [(ROOT / page).read_bytes() for page in PAGES]
    main = modules["reconstruction"].main
    assert main(words) == 0
    first = capsys.readouterr().out
    calls = (kit / "calls").read_text().splitlines()
    assert len(calls) == 2
    assert all("--preset draft" in call and "--device cpu" in call for call in calls)
    steps = [int(call.split("--steps ")[1].split()[0]) for call in calls]
    assert steps[0] == round(4 * steps[1])
    assert main(words) == 0
    assert capsys.readouterr().out == first
    assert (kit / "calls").read_text().splitlines() == calls  # nothing was built again
    rows = json.loads((tmp_path / "work/reconstruction_quick.json").read_text())["rows"]
    assert rows[0]["curve"] == [[4.0, 22.0], [7.0, 32.0]]  # seconds add up, dB are averaged
    assert rows[0]["psnr_db"] == 32.0
    assert rows[0]["cd_m_floor"] == 0.5
    assert rows[0]["stages"]["fit_0"] == {"seconds": 9.0, "resumed": False}  # each from nothing
    assert (tmp_path / "work/reconstruction.png").exists()
    assert [(ROOT / page).read_bytes() for page in PAGES] == before
    (tmp_path / "work/rows" / "box_draft_cpu_1.json").write_text("{}")
    assert main([*words, "--seed", "1"]) == 0
    assert len((kit / "calls").read_text().splitlines()) == 4  # another seed is another build


def test_without_any_result_it_says_what_to_do(modules: dict[str, ModuleType], tmp_path: Path,
                                               capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("reconstruction", "plan_table"):
        assert modules[name].main(["--quick", "--work", str(tmp_path)]) == 2
        assert "give --kit PATH" in capsys.readouterr().err


def test_an_interrupted_row_leaves_nothing_behind(modules: dict[str, ModuleType],
                                                  tmp_path: Path) -> None:
    kept, path = modules["reconstruction_runs"].kept, tmp_path / "rows/a.json"

    def stop() -> dict[str, Any]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        kept(path, {"seed": 0}, stop)
    assert not path.exists()
    assert kept(path, {"seed": 0}, lambda: {"n": 1}) == {"n": 1}
    assert kept(path, {"seed": 0}, stop) == {"n": 1}
    assert kept(path, {"seed": 1}, lambda: {"n": 2}) == {"n": 2}


def test_whole_budgets_come_first_and_every_job_once(modules: dict[str, ModuleType]) -> None:
    bench = modules["reconstruction"]
    jobs = list(bench.jobs(bench.parser().parse_args(["--devices", "cpu"])))
    assert len(set(jobs)) == len(jobs) == 9 * 3 * 5
    assert [job[3] for job in jobs[:27]] == [1.0] * 27


def test_a_switch_saves_only_where_stages_ran_again(modules: dict[str, ModuleType]) -> None:
    def stages(**seconds: tuple[float, bool]) -> dict[str, Any]:
        return {"stages": {name: {"seconds": s, "resumed": old}
                           for name, (s, old) in seconds.items()}}

    base = stages(read=(1, False), fit_0=(30, False), articulate=(50, False), mesh=(20, False))
    other = stages(read=(9, False), fit_0=(0.1, True), articulate=(35, False), mesh=(21, False))
    other["stages"]["export and check"] = {"seconds": 99.0, "resumed": False}
    assert modules["plan_table"].saved(base, other) == 14
    assert modules["plan_table"].saved(base, other, used=False) == -14


def test_the_plan_is_measured_with_stages_taken_over(
        modules: dict[str, ModuleType], kit: Path, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--kit", str(kit), "--work", str(tmp_path / "work"), "--quick", "--objects", "box"]
    assert modules["plan_table"].main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2].startswith("| nothing |  | - | 1 of 1 | 0.40 | 0.40 | 0.50 | - | 3.00 | 0.900")
    assert lines[3].startswith("| convex decomposition | on | 4.0 (4.0 to 4.0) | 1 of 1 |")
    assert lines[4].startswith("| hollows by stereo | on | 4.0 (4.0 to 4.0) |")
    assert lines[5].startswith("| simulator checks | on | 5.0 (5.0 to 5.0) |")
    assert len({line.count("|") for line in lines[:6]}) == 1
    assert "--no-convex" in (kit / "calls").read_text()


def test_a_thing_that_is_off_is_shown_both_ways(modules: dict[str, ModuleType]) -> None:
    stages = {"mesh": {"seconds": 5.0, "resumed": False}}
    longer = {"mesh": {"seconds": 7.0, "resumed": False}}
    rows = [build(1.0, thing="as it is", used=True, stages=stages),
            build(1.0, thing="repel points", used=False, stages=longer, angle_deg=0.5)]
    text = modules["plan_table"].markdown(result(rows) | {"preset": "draft"})
    assert "| repel points | off | 2.0 (2.0 to 2.0) | 1 of 1 | 0.10 |" in text
    assert "| with repel points |  | - | 1 of 1 | 0.50 |" in text


def test_only_what_stands_between_markers_is_replaced(modules: dict[str, ModuleType]) -> None:
    for name in ("reconstruction", "plan_table"):
        text = modules[name].PAGE.read_text()
        begin, end = modules[name].BEGIN, modules[name].END
        new = modules["reconstruction_suite"].insert(text, "new\n", begin, end)
        assert f"{begin}\nnew\n{end}" in new
        assert new.startswith(text[:text.index(begin)])
        assert new.endswith(text[text.index(end):])
