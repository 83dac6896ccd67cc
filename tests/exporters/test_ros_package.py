"""ROS 2 package: the xacro is twin.urdf, colcon builds it, launch files name installed files."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest
import xacro
import yaml
from ros_stubs import DeclareLaunchArgument, LaunchDescription, Node, by_package, colcon, started
from ros_stubs import load as load_launch
from synth import scaled, toy_cabinet_twin

from part2gs_robotics.errors import StoreError
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.exporters.ros_package import SYSTEMS, package_name, write_ros
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import moving_parts, part_transforms

TWIN = toy_cabinet_twin(4)
PACKAGE = "toy_cabinet_description"


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("package")
    files = write_ros(TWIN, folder)
    assert sorted(files) == sorted(path for path in folder.rglob("*") if path.is_file())
    return folder


def processed(package: Path, **given: str) -> str:
    (model,) = package.glob("urdf/*.xacro")
    return xacro.process_file(str(model), mappings=given).toxml()


def loaded(package: Path, folder: Path, **given: str) -> mujoco.MjModel:
    """Return the processed xacro in MuJoCo."""
    path = folder / "processed.urdf"
    path.write_text(processed(package, meshes=str(package / "meshes"), **given))
    return mujoco.MjModel.from_xml_path(str(path))


def places(model: mujoco.MjModel, twin, positions) -> dict[str, np.ndarray]:
    """Return [4, 4] of every part's visual mesh for given joint positions."""
    data = mujoco.MjData(model)
    for index, q in zip(moving_parts(twin), positions, strict=True):
        part = twin.parts[index]
        data.joint(joint_name(part)).qpos[:] = q
        if part.joint.kind == "screw":
            data.joint(f"{joint_name(part)}_slide").qpos[:] = q * part.joint.pitch
    mujoco.mj_kinematics(model, data)
    out = {}
    for part in twin.parts:
        geom, out[part.name] = data.geom(f"{part.name}_visual"), np.eye(4)
        out[part.name][:3, :3], out[part.name][:3, 3] = geom.xmat.reshape(3, 3), geom.xpos
    return out


@pytest.mark.parametrize("hardware", ["none", "mock"])
def test_the_xacro_moves_like_the_twin(package: Path, tmp_path: Path, hardware: str) -> None:
    model = loaded(package, tmp_path, hardware=hardware)
    rest = places(model, TWIN, [0.0] * 4)
    rng = np.random.default_rng(2)
    for _ in range(100):
        q = [rng.uniform(*TWIN.parts[i].limits) for i in moving_parts(TWIN)]
        found = places(model, TWIN, q)
        for part, place in zip(TWIN.parts, part_transforms(TWIN, q), strict=True):
            moved = found[part.name] @ np.linalg.inv(rest[part.name])
            np.testing.assert_allclose(moved, place, atol=1e-6)


def test_the_xacro_is_twin_urdf_but_for_mesh_paths_and_control(
    package: Path, tmp_path: Path
) -> None:
    write_urdf(TWIN, tmp_path)
    plain = ET.parse(tmp_path / "twin.urdf").getroot()
    made = ET.fromstring(processed(package, hardware="none", meshes="m"))
    for root in (plain, made):
        for mesh in root.iter("mesh"):
            mesh.set("filename", Path(mesh.get("filename")).name)
    texts = [ET.canonicalize(ET.tostring(root), strip_text=True) for root in (plain, made)]
    assert texts[0] == texts[1].replace(' xmlns:xacro="http://www.ros.org/wiki/xacro"', "")


def test_meshes_are_found_by_the_default_path(package: Path) -> None:
    robot = ET.fromstring(processed(package, hardware="none"))
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename")
        assert (package / name.removeprefix(f"package://{PACKAGE}/")).is_file()


