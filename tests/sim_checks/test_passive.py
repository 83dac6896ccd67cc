"""Passive rows: a light push moves every joint, nothing moves by itself, both twins are one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth import scaled, toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.actuation import check_actuation
from part2gs_robotics.sim_checks.passive import PUSH, check_passive, push_of
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.subject import make_subject


def cabinet(folder: Path, moving: int = 2) -> Path:
    folder.mkdir(exist_ok=True)
    write_mjcf(toy_cabinet_twin(moving), folder)
    return folder


def edit(folder: Path, pattern: str, text: str, *names: str) -> Path:
    for name in names or ("twin.xml", "twin_actuated.xml"):
        before = (folder / name).read_text()
        after = re.sub(pattern, text, before)
        assert after != before, name
        (folder / name).write_text(after)
    return folder


def failed(report: CheckReport) -> set[tuple[str, str]]:
    return {(r.name, r.subject) for r in report.results if r.status == "fail"}


def test_push_is_a_tenth_of_the_weight(tmp_path: Path) -> None:
    subject = make_subject(cabinet(tmp_path / "t") / "twin.xml")
    drawer, door = (push_of(subject, joint) for joint in subject.joints)
    # root of 1.02: armature counts for inertia, not for weight
    assert drawer == pytest.approx(PUSH * 7.1028864 * 9.81 * np.sqrt(1.02), rel=1e-6)
    # a board of 0.6 m turns about its edge as if its weight were at 0.6 / sqrt(3)
    assert door == pytest.approx(PUSH * 2.592 * 9.81 * 0.6 / np.sqrt(3) * np.sqrt(1.02), rel=1e-3)


def test_a_door_too_stiff_for_a_finger_is_caught(tmp_path: Path) -> None:
    """What was assumed before: damping that takes the accelerating force at top speed."""
    folder = edit(cabinet(tmp_path / "t"), r'damping="0\.3\d+"', 'damping="20"')
    assert failed(check(folder, only=("passive", "actuation"))) == {("push", "part_2_joint")}


def test_a_joint_that_sticks_is_caught(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), r'frictionloss="1\.39\d+"', 'frictionloss="8"')
    assert failed(check(folder, only=("passive",))) == {("push", "part_1_joint")}


def test_a_motor_in_the_passive_twin_is_caught(tmp_path: Path) -> None:
    folder = cabinet(tmp_path / "t")
    (folder / "twin.xml").write_text((folder / "twin_actuated.xml").read_text())
    assert ("push", "part_2_joint") in failed(check(folder, only=("passive",)))


def test_a_spring_moves_a_joint_by_itself(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), r'(name="part_2_joint")',
                  r'\1 stiffness="5" springref="60"')
    assert ("drift", "part_2_joint") in failed(check(folder, only=("passive",)))


def test_a_part_that_falls_from_where_it_stood_is_caught(tmp_path: Path) -> None:
    """The lever hangs; half a radian aside only friction holds it. Without gravity it stays."""
    folder = cabinet(tmp_path / "t", 3)
    report = check(folder, only=("passive",))
    assert report.ok
    (row,) = [r for r in report.results if (r.name, r.subject) == ("stands", "part_3_joint")]
    assert row.value < 1e-3
    assert "gravity pulls -0.0054" in row.detail
    edit(folder, r'frictionloss="0\.0059\d+"', 'frictionloss="0.004"')
    assert failed(check(folder, only=("passive",))) == {("stands", "part_3_joint")}


def test_friction_of_the_engines_own_softness_creeps(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t", 3), r'solimpfriction="[\d. ]+"', "")
    assert failed(check(folder, only=("passive",))) == {("stands", "part_3_joint")}


@pytest.mark.parametrize(("pattern", "text", "what"), [
    (r'mass="2\.592"', 'mass="3"', "body_mass"), (r'range="0 0\.3"', 'range="0 0.4"', "jnt_range"),
    (r'name="part_1_joint"', 'name="other"', "names of joints"),
    (r'qpos="0\.3 ', 'qpos="0.29 ', "key_qpos")])
def test_twins_that_differ_are_caught(tmp_path: Path, pattern: str, text: str, what: str) -> None:
    folder = edit(cabinet(tmp_path / "t"), pattern, text, "twin.xml")
    report = check(folder, only=("inertia",))
    assert ("same twin", "twin_actuated.xml") in failed(report)
    assert any(what in r.detail for r in report.results)


def test_options_of_the_scene_count(tmp_path: Path) -> None:
    """Gravity and step stand in scene.xml alone; without it the engine's own hold."""
    folder = edit(cabinet(tmp_path / "t"), r'gravity="0 0 -9.81"', 'gravity="0 0 -98.1"',
                  "scene.xml")
    (row,) = [r for r in check(folder, only=("passive",)).results
              if (r.name, r.subject) == ("push", "part_1_joint")]
    assert float(row.detail.split()[0]) == pytest.approx(70.4, rel=0.01)


