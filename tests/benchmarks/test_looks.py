"""The table of looks: every object once, in the suite's order, the mean last."""

from __future__ import annotations

import json
import sys

import pytest

KIT = '''
import json, sys
runs, scenes = sys.argv[sys.argv.index("--all") + 1:][:2]
row = {"psnr_db": 20.06, "ssim": 0.9, "mask_iou": 0.97, "faces": 9000, "rough": 0.25,
       "normal_deg": 1.04, "textured": True}
rows = {name: row for name in ("own", "libero_microwave", "mean")}
assert runs.endswith("runs/tag") and scenes.endswith("scenes/tag")
open(sys.argv[sys.argv.index("--json") + 1], "w").write(json.dumps(rows))
'''


@pytest.fixture
def module(load):
    return load("looks")


def test_numbers_of_a_kit_become_rows(module, tmp_path, monkeypatch):
    kit = tmp_path / "kit"
    kit.mkdir()
    (kit / "look.py").write_text(KIT)
    for name in ("runs", "scenes"):
        (tmp_path / "work" / name / "tag").mkdir(parents=True)
    page = tmp_path / "results.md"
    page.write_text("before\n{}\nold\n{}\nafter\n".format(*module.MARKS))
    monkeypatch.setattr(module, "RESULTS", tmp_path / "looks.json")
    monkeypatch.setattr(module, "PAGE", page)
    monkeypatch.setattr(sys, "argv", ["looks.py", "--kit", str(kit), "--work",
                                      str(tmp_path / "work")])
    assert module.main() == 0
    lines = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    assert [line.split(" | ")[0] for line in lines[1:]] == ["| libero_microwave", "| own", "| mean"]
    assert "| 20.1 | 0.900 | 0.970 | 1.0 | 0.25 | 9000 |" in lines[1]
    assert "old" not in page.read_text()
    assert set(json.loads((tmp_path / "looks.json").read_text())["own"]) >= {"commit", "psnr_db"}


def test_without_numbers_it_says_what_to_give(module, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(module, "RESULTS", tmp_path / "none.json")
    monkeypatch.setattr(sys, "argv", ["looks.py"])
    assert module.main() == 2
    assert "--kit" in capsys.readouterr().err
