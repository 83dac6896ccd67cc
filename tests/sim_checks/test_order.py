"""Joints that wait for others: driven once those have moved, and failed where none can go first."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.interpenetration import LIMIT
from part2gs_robotics.sim_checks.order import in_order
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.subject import make_subject

# A drawer that comes out along x, a shutter before it that rises along z, and a stop above.
MODEL = """<mujoco><option timestep="0.002" gravity="0 0 0"/><worldbody>
  <body name="drawer"><joint name="out" type="slide" axis="1 0 0" range="0 .4" limited="true"/>
    <geom type="box" size=".2 .2 .1"/></body>
  <body name="shutter" pos=".25 0 0">
    <joint name="up" type="slide" axis="0 0 1" range="0 .3" limited="true"/>
    <geom type="box" size=".02 .2 .1"/></body>
  {more}
</worldbody><keyframe>
  <key name="state_0" qpos="0 0"/><key name="state_1" qpos="{state}"/>
</keyframe></mujoco>"""
STOP = '<geom type="box" pos=".25 0 .2" size=".05 .2 .05"/>'
ROOM = 0.03  # between drawer and shutter at state 0


def written(folder: Path, state: str = ".4 .3", more: str = "") -> Path:
    path = folder / "m.xml"
    path.write_text(MODEL.format(state=state, more=more))
    return path


def failed(report: CheckReport) -> set[tuple[str, str]]:
    return {(r.name, r.subject) for r in report.results if r.status == "fail"}


def test_a_drawer_waits_for_the_shutter_before_it(tmp_path: Path) -> None:
    report = check(written(tmp_path), steps=9, only=("actuation", "overlap", "stability"))
    assert not failed(report)
    assert [note for note in report.notes if note.startswith("out waits for other joints")]
    assert not [note for note in report.notes if note.startswith("up waits")]


def test_the_waiting_joint_is_driven_with_the_other_at_state_1(tmp_path: Path) -> None:
    subject = make_subject(written(tmp_path))
    ordered, sweeps = in_order(subject, 9)
    out, up = subject.joints
    assert set(ordered.around) == {out.index}
    assert ordered.at({out.qpos: 0.1}, out) == pytest.approx([0.1, 0.3])
    assert ordered.at({up.qpos: 0.1}, up) == pytest.approx([0.0, 0.1])
    assert all(worst.depth <= LIMIT * subject.size for _, worst in sweeps.values())


def test_a_shutter_that_stays_down_blocks_the_drawer(tmp_path: Path) -> None:
    path = written(tmp_path, state=f"{ROOM / 2} .1")
    path.write_text(path.read_text().replace("0 .3", "0 .1"))
    report = check(path, steps=9, only=("overlap",))
    assert ("overlap", "out") in failed(report)
    assert not [note for note in report.notes if "waits" in note]


def test_a_shutter_under_a_stop_lets_nothing_out(tmp_path: Path) -> None:
    """At state 1 the drawer would be free, but the shutter that goes first fails."""
    report = check(written(tmp_path, state="-.1 .3", more=STOP), steps=9, only=("overlap",))
    assert ("overlap", "up") in failed(report)


def test_two_parts_that_block_each_other_both_fail(tmp_path: Path) -> None:
    hooks = """<mujoco><worldbody>
      <body name="a"><joint name="x" type="slide" axis="1 0 0" range="0 .5" limited="true"/>
        <geom type="box" size=".1 .1 .1"/></body>
      <body name="b" pos=".25 0 0">
        <joint name="y" type="slide" axis="-1 0 0" range="0 .5" limited="true"/>
        <geom type="box" size=".1 .1 .1"/></body>
    </worldbody><keyframe><key name="state_0" qpos="0 0"/><key name="state_1" qpos=".5 .5"/>
    </keyframe></mujoco>"""
    (tmp_path / "m.xml").write_text(hooks)
    subject, sweeps = in_order(make_subject(tmp_path / "m.xml"), 11)
    assert not subject.around
    assert all(worst.depth > 0.05 for _, worst in sweeps.values())


def test_without_states_what_stands_in_the_way_is_opened(tmp_path: Path) -> None:
    """Door before drawer, found from the geometry: no keyframe says it."""
    path = written(tmp_path)
    path.write_text(path.read_text().replace("state_1", "open"))
    subject, sweeps = in_order(make_subject(path), 9)
    (note,) = [n for n in subject.notes if "waits" in n]
    assert note.startswith("out waits for other joints: with those at rest drawer and shutter meet")
    assert note.endswith("driven with up at 0.3 units instead")
    assert sweeps[subject.joints[0].index][1].depth == 0


def test_a_chain_of_three_is_opened_one_after_the_other(tmp_path: Path) -> None:
    """A bolt before the shutter, the shutter before the drawer."""
    bolt = """<body name="bolt" pos=".25 0 .2"><joint name="side" type="slide" axis="0 1 0"
      range="0 .5" limited="true"/><geom type="box" size=".02 .2 .05"/></body>"""
    path = written(tmp_path, more=bolt)
    path.write_text(re.sub("<keyframe>.*</keyframe>", "", path.read_text(), flags=re.DOTALL))
    report = check(path, steps=9, only=("actuation", "overlap"))
    assert report.ok, failed(report)
    waits = {n.split()[0]: n for n in report.notes if "waits" in n}
    assert set(waits) == {"out", "up"}
    assert "driven with side at 0.5 units instead" in waits["up"]
    assert "up at 0.3 units" in waits["out"]
    assert "side at 0.5 units" in waits["out"]


def test_combinations_keep_the_order(tmp_path: Path) -> None:
    """Neither the drawer out under a closed shutter, nor the shutter down on an open drawer."""
    from part2gs_robotics.sim_checks.blocking import _combination

    subject, _ = in_order(make_subject(written(tmp_path)), 9)
    rng, drawn = np.random.default_rng(0), []
    for turn in range(40):
        drawn.append(_combination(subject, rng, turn))
    out, up = np.array(drawn).T
    opened = np.isclose(up, 0.3)
    assert ((out == 0) | opened).all()
    assert (out > 0).sum() == (~opened).sum() == 20
