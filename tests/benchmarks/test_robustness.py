"""Robustness benchmark: what is spoiled is spoiled, and nothing else."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import robustness
import robustness_scene
from robustness_figure import curve, draw


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for state in ("start", "end"):
        folder = tmp_path / "scene" / state / "train/rgba"
        folder.mkdir(parents=True)
        for n in range(21):
            image = rng.integers(0, 200, (20, 40, 4), dtype=np.uint8)
            cv2.imwrite(str(folder / f"{n:03d}.png"), image)
    return tmp_path / "scene"


def images(scene: Path, state: str) -> np.ndarray:
    return np.stack([robustness_scene.read(p) for p in robustness_scene.photos(scene, state)])


def test_one_mask_in_twenty_is_shifted_and_no_colour(scene: Path, tmp_path: Path) -> None:
    code = robustness_scene.main(["masks", str(scene), str(tmp_path / "copy"), "true", "COPY"])
    assert code == 0
    for state in ("start", "end"):
        before, after = images(scene, state), images(tmp_path / "copy", state)
        np.testing.assert_array_equal(before[..., :3], after[..., :3])
        changed = np.flatnonzero((before != after).any((1, 2, 3)))
        assert changed.tolist() == [0, 20]
        np.testing.assert_array_equal(np.roll(before[0, ..., 3], 6, 1), after[0, ..., 3])


def test_exposure_changes_the_colours_of_state_1_alone(scene: Path, tmp_path: Path) -> None:
    robustness_scene.main(["exposure", str(scene), str(tmp_path / "copy"), "true"])
    copy = tmp_path / "copy"
    np.testing.assert_array_equal(images(scene, "start"), images(copy, "start"))
    before, after = images(scene, "end"), images(copy, "end")
    np.testing.assert_array_equal(before[..., 3], after[..., 3])
    expected = np.minimum(np.rint(robustness_scene.GAIN * before[..., :3].astype(float)), 255)
    np.testing.assert_array_equal(after[..., :3], expected)


def test_a_number_of_parts_is_given_to_the_build_alone(tmp_path) -> None:
    cases = [c for c in robustness.CASES if c.build]
    assert {c.row for c in cases} == {"parts given"}
    for case in cases:
        text = robustness.command(asked("part2gs-robot build {scene}"), case, tmp_path)
        assert text == f"part2gs-robot build {{scene}} --parts {case.value:g}"
        assert not case.flags


def test_the_command_runs_on_the_copy_and_its_exit_code_is_told(scene, tmp_path) -> None:
    case = next(c for c in robustness.CASES if c.edit[-1:] == ("masks",))
    text = robustness.command(asked("part2gs-robot build {scene} -o {out}"), case, tmp_path)
    filled = text.format(scene="S", out="O").split()
    assert filled[-7:] == ["masks", "S", str(tmp_path / "copy"), "part2gs-robot", "build", "COPY",
                           "-o", "O"][-7:]
    assert robustness_scene.main(["masks", str(scene), str(tmp_path / "copy"), "false"]) == 1


def test_a_room_is_drawn_from_the_model_in_the_kit(tmp_path) -> None:
    case = next(c for c in robustness.CASES if c.edit[-1:] == ("KIT",))
    words = robustness.command(asked("part2gs-robot build {scene}"), case, tmp_path).split()
    assert Path(words[1]).name == "path_traced.py"
    assert Path(words[1]).exists()
    assert words[2:] == [str(Path("kit").resolve()), "{scene}", str(tmp_path / "copy"),
                         "part2gs-robot", "build", "COPY"]


def asked(command: str) -> SimpleNamespace:
    """Return the words of a command line that these tests need."""
    return SimpleNamespace(cmd=command, kit=Path("kit"))


def row(kind: str, value: float, angle: float | None, name: str = "a") -> dict:
    return {"row": kind, "value": value, "object": name, "parts_true": 1, "parts_found": 1,
            "parts_extra": 0, "types_right": 1, "angle_deg": angle, "line_pct": 0.1,
            "motion_deg": 0.2, "motion_units": None, "miou": 0.9, "watertight": True, "exit": 0,
            "seconds": 10.0, "peak_mb": 100.0, "commit": "abc"}


def test_new_rows_replace_old_ones_in_the_order_of_the_cases() -> None:
    earlier = [row("seed", 1, 0.3), row("views", 12, 0.5)]
    rows = robustness.merged(earlier, [row("views", 12, 0.4), row("views", 64, 0.1)])
    assert [(r["row"], r["value"], r["angle_deg"]) for r in rows] == [
        ("views", 64, 0.1), ("views", 12, 0.4), ("seed", 1, 0.3)]


def test_table_and_figure_hold_every_row_and_the_clean_scene(tmp_path: Path) -> None:
    rows = [row("views", 64, 0.1), row("views", 12, None), row("pixels", 200, 0.5)]
    text = robustness.document(rows)
    assert "| views | 12 | a | 1 of 1 | 1 of 1 | - |" in text
    assert text.count("| a |") == 3
    assert curve(rows, "pixels", "a", "angle_deg") == [(200.0, 0.5), (400.0, 0.1)]
    assert curve(rows, "views", "a", "angle_deg") == [(64.0, 0.1)]
    draw(rows, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 1000