def test_older_folders_and_single_files_are_driven_as_they_are(tmp_path: Path) -> None:
    """Motors in twin.xml are used; where there are none the check brings its own."""
    folder = cabinet(tmp_path / "t")
    single = check(folder / "twin.xml", only=("passive", "actuation"))
    assert any("servos added" in note for note in single.notes)
    (folder / "twin_actuated.xml").replace(folder / "twin.xml")
    (folder / "scene.xml").unlink()
    older = check(folder, only=("passive", "actuation"))
    assert not any("servos added" in note for note in older.notes)
    for report in (single, older):
        assert report.ok
        assert {r.name for r in report.results} >= {"reach", "tracking"}
        assert not {r.name for r in report.results} & {"push", "drift", "stands", "same twin"}


def test_broken_motors_stop_the_check(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), r'kp="[\d.]+"', 'kp="-1"', "twin_actuated.xml")
    report = check(folder)
    assert not report.ok


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_twin_passes_in_every_unit(tmp_path: Path, factor: float) -> None:
    """In mm and km: gravity and time step of scene.xml, masses and friction of twin.xml."""
    write_mjcf(scaled(toy_cabinet_twin(3), factor), tmp_path)
    report = check(tmp_path, steps=5, only=("inertia", "states", "actuation", "passive"))
    assert report.ok, [r for r in report.results if r.status != "pass"]


def test_a_twin_passes_whatever_is_up(tmp_path: Path) -> None:
    """The cabinet lies on its back: x is up, the drawer must be lifted, the door is a lid."""
    twin = replace(toy_cabinet_twin(2), up=np.array([1.0, 0, 0]))
    write_mjcf(twin, tmp_path)
    report = check(tmp_path, steps=5, only=("states", "actuation", "stability", "passive"))
    assert report.ok, [r for r in report.results if r.status != "pass"]
    pulled = {r.subject: r.detail for r in report.results if r.name == "stands"}
    assert "gravity pulls -69.7, friction holds 76.6" in pulled["part_1_joint"]


PUSHED = """<mujoco><option gravity="0 0 0" timestep=".002"/><worldbody>
  <body name="a"><joint name="x" type="slide" axis="1 0 0" range="0 .3" limited="true" damping="1"/>
    <geom type="box" size=".1 .1 .1" mass="1"/></body>
  <body name="b" pos="{place} 0 0"><joint name="y" type="slide" axis="1 0 0" range="0 .5"
    limited="true" damping="1"/><geom type="box" size=".1 .1 .1" mass="1"/></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(("place", "status"), [(0.3, "fail"), (0.8, "pass")])
def test_a_push_must_leave_others_still(tmp_path: Path, place: float, status: str) -> None:
    (tmp_path / "m.xml").write_text(PUSHED.format(place=place))
    rows = check_passive(make_subject(tmp_path / "m.xml", servos=False))
    (row,) = [r for r in rows if (r.name, r.subject) == ("others pushed", "x")]
    assert row.status == status
    assert row.detail == "moved most: y"
    if status == "fail":  # b's near face is met 0.1 on: carried along, and on by its momentum
        assert row.value > 0.95 * 0.3 - 0.1 - 0.01


def test_a_servo_that_takes_up_weight_is_no_motion_of_others(tmp_path: Path) -> None:
    """A lid of 1 kg droops by 0.3 deg on its own servo while a drawer far away is driven."""
    (tmp_path / "m.xml").write_text("""<mujoco><option timestep=".002"/><worldbody>
      <body name="a"><joint name="x" type="slide" axis="1 0 0" range="0 .3" limited="true"/>
        <geom type="box" size=".1 .1 .1" mass="1"/></body>
      <body name="b" pos="0 2 0"><joint name="lid" axis="0 1 0" range="-60 60" limited="true"/>
        <geom type="box" size=".1 .1 .01" pos=".1 0 0" mass="1"/></body></worldbody>
      <actuator><position joint="x" kp="900" kv="60"/><position joint="lid" kp="190" kv="5"/>
      </actuator></mujoco>""")
    rows = check_actuation(make_subject(tmp_path / "m.xml"))
    (still,) = [r for r in rows if (r.name, r.subject) == ("others still", "x")]
    assert still.status == "pass"
    assert still.value < 1e-5  # it has settled before the drawer moves
