"""Assets that are not ours: their filters, welds and motors are theirs, what collides counts."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from part2gs_robotics.assets.driven import driven_joints, held_joints
from part2gs_robotics.assets.pairs import meeting_pairs
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.subject import make_subject

ARM = """<mujoco><option gravity="0 0 -9.81"/><worldbody>
<body name="a" pos="0 0 1">{free}<geom name="ga" type="box" size=".1 .1 .1"/>
<body name="b" pos=".15 0 0"><joint name="j" axis="0 1 0" range="0 60" limited="true"/>
<geom name="gb" type="box" size=".1 .1 .1" {bits}/>
<body name="c" pos=".3 0 0"><joint name="k" axis="0 1 0" range="0 30" limited="true" {joint}/>
<geom name="gc" type="box" size=".1 .05 .1"/></body></body></body></worldbody>{more}</mujoco>"""


def written(folder: Path, **given: str) -> Path:
    texts = {"free": "", "bits": "", "joint": "", "more": ""} | given
    (folder / "m.xml").write_text(ARM.format(**texts))
    return folder / "m.xml"


def engine_pairs(model: mujoco.MjModel) -> set[tuple[int, int]]:
    """Return the pairs that the engine itself finds in contact."""
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    found = [sorted(int(model.geom_bodyid[g]) for g in data.contact[k].geom)
             for k in range(data.ncon)]
    return {(a, b) for a, b in found}


@pytest.mark.parametrize("given", [
    {}, {"bits": 'contype="0" conaffinity="0"'}, {"bits": 'contype="2" conaffinity="2"'},
    {"free": "<freejoint/>"}, {"more": '<contact><exclude body1="a" body2="b"/></contact>'},
    {"bits": 'contype="0" conaffinity="0"',
     "more": '<contact><pair geom1="ga" geom2="gb"/></contact>'}])
def test_pairs_that_may_meet_are_those_the_engine_finds(tmp_path: Path, given: dict[str, str]
                                                        ) -> None:
    """a overlaps b and b touches c; whatever the engine reports must be among the pairs."""
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, **given)))
    assert engine_pairs(model) == {p for p in meeting_pairs(model) if p == (1, 2)}


def test_a_floating_base_that_is_fixed_keeps_its_filter(tmp_path: Path) -> None:
    subject = make_subject(written(tmp_path, free="<freejoint/>"), ours=False)
    assert (1, 2) not in (subject.pairs or ())
    assert not engine_pairs(subject.model)
    assert (1, 2) in (make_subject(written(tmp_path), ours=False).pairs or ())


def rows(report: CheckReport, name: str) -> dict[str, str]:
    return {r.subject: r.status for r in report.results if r.name == name}


def test_an_open_visual_mesh_warns_and_pieces_stand_in(tmp_path: Path) -> None:
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\n"
                                       "f 2 3 4\n")
    (tmp_path / "m.xml").write_text("""<mujoco><asset><mesh name="o" file="open.obj"
      inertia="shell"/></asset><worldbody><body name="b"><joint name="j" type="slide" axis="1 0 0"
      range="0 .5" limited="true"/><geom type="box" size=".1 .1 .1"/><geom type="mesh" mesh="o"
      contype="0" conaffinity="0" group="2"/></body>
      <geom type="box" size=".1 .1 .1" pos="2 0 0"/></worldbody></mujoco>""")
    report = check(tmp_path / "m.xml")
    assert report.ok
    assert rows(report, "mesh")["b"] == "warn"
    assert rows(report, "overlap") == {"j": "pass", "": "pass"}
    near = (tmp_path / "m.xml").read_text().replace('pos="2 0 0"', 'pos=".5 0 0"')
    (tmp_path / "m.xml").write_text(near)
    blocked = check(tmp_path / "m.xml")
    assert rows(blocked, "overlap")["j"] == "fail"
    assert rows(blocked, "reach")["j"] == "fail"


def test_an_unlimited_hinge_is_driven_through_one_turn(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text("""<mujoco><worldbody><body name="b"><joint name="knob"
      axis="0 0 1"/><geom type="cylinder" size=".1 .02"/></body></worldbody></mujoco>""")
    report = check(tmp_path / "m.xml")
    assert report.ok
    (reach,) = [r for r in report.results if r.name == "reach"]
    assert "-3.142..3.142 rad" in reach.detail


def test_a_joint_without_a_name_is_driven_too(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text("""<mujoco><worldbody><body name="b"><joint type="slide"
      range="0 1" limited="true"/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>""")
    report = check(tmp_path / "m.xml", only=("actuation",))
    assert report.ok
    assert rows(report, "reach") == {"joint 0": "pass"}


def test_what_a_weld_holds_is_not_driven(tmp_path: Path) -> None:
    weld = '<equality><weld body1="b"/></equality>'
    model = mujoco.MjModel.from_xml_path(str(written(tmp_path, more=weld)))
    assert [j.name for j in held_joints(model, driven_joints(model))] == ["j"]
    off = written(tmp_path, more=weld.replace("/>", ' active="false"/>'))
    model = mujoco.MjModel.from_xml_path(str(off))
    assert not held_joints(model, driven_joints(model))


def test_a_weak_motor_of_others_warns_and_ours_fails(tmp_path: Path) -> None:
    weak = '<actuator><position joint="k" kp=".01"/></actuator>'
    path = written(tmp_path, bits='contype="0" conaffinity="0"', more=weak)
    report = check(path, only=("actuation",))
    assert rows(report, "reach") == {"j": "pass", "k": "warn"}
    (tmp_path / "twin.yaml").write_text("")  # one of our folders
    assert rows(check(path, only=("actuation",)), "reach")["k"] == "fail"


def test_a_stiff_spring_and_damping_are_overcome(tmp_path: Path) -> None:
    """The check's own servo: a latch with a spring, a slide with heavy damping."""
    path = written(tmp_path, bits='contype="0" conaffinity="0"',
                   joint='stiffness="5" damping="20"')
    report = check(path, only=("actuation", "stability"))
    assert report.ok, [r for r in report.results if r.status == "fail"]


