"""The suite script runs a kit it knows nothing about, and writes its numbers into the pages."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
KIT = """
import argparse, json, pathlib, subprocess, shlex
p = argparse.ArgumentParser()
for flag in ("--out", "--cmd", "--views", "--size", "--seed"): p.add_argument(flag)
p.add_argument("--objects", nargs="+")
a = p.parse_args()
out = pathlib.Path(a.out)
ran = subprocess.run(shlex.split(a.cmd.format(scene="s", out="o")), capture_output=True, text=True)
part = {"matched": True, "watertight": True}
score = {"parts_found": 1, "parts_unmatched": 1, "types_right": 1, "base_watertight": True,
         "compiles": True, "parts": [part], "segmentation": {"miou": 0.91},
         "matched_only": {"angle_deg": 0.123, "line_pct": 0.4, "motion_deg": 0.5,
                          "motion_units": None}}
run = {"exit": ran.returncode, "seconds": 61.2, "peak_mb": 900.0}
missed = {"exit": 2, "seconds": 1.0, "peak_mb": None}
rows = [{"name": a.objects[0], "parts_true": 1, "run": run, "score": score},
        {"name": a.objects[1], "parts_true": 3, "run": missed}]
options = {"views": int(a.views), "size": int(a.size), "seed": int(a.seed)}
(out / "results.json").write_text(json.dumps({"options": options, "cmd": a.cmd, "rows": rows}))
"""


@pytest.fixture
def suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    path = ROOT / "benchmarks/reconstruction_suite.py"
    spec = importlib.util.spec_from_file_location("reconstruction_suite", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    begin, end = module.SUMMARY
    (tmp_path / "results.md").write_text(f"above\n{module.BEGIN}\nold\n{module.END}\nbelow\n")
    (tmp_path / "README.md").write_text(f"first\n{begin}\nold\n{end}\nlast\n")
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit/suite.py").write_text(KIT)
    monkeypatch.setattr(module, "PAGE", tmp_path / "results.md")
    monkeypatch.setattr(module, "README", tmp_path / "README.md")
    monkeypatch.setattr(module, "SHOWN", {"chest": "three drawers", "box": "a lid", "cup": "none"})
    monkeypatch.setattr(module, "RESULTS", tmp_path / "results/suite.json")
    return module


def run(suite: ModuleType, monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr(sys, "argv", ["suite", *words])
    return suite.main()


def test_the_tables_reach_docs_and_readme(
    suite: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    options = ["--objects", "box", "chest", "--cmd", "part2gs-robot --version {scene} {out}"]
    assert run(suite, monkeypatch, "--kit", str(tmp_path / "kit"), *options) == 0
    text = (tmp_path / "results.md").read_text()
    assert text.startswith("above\n")
    assert text.endswith("below\n")
    assert "old" not in text
    assert "| box | 1 of 1 + 1 extra | 1 of 1 | 0.12 | 0.40 | 0.50 | - | 0.910 | yes " in text
    assert "| yes | pass | 61 | 900 |" in text
    assert "| chest | 0 of 3 | 0 of 3 | - | - | - | - | - | no | exit 2 | 1 | - | " in text
    stored = json.loads((tmp_path / "results/suite.json").read_text())
    assert stored["options"] == {"views": 64, "size": 400, "seed": 0}
    assert str(tmp_path) not in json.dumps(stored)  # no paths of the machine
    short = (tmp_path / "README.md").read_text().splitlines()
    assert (short[0], short[-1]) == ("first", "last")
    assert "old" not in short
    assert short[4:6] == ["| three drawers | 0 of 3 | - | exit 2 | 1 |",
                          "| a lid | 1 of 1 + 1 extra | 0.12° | pass | 61 |"]
    (tmp_path / "results.md").write_text(text.replace("| box", "| changed"))
    assert run(suite, monkeypatch) == 0
    assert (tmp_path / "results.md").read_text() == text


def test_objects_that_are_not_run_keep_their_rows_and_commits(suite: ModuleType) -> None:
    earlier = [{"object": name, "commit": "aaa"} for name in ("box", "chest")]
    rows = suite.merged(earlier, [{"object": "box", "commit": "bbb"}])
    assert {row["object"]: row["commit"] for row in rows} == {"chest": "aaa", "box": "bbb"}


def test_without_any_result_it_says_what_to_do(
    suite: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(suite, monkeypatch) == 2
    assert "give --kit PATH" in capsys.readouterr().err


def test_a_failing_kit_is_not_taken_for_a_result(
    suite: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "kit/suite.py").write_text("raise SystemExit(3)")
    with pytest.raises(subprocess.CalledProcessError):
        run(suite, monkeypatch, "--kit", str(tmp_path / "kit"))
    assert not (tmp_path / "results/suite.json").exists()