@pytest.mark.parametrize("hardware", SYSTEMS)
def test_every_moving_joint_has_interfaces_with_its_limits(package: Path, hardware: str) -> None:
    given = {"controllers": "c.yaml", "mujoco_model": "m.xml"}
    robot = ET.fromstring(processed(package, hardware=hardware, **given))
    control = robot.find("ros2_control")
    assert control.findtext("hardware/plugin") == SYSTEMS[hardware]
    model = control.findtext("hardware/param[@name='mujoco_model']")
    assert model == ("m.xml" if hardware == "mujoco" else None)
    assert robot.findtext("gazebo/plugin/parameters") == ("c.yaml" if hardware == "gz" else None)
    joints = {joint.get("name"): joint for joint in control.findall("joint")}
    for index in moving_parts(TWIN):
        part = TWIN.parts[index]
        joint = joints.pop(joint_name(part))
        (command,) = joint.findall("command_interface")
        assert command.get("name") == "position"
        ends = [float(command.findtext(f"param[@name='{end}']")) for end in ("min", "max")]
        np.testing.assert_allclose(ends, part.limits)
        states = {state.get("name") for state in joint.findall("state_interface")}
        assert states == {"position", "velocity"}
    slides = {} if hardware == "mujoco" else {"part_4_joint_slide"}
    assert set(joints) == set(slides)  # of the screw: it follows, and takes no command
    assert not any(joints[name].findall("command_interface") for name in slides)


def test_an_unknown_hardware_is_named(package: Path) -> None:
    with pytest.raises(xacro.XacroException, match=r"hardware is toaster - expected one of"):
        processed(package, hardware="toaster")


def test_the_world_of_mujoco_has_a_servo_per_controlled_joint(package: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(package / "mujoco/scene.xml"))
    driven = [model.joint(model.actuator_trnid[i, 0]).name for i in range(model.nu)]
    controllers = yaml.safe_load((package / "config/controllers.yaml").read_text())
    assert controllers["twin_controller"]["ros__parameters"]["joints"] == driven
    types = controllers["controller_manager"]["ros__parameters"]
    assert types["twin_controller"]["type"].endswith("JointTrajectoryController")


def test_package_xml_is_valid_and_named_like_the_marker(package: Path) -> None:
    parse = pytest.importorskip("catkin_pkg.package").parse_package
    found = parse(str(package / "package.xml"))
    found.validate()
    assert (found.name, found.get_build_type()) == (PACKAGE, "ament_python")
    assert (package / "resource" / found.name).read_text() == ""
    needed = {d.name for d in found.exec_depends}
    assert {"xacro", "rviz2", "robot_state_publisher", "controller_manager"} <= needed


@pytest.mark.parametrize(("name", "expected"), [
    ("toy", "toy_description"), ("Küche 3 <b>&", "k_che_3_b_description"),
    ("7up", "twin_7up_description"), ("", "twin_description"), ("${evil}", "evil_description"),
])  # fmt: skip
def test_odd_names_become_names_that_ros_takes(tmp_path: Path, name: str, expected: str) -> None:
    twin = replace(toy_cabinet_twin(1), name=name)
    assert package_name(twin) == expected
    write_ros(twin, tmp_path)
    assert ET.fromstring(processed(tmp_path, hardware="mock")).get("name") == expected[:-12]


@pytest.mark.parametrize("still", [True, False])
def test_a_twin_that_does_not_move_needs_no_control(tmp_path: Path, still: bool) -> None:
    base, part = toy_cabinet_twin(1).parts
    fixed = replace(part, joint=Joint("fixed", np.array([0, 0, 1.0]), np.ones(3), 0.0))
    twin = replace(toy_cabinet_twin(1), parts=(base,) if still else (base, fixed))
    write_ros(twin, tmp_path)
    assert not (tmp_path / "config").exists()
    assert not (tmp_path / "launch/control.launch.py").exists()
    assert loaded(tmp_path, tmp_path).njnt == 0