def test_a_shallow_overlap_of_others_warns(tmp_path: Path) -> None:
    """4 mm on a metre between drawer and rail, as in models that run well; deep ones fail."""
    model = """<mujoco><worldbody><geom type="box" size=".5 .1 .1" pos="0 {y} 0"/>
      <body name="b"><joint name="j" type="slide" range="0 .2" axis="1 0 0" limited="true"/>
      <geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""
    (tmp_path / "m.xml").write_text(model.format(y=0.196))
    assert rows(check(tmp_path / "m.xml", only=("overlap",)), "overlap")["j"] == "warn"
    (tmp_path / "m.xml").write_text(model.format(y=0.1))
    assert rows(check(tmp_path / "m.xml", only=("overlap",)), "overlap")["j"] == "fail"


def test_numbers_of_the_engine_stay_finite(tmp_path: Path) -> None:
    assert np.isfinite(make_subject(written(tmp_path), ours=False).size)


@pytest.mark.parametrize(("memory", "word"), [("1K", "remove memory of <size>"), ("4K", "memory"),
                                              ("8M", "no warning")])
def test_a_model_with_too_little_memory_is_a_row_and_no_crash(tmp_path: Path, memory: str, word: str
                                                              ) -> None:
    boxes = "".join(f'<body pos="{i} 0 .29"><joint name="j{i}" type="slide" axis="0 0 1" '
                    'range="0 1"/><geom type="box" size=".2 .2 .3"/></body>' for i in range(6))
    (tmp_path / "m.xml").write_text(
        f'<mujoco><size memory="{memory}"/><worldbody><geom type="plane" size="9 9 1"/>{boxes}'
        "</worldbody></mujoco>")
    (row,) = check(tmp_path / "m.xml", only=("compile",)).results
    assert row.name == "compile"
    assert (row.status == "pass") is (memory == "8M")
    assert word in row.detail
