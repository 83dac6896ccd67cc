"""gazebo.launch.py: what it would start, with controllers and without."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from ros_stubs import IncludeLaunchDescription, by_package, load, started
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.ros_package import write_ros
from part2gs_robotics.exporters.urdf import write_urdf

ROOT = Path(__file__).resolve().parents[2]


def robot_of(nodes: dict) -> ET.Element:
    """Return what robot_state_publisher would publish."""
    value = nodes["robot_state_publisher"].kwargs["parameters"][0]["robot_description"]
    assert value.kwargs == {"value_type": str}
    return ET.fromstring(value.args[0])


@pytest.fixture
def cabinet(tmp_path: Path) -> Path:
    """Return a twin with every kind of joint and controllers beside it."""
    write_urdf(toy_cabinet_twin(4), tmp_path)
    manager = {"update_rate": 100, "states": {"type": "a/B"}, "arm": {"type": "c/D"}}
    (tmp_path / "controllers.yaml").write_text(
        yaml.safe_dump({"controller_manager": {"ros__parameters": manager}}))
    return tmp_path / "twin.urdf"


@pytest.mark.usefixtures("stubs")
def test_gazebo_takes_the_twin_with_uris_and_without_controllers(cabinet: Path) -> None:
    description = load(ROOT / "launch/gazebo.launch.py").generate_launch_description()
    nodes = by_package(started(description, model=str(cabinet)))
    assert set(nodes) == {"robot_state_publisher", "ros_gz_sim", "ros_gz_bridge"}
    create = nodes["ros_gz_sim"].kwargs
    assert (create["executable"], create["arguments"]) == (
        "create", ["-topic", "robot_description", "-name", "toy_cabinet"])
    robot = robot_of(nodes)
    for mesh in robot.iter("mesh"):
        assert Path(mesh.get("filename").removeprefix("file://")).is_file()
    assert robot.find("ros2_control") is None
    (world,) = [e for e in description.args[0] if isinstance(e, IncludeLaunchDescription)]
    package, *path = world.args[0].args[0].args[0]
    assert (package.args, path) == (("ros_gz_sim",), ["launch", "gz_sim.launch.py"])
    (name, words), = world.kwargs["launch_arguments"]
    assert (name, words[0], words[1].args) == ("gz_args", "-r ", ("world",))


@pytest.mark.usefixtures("stubs")
def test_gazebo_drives_every_joint_that_moves_within_its_range(cabinet: Path) -> None:
    description = load(ROOT / "launch/gazebo.launch.py").generate_launch_description()
    settings = cabinet.with_name("controllers.yaml")
    nodes = by_package(started(description, model=str(cabinet), controllers=str(settings)))
    assert nodes["controller_manager"].kwargs["arguments"] == ["arm", "states"]
    robot = robot_of(nodes)
    limits = {j.get("name"): j.find("limit") for j in robot.findall("joint")}
    control = {j.get("name"): j for j in robot.find("ros2_control").findall("joint")}
    assert set(control) == {name for name, limit in limits.items() if limit is not None}
    for name, joint in control.items():
        assert [s.get("name") for s in joint.findall("state_interface")] == ["position", "velocity"]
        ends = {p.get("name"): p.text for p in joint.findall("command_interface/param")}
        slave = name.endswith("_slide")
        assert ends == ({} if slave else
                        {"min": limits[name].get("lower"), "max": limits[name].get("upper")})
    assert robot.findtext("gazebo/plugin/parameters") == str(settings)


@pytest.mark.usefixtures("stubs")
def test_gazebo_names_missing_controllers(cabinet: Path) -> None:
    description = load(ROOT / "launch/gazebo.launch.py").generate_launch_description()
    with pytest.raises(FileNotFoundError, match=r"absent: no such controllers\. Expected .*:="):
        started(description, model=str(cabinet), controllers=str(cabinet.with_name("absent")))


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize("driven", [False, True])
def test_gazebo_takes_the_xacro_of_an_exported_package(tmp_path: Path, driven: bool) -> None:
    write_ros(toy_cabinet_twin(4), tmp_path)
    settings = str(tmp_path / "config/controllers.yaml") if driven else ""
    description = load(ROOT / "launch/gazebo.launch.py").generate_launch_description()
    model = str(tmp_path / "urdf/toy_cabinet.urdf.xacro")
    nodes = by_package(started(description, model=model, controllers=settings))
    robot = robot_of(nodes)
    for mesh in robot.iter("mesh"):
        assert Path(mesh.get("filename").removeprefix("file://")).is_file()
    plugin = robot.findtext("ros2_control/hardware/plugin")
    assert plugin == ("gz_ros2_control/GazeboSimSystem" if driven else None)
    assert robot.findtext("gazebo/plugin/parameters") == (settings or None)
    assert ("controller_manager" in nodes) == driven
