"""Parts that stop each other: a real block passes and is told, an invented overlap fails."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.blocking import block_of, check_combinations, movers_of
from part2gs_robotics.sim_checks.interpenetration import (
    LIMIT,
    Poser,
    check_interpenetration,
)
from part2gs_robotics.sim_checks.order import in_order
from part2gs_robotics.sim_checks.result import CheckResult
from part2gs_robotics.sim_checks.subject import make_subject

CROSSING = """<mujoco><worldbody>
  <body name="a" pos="-1 0 0"><joint name="x" type="slide" axis="1 0 0" range="0 2" limited="true"/>
    <geom type="box" size=".2 .2 .2"/></body>
  <body name="b" pos="0 -1 0"><joint name="y" type="slide" axis="0 1 0" range="0 1" limited="true"/>
    <geom type="box" size=".2 .2 .2"/></body>
</worldbody></mujoco>"""
# A drawer along x and a board that rises beside its way, `film` of the drawer's side in its own.
FILM = """<mujoco><worldbody>
  <body name="a"><joint name="x" type="slide" axis="1 0 0" range="0 .8" limited="true"/>
    <geom type="box" size=".2 .2 .1"/></body>
  <body name="b" pos=".8 {y} -.5"><joint name="z" type="slide" axis="0 0 1" range="0 .5"
    limited="true"/><geom type="box" size=".2 {half} .1"/></body>
</worldbody></mujoco>"""


def rows_of(path: Path, text: str) -> tuple[dict[str, CheckResult], list[CheckResult]]:
    (path / "m.xml").write_text(text)
    subject, sweeps = in_order(make_subject(path / "m.xml"), 21)
    rows, _ = check_interpenetration(subject, sweeps)
    rows += check_combinations(subject, sweeps, 64)
    overlap = {r.subject: r for r in rows if r.name == "overlap"}
    return overlap, [r for r in rows if r.name == "blocking"]


def test_two_boxes_whose_ways_cross_block_each_other(tmp_path: Path) -> None:
    overlap, (block,) = rows_of(tmp_path, CROSSING)
    assert {k: r.status for k, r in overlap.items()} == {"x": "pass", "y": "pass", "": "pass"}
    assert block.subject == "a and b"
    assert block.status == "pass"
    assert "x is stopped at" in block.detail
    assert "y is stopped at" in block.detail


def test_the_place_of_first_contact_is_that_of_the_boxes(tmp_path: Path) -> None:
    """b in the middle of a's way: faces meet when x has gone 1 - 0.4."""
    (tmp_path / "m.xml").write_text(CROSSING)
    subject, sweeps = in_order(make_subject(tmp_path / "m.xml"), 21)
    poser, qpos = Poser(subject), np.array([1.0, 1.0])
    block = block_of(poser, qpos, poser.pairs[0], sweeps)
    assert block
    told = float(block.split("x is stopped at ")[1].split()[0])
    assert 0.6 < told <= 0.6 + 1.0 / 11 + LIMIT  # the next of 11 steps after contact


def test_a_film_along_the_motion_is_an_error_of_the_twin(tmp_path: Path) -> None:
    overlap, blocks = rows_of(tmp_path, FILM.format(y=0.396, half=0.2))
    assert overlap[""].status == "fail"
    assert overlap[""].value == pytest.approx(0.004, rel=1e-3)
    assert overlap["x"].status == overlap["z"].status == "pass"
    assert not blocks


def test_a_thin_board_across_the_way_is_a_real_block(tmp_path: Path) -> None:
    """As thin as the film, but the drawer runs against its face."""
    thin = FILM.replace('size=".2 {half} .1"', 'size=".002 .2 .1"').replace("{y}", "0")
    overlap, (block,) = rows_of(tmp_path, thin)
    assert overlap[""].status == "pass"
    assert block.subject == "a and b"


def test_the_order_that_leads_to_state_1_is_told(tmp_path: Path) -> None:
    keys = """<keyframe><key name="state_0" qpos="0 .5"/><key name="state_1" qpos=".8 0"/>
    </keyframe></mujoco>"""
    thin = FILM.replace('size=".2 {half} .1"', 'size=".002 .2 .1"').replace("{y}", "0")
    _, (block,) = rows_of(tmp_path, thin.replace("</mujoco>", keys))
    assert "from state 0 to state 1 in the order z, x" in block.detail


def test_one_joint_alone_explains_nothing(tmp_path: Path) -> None:
    """A part that runs into the base is wrong at any combination."""
    wall = '<geom name="w" type="box" pos="1 0 0" size=".1 .5 .1"/></worldbody>'
    (tmp_path / "m.xml").write_text(CROSSING.replace("</worldbody>", wall))
    report = check(tmp_path / "m.xml", only=("overlap",))
    assert ("overlap", "x") in {(r.name, r.subject) for r in report.results if r.status == "fail"}
    subject = make_subject(tmp_path / "m.xml")
    assert [j.name for j in movers_of(subject, (0, 1))] == ["x"]
