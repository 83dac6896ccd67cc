"""Objects cut out of simulators' tables are whole, alone and load from anywhere."""

from __future__ import annotations

import mujoco
import pytest

TABLE = """
<mujoco>
  <compiler meshdir="parts"/>
  <asset><mesh name="wedge" file="wedge.obj"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <body name="robot"><joint name="arm"/><geom size=".1"/></body>
    <body name="desk" pos="1 0 0">
      <geom type="box" size=".5 .5 .1"/>
      <body name="chest" pos="0 0 1">
        <geom type="mesh" mesh="wedge"/>
        <body name="lid"><joint type="hinge"/><geom type="box" size=".1 .1 .01" mass="1"/></body>
      </body>
      <body name="mug"><geom size=".05"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="arm"/></actuator>
  <keyframe><key qpos="0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def simulators(load):
    return load("simulators")


def test_one_body_is_cut_out_with_what_hangs_on_it(simulators, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/wedge.obj").write_text(
        "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (tmp_path / "table.xml").write_text(TABLE)
    text = simulators.cut_out(tmp_path / "table.xml", "chest")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "model.xml").write_text(text)
    model = mujoco.MjModel.from_xml_path(str(elsewhere / "model.xml"))
    assert [model.body(b).name for b in range(model.nbody)] == ["world", "desk", "chest", "lid"]
    assert [model.joint(j).name for j in range(model.njnt)] == ["joint_0"]
    assert (model.ngeom, model.nu, model.nkey, model.nlight) == (2, 0, 0, 0)
    assert list(model.body("chest").pos) == [0, 0, 1]


def test_a_package_that_is_missing_is_named(simulators):
    with pytest.raises(SystemExit, match="no_such_world: not installed"):
        simulators.find("no_such_world/model.xml")
