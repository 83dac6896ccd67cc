"""Write a twin as a ROS 2 description package: xacro with ros2_control, meshes, launch files.

The package is ament_python without code: colcon builds it also where ROS is not installed.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import yaml

from part2gs_robotics.exporters import ros_texts
from part2gs_robotics.exporters.dynamics import Physics, physics_of
from part2gs_robotics.exporters.meshfile import write_meshes
from part2gs_robotics.exporters.mjcf import joint_name, twin_xml
from part2gs_robotics.exporters.scene import scene_xml
from part2gs_robotics.exporters.urdf import WORLD, twin_urdf
from part2gs_robotics.exporters.xmlio import add, number, write_xml
from part2gs_robotics.model.kinematics import moving_parts
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.runtime.atomic import write_error, write_text_atomic

XACRO = "http://www.ros.org/wiki/xacro"
SYSTEMS = {
    "mock": "mock_components/GenericSystem",
    "mujoco": "mujoco_ros2_control/MujocoSystemInterface",
    "gz": "gz_ros2_control/GazeboSimSystem",
}
GZ_PLUGIN = ("gz_ros2_control-system", "gz_ros2_control::GazeboSimROS2ControlPlugin")
UPDATE_RATE = 100  # Hz: controllers of furniture; joint_trajectory_controller's own example
FOLDERS = ("resource", "urdf", "meshes", "mujoco", "launch", "rviz", "config")
STATES = ("position", "velocity")


def write_ros(twin: Twin, folder: Path) -> list[Path]:
    """Write the package `<twin name>_description` into a folder; return all files.

    The folder becomes the package: its name is free, that in package.xml is `package_name`. Units,
    frames and joints are those of twin.urdf. Every file is whole or absent.

    Raises:
        ExportError: if a number, name or mass cannot be written.
        StoreError: if the folder cannot be written.
    """
    physics = physics_of(twin)
    moves = bool(moving_parts(twin))
    for one in FOLDERS if moves else FOLDERS[:-1]:
        _make(folder / one)
    meshes = write_meshes(twin, folder / "meshes")
    places = {file.name: file.relative_to(folder / "meshes").as_posix() for file in meshes}
    files = [*meshes, *_write_models(twin, physics, folder, places)]
    texts = _texts(twin, moves)
    for name, text in texts.items():
        write_text_atomic(folder / name, text)
    return [*files, *(folder / name for name in texts)]


def package_name(twin: Twin) -> str:
    """Return the ROS name of the package: a-z, 0-9 and _, a letter first (REP 144)."""
    name = re.sub(r"[^a-z0-9]+", "_", twin.name.lower()).strip("_")
    name = name if name[:1].isalpha() else f"twin_{name}".strip("_")
    return f"{name}_description"


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise write_error(folder, err) from err


def _robot_name(twin: Twin) -> str:
    return package_name(twin).removesuffix("_description")


def _write_models(
    twin: Twin, physics: Physics, folder: Path, places: dict[str, str]
) -> list[Path]:
    """Write the xacro and the MJCF; both find their meshes in `meshes/`."""
    actuated = twin_xml(twin, physics, actuated=True)
    for element in actuated.iter():
        if "file" in element.attrib:
            element.set("file", f"../meshes/{places[Path(element.attrib['file']).name]}")
    return [
        write_xml(twin_xacro(twin, physics, places),
                  folder / f"urdf/{_robot_name(twin)}.urdf.xacro"),
        write_xml(actuated, folder / "mujoco/twin_actuated.xml"),
        write_xml(scene_xml(twin, physics), folder / "mujoco/scene.xml"),
    ]  # fmt: skip


def twin_xacro(twin: Twin, physics: Physics, places: dict[str, str]) -> ET.Element:
    """Return the <robot> of twin.urdf with xacro arguments and ros2_control tags.

    Args:
        twin: whose it is.
        physics: of the twin.
        places: path below `meshes/` of every mesh file, by its bare name.
    """
    ET.register_namespace("xacro", XACRO)
    root = twin_urdf(twin, physics)
    root.set("name", _robot_name(twin))
    for mesh in root.iter("mesh"):
        mesh.set("filename", f"$(arg meshes)/{places[Path(mesh.attrib['filename']).name]}")
    head = ET.Element("head")
    _argument(head, "meshes", f"package://{package_name(twin)}/meshes")
    if moving_parts(twin):
        _argument(head, "hardware", "mock")
        _xacro(head, "property", name="hardware", value="$(arg hardware)")
        known = ("none", *SYSTEMS)
        wrong = _xacro(head, "if", value=f"${{hardware not in {known}}}")
        wrong.text = f"${{xacro.fatal('hardware is', hardware, '- expected one of', {known})}}"
        _control(root, twin)
    root[:0] = list(head)
    return root


def _xacro(parent: ET.Element, tag: str, **attributes: str) -> ET.Element:
    return ET.SubElement(parent, f"{{{XACRO}}}{tag}", attributes)


def _argument(parent: ET.Element, name: str, default: str) -> None:
    _xacro(parent, "arg", name=name, default=default)


def _with(parent: ET.Element, hardware: str) -> ET.Element:
    """Return an element whose content is there with one hardware only."""
    return _xacro(parent, "if", value=f"${{hardware == '{hardware}'}}")


def _control(root: ET.Element, twin: Twin) -> None:
    """Add ros2_control tags, and Gazebo's plugin that reads them.

    Paths of installed files are looked up only where they are needed and not given, so the xacro
    is processed without ROS too.
    """
    share = f"$(find {package_name(twin)})"
    control = add(_xacro(root, "unless", value="${hardware == 'none'}"), "ros2_control",
                  name=_robot_name(twin), type="system")  # fmt: skip
    hardware = add(control, "hardware")
    for name, plugin in SYSTEMS.items():
        one = _with(hardware, name)
        add(one, "plugin").text = plugin
        if name == "mujoco":
            _argument(one, "mujoco_model", f"{share}/mujoco/scene.xml")
            add(one, "param", name="mujoco_model").text = "$(arg mujoco_model)"
    for index in moving_parts(twin):
        _interfaces(control, twin.parts[index])
    gz = _with(root, "gz")
    _argument(gz, "controllers", f"{share}/config/controllers.yaml")
    reader = add(add(gz, "gazebo"), "plugin", filename=GZ_PLUGIN[0], name=GZ_PLUGIN[1])
    add(reader, "parameters").text = "$(arg controllers)"


def _interfaces(control: ET.Element, part: Part) -> None:
    joint = add(control, "joint", name=joint_name(part))
    command = add(joint, "command_interface", name="position")
    for name, value in zip(("min", "max"), part.limits, strict=True):
        add(command, "param", name=name).text = number(value)
    for state in STATES:
        add(joint, "state_interface", name=state)
    add(joint[1], "param", name="initial_value").text = "0"
    if part.joint is not None and part.joint.kind == "screw":
        # MuJoCo's screw is an equality in the model: its slide has no servo to be looked up
        others = _xacro(control, "unless", value="${hardware == 'mujoco'}")
        slide = add(others, "joint", name=f"{joint_name(part)}_slide")
        for state in STATES:
            add(slide, "state_interface", name=state)


def _texts(twin: Twin, moves: bool) -> dict[str, str]:
    """Return what the package holds beside its models: text by path."""
    package, robot = package_name(twin), _robot_name(twin)
    unit = "metre" if twin.meters_per_unit == 1 else (
        f"{number(twin.meters)} m" + ("" if twin.meters_per_unit else ", assumed"))  # fmt: skip

    def filled(text: str, **more: str) -> str:
        return Template(text).substitute(package=package, robot=robot, unit=unit, **more)

    texts = {
        f"resource/{package}": "",
        "package.xml": filled(ros_texts.PACKAGE_XML,
                              control=ros_texts.CONTROL_DEPENDS if moves else ""),
        "setup.py": filled(ros_texts.SETUP_PY),
        "launch/display.launch.py": filled(ros_texts.DISPLAY),
        f"rviz/{robot}.rviz": yaml.safe_dump(_rviz(twin), sort_keys=False),
        "README.md": filled(ros_texts.README,
                            run=filled(ros_texts.CONTROL_RUN) if moves else ""),
    }  # fmt: skip
    if moves:
        texts["launch/control.launch.py"] = filled(ros_texts.CONTROL)
        texts["config/controllers.yaml"] = yaml.safe_dump(_controllers(twin), sort_keys=False)
    return texts


def _controllers(twin: Twin) -> dict[str, Any]:
    joints = [joint_name(twin.parts[i]) for i in moving_parts(twin)]
    broadcaster = "joint_state_broadcaster"
    trajectory = "joint_trajectory_controller"
    return {
        "controller_manager": {"ros__parameters": {
            "update_rate": UPDATE_RATE,
            broadcaster: {"type": f"{broadcaster}/JointStateBroadcaster"},
            "twin_controller": {"type": f"{trajectory}/JointTrajectoryController"},
        }},
        "twin_controller": {"ros__parameters": {
            "joints": joints, "command_interfaces": ["position"], "state_interfaces": [*STATES],
        }},
    }  # fmt: skip


def _rviz(twin: Twin) -> dict[str, Any]:
    """Return RViz settings that look at the whole twin."""
    low, high = bounds(tuple(part.mesh for part in twin.parts))
    middle = dict(zip("XYZ", ((low + high) / 2).tolist(), strict=True))
    topic = {"Value": "/robot_description", "Durability Policy": "Transient Local"}
    return {
        "Panels": [{"Class": "rviz_common/Displays", "Name": "Displays"}],
        "Visualization Manager": {
            "Class": "",
            "Displays": [
                {"Class": "rviz_default_plugins/Grid", "Enabled": True, "Name": "Grid"},
                {"Class": "rviz_default_plugins/RobotModel", "Description Source": "Topic",
                 "Description Topic": topic, "Enabled": True, "Name": "Twin"},
            ],
            "Enabled": True,
            "Global Options": {"Background Color": "245; 246; 248", "Fixed Frame": WORLD},
            "Name": "root",
            "Tools": [{"Class": "rviz_default_plugins/MoveCamera"}],
            "Value": True,
            "Views": {"Current": {
                "Class": "rviz_default_plugins/Orbit", "Name": "Current View",
                "Distance": 2 * float(np.linalg.norm(high - low)), "Focal Point": middle,
                "Pitch": 0.5, "Yaw": 0.8, "Target Frame": WORLD,
            }},
        },
    }  # fmt: skip
