"""Marks on photos: nothing where the moved Gaussians look as photographed, planted patches else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.model.motion import LeftOver
from part2gs_robotics.outputs import verdict, with_left
from part2gs_robotics.report.data import Picture
from part2gs_robotics.report.report_json import ReportData, write_report
from part2gs_robotics.report.unexplained import DIFFERS, HIDDEN, marked, unexplained
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult


def seen(rng: np.random.Generator) -> Picture:
    """Return an object of 40 x 40 pixels amid white, shown exactly as photographed."""
    photo = np.full((60, 60, 3), 255, np.uint8)
    photo[10:50, 10:50] = rng.integers(60, 180, (40, 40, 3))
    mask = np.zeros((60, 60), bool)
    mask[10:50, 10:50] = True
    moved = np.concatenate([photo, 255 * mask[..., None].astype(np.uint8)], -1)
    return Picture("state 1", 1, photo, photo, moved=moved, mask=mask)


@pytest.fixture
def picture() -> Picture:
    return seen(np.random.default_rng(0))


@pytest.mark.parametrize("gain", [1.0, 0.7, 1.3])
def test_what_looks_as_photographed_is_not_marked_however_bright_the_state_was(
        picture: Picture, gain: float) -> None:
    moved = picture.moved.copy()
    moved[10:50, 10:50, :3] = np.clip(moved[10:50, 10:50, :3] * gain, 0, 255)
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, 0.0)


def test_a_patch_that_looks_different_is_marked_where_it_is(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[20:30, 20:28, :3] = 255
    found = unexplained(replace(picture, moved=moved))
    assert found.differs == pytest.approx(80 / 1600, abs=2 / 1600)
    assert (found.image[21:29, 21:27] == DIFFERS).all()
    assert not (found.image[31:49, 11:49] == DIFFERS).all(-1).any()


def test_what_the_other_state_did_not_see_is_another_mark(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[40:50, 10:50] = 255
    moved[40:50, 10:50, 3] = 0
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, pytest.approx(400 / 1600))
    assert (found.image[41:49, 11:49] == HIDDEN).all()


def test_what_is_shown_where_the_photo_has_nothing_differs(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[52:58, 10:50] = (90, 90, 90, 255)
    assert unexplained(replace(picture, moved=moved)).differs == pytest.approx(240 / 1600)


def test_an_outline_one_pixel_wide_is_blur(picture: Picture) -> None:
    moved = picture.moved.copy()
    moved[10, 10:50, 3] = 0
    moved[50, 10:50] = (90, 90, 90, 255)
    found = unexplained(replace(picture, moved=moved))
    assert (found.differs, found.hidden) == (0.0, 0.0)


def test_without_the_other_state_nothing_is_claimed(picture: Picture) -> None:
    assert unexplained(replace(picture, moved=None)) is None


def left_over(share: float) -> LeftOver:
    marks = np.zeros((60, 60), bool)
    marks[20:40, 30:50] = share > 0
    return LeftOver(share, 0.02, (0, -1), (marks, np.zeros((60, 60), bool)))


def report_of(picture: Picture, share: float) -> ReportData:
    left = left_over(share)
    row = CheckReport("twin", "engine", (CheckResult("overlap", "", "pass"),))
    checks = with_left(row, left)
    shown = (replace(picture, moved=None, render=None, left=left.marks[0]),) if share else ()
    return ReportData("box", "artgs", checks.exit_code, toy_cabinet_twin(1), pictures=shown,
                      checks=checks.to_dict(), left=left)


@pytest.mark.parametrize(("share", "code", "said"), [
    (0.0, 0, "checks pass"), (0.02, 0, "checks pass"),
    (0.274, 1, "incomplete: 27 % of what moved is not explained")])
def test_more_than_noise_explains_is_incomplete_and_fails_the_build(
        share: float, code: int, said: str) -> None:
    report = with_left(CheckReport("twin", "engine", ()), left_over(share))
    assert (report.exit_code, verdict(report)) == (code, said)
    failed = replace(report, results=(*report.results, CheckResult("overlap", "", "fail")))
    assert verdict(failed) == "; ".join([said] * code + ["checks FAIL"])


def test_an_incomplete_twin_says_so_first_and_shows_where(picture: Picture, tmp_path: Path) -> None:
    write_report(tmp_path, report_of(picture, 0.274))
    content = json.loads((tmp_path / "report.json").read_text())
    first = "Incomplete: 27 % of what moved is not explained. 1 moving part: "
    assert content["verdict"]["Found"].startswith(first)
    assert content["unexplained"] == {"share": 0.274, "bound": 0.02, "complete": False}
    assert content["exit_code"] == 1
    page = (tmp_path / "report.html").read_text()
    assert page.index(first) < page.index('alt="not explained"') < page.index('id="view"')
    assert "built, checks" not in page


def test_a_complete_twin_says_nothing_of_it(picture: Picture, tmp_path: Path) -> None:
    write_report(tmp_path, report_of(picture, 0.0))
    content = json.loads((tmp_path / "report.json").read_text())
    assert content["verdict"]["Found"].startswith("1 moving part: ")
    assert content["unexplained"]["complete"]
    page = (tmp_path / "report.html").read_text()
    assert "not explained" not in page
    assert "built, checks pass" in page


def test_marks_are_where_the_mask_is(picture: Picture) -> None:
    mask = left_over(0.3).marks[0]
    image = marked(picture.photo, mask)
    assert (image[mask] == DIFFERS).all()
    assert not (image[~mask] == DIFFERS).all(-1).any()