@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_scenes_of_other_units(tmp_path: Path, factor: float) -> None:
    twin = scaled(toy_cabinet_twin(4), factor)
    write_ros(twin, tmp_path)
    q = [part.limits[1] for part in twin.parts[1:]]
    model = loaded(tmp_path, tmp_path)
    rest, found = places(model, twin, [0.0] * 4), places(model, twin, q)
    for part, place in zip(twin.parts, part_transforms(twin, q), strict=True):
        moved = found[part.name] @ np.linalg.inv(rest[part.name])
        np.testing.assert_allclose(moved, place, atol=1e-6 * factor, rtol=1e-6)


def test_a_folder_that_cannot_be_made_is_an_error_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "urdf").write_text("a file in the way")
    with pytest.raises(StoreError, match="cannot be written"):
        write_ros(TWIN, tmp_path)
    assert (tmp_path / "urdf").read_text() == "a file in the way"


@pytest.fixture(scope="module")
def share(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the installed package's share folder, as colcon makes it."""
    workspace = tmp_path_factory.mktemp("workspace")
    write_ros(TWIN, workspace / "src/any_name")
    install = colcon(workspace) / PACKAGE
    assert (install / f"share/ament_index/resource_index/packages/{PACKAGE}").is_file()
    return install / "share" / PACKAGE


@pytest.fixture
def installed(share: Path, stubs: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let `$(find ...)` of xacro find the installed package."""
    module = ModuleType("ament_index_python.packages")
    module.get_package_share_directory = {PACKAGE: str(share)}.__getitem__  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "ament_index_python", ModuleType("ament_index_python"))
    monkeypatch.setitem(sys.modules, "ament_index_python.packages", module)
    return share


def robot_of(nodes: dict[str, Node]) -> ET.Element:
    value = nodes["robot_state_publisher"].kwargs["parameters"][0]["robot_description"]
    return ET.fromstring(value.args[0])


def defaults(description: LaunchDescription) -> dict[str, str]:
    return {e.args[0]: e.kwargs["default_value"] for e in description.args[0]
            if isinstance(e, DeclareLaunchArgument)}


def test_installed_display_shows_installed_files(installed: Path) -> None:
    description = load_launch(installed / "launch/display.launch.py").generate_launch_description()
    nodes = by_package([e for e in description.args[0] if isinstance(e, Node)])
    assert Path(defaults(description)["rvizconfig"]).is_relative_to(installed)
    settings = yaml.safe_load(Path(defaults(description)["rvizconfig"]).read_text())
    robot = robot_of(nodes)
    links = {link.get("name") for link in robot.findall("link")}
    assert settings["Visualization Manager"]["Global Options"]["Fixed Frame"] in links
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename").removeprefix(f"package://{PACKAGE}/")
        assert (installed / name).is_file()


@pytest.mark.parametrize(("hardware", "node"), [("mock", "controller_manager"),
                                                ("mujoco", "mujoco_ros2_control")])
def test_installed_control_starts_installed_files(
    installed: Path, hardware: str, node: str
) -> None:
    module = load_launch(installed / "launch/control.launch.py")
    nodes = started(module.generate_launch_description(), hardware=hardware)
    (manager,) = [n for n in nodes if n.kwargs["executable"] == "ros2_control_node"]
    assert manager.kwargs["package"] == node
    controllers = Path(manager.kwargs["parameters"][0])
    assert controllers.is_relative_to(installed)
    (spawner,) = [n for n in nodes if n.kwargs["executable"] == "spawner"]
    known = yaml.safe_load(controllers.read_text())["controller_manager"]["ros__parameters"]
    assert set(spawner.kwargs["arguments"]) == {n for n in known if n != "update_rate"}
    robot = robot_of(by_package(nodes))
    assert robot.findtext("ros2_control/hardware/plugin") == SYSTEMS[hardware]
    if hardware == "mujoco":
        mujoco.MjModel.from_xml_path(robot.findtext("ros2_control/hardware/param"))


def test_installed_xacro_finds_its_own_files(installed: Path) -> None:
    for hardware in ("gz", "mujoco"):
        text = processed(installed, hardware=hardware)
        paths = re.findall(rf">({re.escape(str(installed))}[^<]*)<", text)
        assert len(paths) == 1
        assert Path(paths[0]).is_file()
