"""Launch files: what they would start, without ROS, and what colcon installs."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from ros_stubs import (
    DeclareLaunchArgument,
    IfCondition,
    UnlessCondition,
    by_package,
    colcon,
    load,
    started,
)
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.urdf import write_urdf

ROOT = Path(__file__).resolve().parents[2]
URDF = """<?xml version="1.0"?>
<robot name="box"><mujoco><compiler discardvisual="false"/></mujoco>
  <link name="base"><visual><geometry><mesh filename="assets/base.obj"/></geometry></visual>
    <collision><geometry><mesh scale='1 1 1' filename='base_piece_00.stl' /></geometry></collision>
  </link>
  <link name="part_1"><visual><geometry><mesh filename="package://other/a.stl"/></geometry></visual>
    <collision><geometry><mesh filename="file:///tmp/b.stl"/></geometry></collision></link>
</robot>"""


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    folder = tmp_path / 'out & "twin"'
    folder.mkdir()
    (folder / "twin.urdf").write_text(URDF)
    return folder / "twin.urdf"


@pytest.mark.usefixtures("stubs")
def test_display_publishes_the_urdf_with_uris_that_rviz_finds(urdf: Path) -> None:
    module = load(ROOT / "launch/display.launch.py")
    nodes = by_package(started(module.generate_launch_description(), model=str(urdf)))
    expected = {"robot_state_publisher", "joint_state_publisher_gui", "joint_state_publisher"}
    assert set(nodes) == expected | {"rviz2"}
    value = nodes["robot_state_publisher"].kwargs["parameters"][0]["robot_description"]
    assert value.kwargs == {"value_type": str}
    names = [m.get("filename") for m in ET.fromstring(value.args[0]).iter("mesh")]
    uris = [(urdf.parent / name).as_uri() for name in ("assets/base.obj", "base_piece_00.stl")]
    assert names == [*uris, "package://other/a.stl", "file:///tmp/b.stl"]


@pytest.mark.usefixtures("stubs")
def test_display_publishes_an_exported_twin_on_its_world_link(tmp_path: Path) -> None:
    write_urdf(toy_cabinet_twin(2), tmp_path)
    module = load(ROOT / "launch/display.launch.py")
    description = module.generate_launch_description()
    nodes = by_package(started(description, model=str(tmp_path / "twin.urdf")))
    value = nodes["robot_state_publisher"].kwargs["parameters"][0]["robot_description"]
    robot = ET.fromstring(value.args[0])
    children = {c.get("link") for c in robot.findall("joint/child")}
    assert {one.get("name") for one in robot.findall("link")} - children == {"world"}
    files = {(tmp_path / "assets" / m.name).as_uri() for m in (tmp_path / "assets").glob("*.obj")}
    named = {m.get("filename") for m in robot.iter("mesh")}
    assert named <= files
    assert {one for one in files if "piece" not in one} <= named  # pieces that are boxes need none
    settings = yaml.safe_load((ROOT / "launch/twin.rviz").read_text())["Visualization Manager"]
    assert settings["Global Options"]["Fixed Frame"] in children


@pytest.mark.usefixtures("stubs")
def test_sliders_and_plain_publisher_exclude_each_other(urdf: Path) -> None:
    module = load(ROOT / "launch/display.launch.py")
    nodes = by_package(started(module.generate_launch_description(), model=str(urdf)))
    sliders = nodes["joint_state_publisher_gui"].kwargs["condition"]
    plain = nodes["joint_state_publisher"].kwargs["condition"]
    assert (type(sliders), type(plain)) == (IfCondition, UnlessCondition)
    assert sliders.args[0].args == plain.args[0].args == ("gui",)


@pytest.mark.usefixtures("stubs")
def test_simulate_opens_the_model_in_the_viewer(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text("<mujoco/>")
    module = load(ROOT / "launch/simulate.launch.py")
    description = module.generate_launch_description()
    (process,) = started(description, model=str(tmp_path / "scene.xml"))
    command = process.kwargs["cmd"]
    assert command == ["python3", "-c", module.VIEWER, str(tmp_path / "scene.xml")]


# Physics that warns, in place of the window that needs a screen.
WINDOW = """
import mujoco, mujoco.viewer
def steps(path):
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    data.qvel[0] = 1e20
    mujoco.mj_step(model, data)
mujoco.viewer.launch_from_path = steps
"""


@pytest.mark.usefixtures("stubs")
def test_the_viewer_says_warnings_and_leaves_no_log_file(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(
        '<mujoco><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    code = WINDOW + load(ROOT / "launch/simulate.launch.py").VIEWER
    done = subprocess.run(
        [sys.executable, "-c", code, "scene.xml"],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        timeout=60,
        check=True,
    )
    assert "MuJoCo: Nan, Inf or huge value in QVEL" in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["scene.xml"]


def yaml_launch() -> tuple[dict[str, str], dict]:
    """Return the arguments of the YAML launch file with their defaults, and what it executes."""
    text = (ROOT / "launch/build_and_check.launch.yaml").read_text()
    entities = yaml.safe_load(text)["launch"]
    arguments = [e["arg"] for e in entities if "arg" in e]
    (process,) = [e["executable"] for e in entities if "executable" in e]
    return {a["name"]: a.get("default", "") for a in arguments}, process


@pytest.mark.parametrize(("code", "calls"), [(0, 2), (1, 2), (2, 1)])
def test_build_and_check_checks_what_was_built(tmp_path: Path, code: int, calls: int) -> None:
    folder = tmp_path / "a folder"
    folder.mkdir()
    robot = folder / "robot"
    says = 'for word; do echo "$word"; done'
    robot.write_text(f'#!/bin/sh\n{says}\n[ "$1" = build ] && exit {code}\nexit 7\n')
    robot.chmod(0o755)
    given = {"robot": str(robot), "scene": str(folder / "s $x"), "out": str(folder / "out")}
    arguments, process = yaml_launch()
    assert set(arguments) == set(given)
    entries = {e["name"]: re.fullmatch(r"\$\(var (\w+)\)", e["value"])[1] for e in process["env"]}
    env = os.environ | {name: given[argument] for name, argument in entries.items()}
    done = subprocess.run(shlex.split(process["cmd"]), env=env, capture_output=True, text=True,
                          check=False)
    build = ["build", given["scene"], "-o", given["out"]]
    assert done.stdout.splitlines() == build + (["check", given["out"]] if calls == 2 else [])
    assert done.returncode == (7 if calls == 2 else code)


def test_build_and_check_finds_the_installed_command(install: Path) -> None:
    default = yaml_launch()[0]["robot"]
    path = default.replace("$(find-pkg-prefix part2gs_robotics)", str(install))
    assert os.access(path, os.X_OK)


def test_real_launch_reads_the_yaml_file() -> None:
    sources = pytest.importorskip("launch.launch_description_sources", reason="needs ROS 2")
    path = str(ROOT / "launch/build_and_check.launch.yaml")
    assert sources.AnyLaunchDescriptionSource(path).try_get_launch_description_without_context()


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize("name", ["display", "simulate", "gazebo"])
def test_a_missing_model_is_named(tmp_path: Path, name: str) -> None:
    module = load(ROOT / f"launch/{name}.launch.py")
    with pytest.raises(FileNotFoundError, match=r"absent\.xml: no such .* Expected .* model:="):
        started(module.generate_launch_description(), model=str(tmp_path / "absent.xml"))


def test_the_viewer_takes_the_flag_that_simulate_passes() -> None:
    source = importlib.util.find_spec("mujoco")
    assert source is not None
    assert source.origin is not None
    assert "'--mjcf'" in Path(source.origin).with_name("viewer.py").read_text()


def test_rviz_settings_show_the_published_robot() -> None:
    settings = yaml.safe_load((ROOT / "launch/twin.rviz").read_text())["Visualization Manager"]
    robot = next(d for d in settings["Displays"] if d["Class"].endswith("/RobotModel"))
    assert robot["Description Topic"]["Value"] == "/robot_description"
    assert settings["Global Options"]["Fixed Frame"] == "base"  # the twin's static link


def test_package_xml_names_what_the_launch_files_start() -> None:
    parse = pytest.importorskip("catkin_pkg.package").parse_package
    package = parse(str(ROOT / "package.xml"))
    package.validate()
    assert (package.package_format, package.get_build_type()) == (3, "ament_python")
    needed = {"launch", "launch_ros", "robot_state_publisher", "joint_state_publisher_gui", "rviz2",
              "ros_gz_sim", "ros_gz_bridge", "launch_yaml"}  # fmt: skip
    assert needed <= {d.name for d in package.exec_depends}


def test_launch_folder_is_data_not_a_package() -> None:
    assert not (ROOT / "launch/__init__.py").exists()


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package with colcon, as a ROS workspace would."""
    workspace = tmp_path_factory.mktemp("workspace")
    ignored = shutil.ignore_patterns(".*", "out", "build", "dist", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, workspace / "src/part2gs_robotics", ignore=ignored)
    return colcon(workspace) / "part2gs_robotics"


def test_colcon_installs_the_ros_package(install: Path) -> None:
    share = install / "share/part2gs_robotics"
    assert (install / "share/ament_index/resource_index/packages/part2gs_robotics").is_file()
    assert (share / "package.xml").is_file()
    assert {p.name for p in (share / "launch").glob("*.*")} >= {
        "display.launch.py", "simulate.launch.py", "gazebo.launch.py", "twin.rviz",
        "build_and_check.launch.yaml",
    }  # fmt: skip
    assert (install / "lib/part2gs_robotics/part2gs-robot").is_file()
    (package,) = install.glob("lib/python3*/site-packages/part2gs_robotics")
    assert (package / "exporters/__init__.py").is_file()
    assert (package / "sim_checks/__init__.py").is_file()


@pytest.mark.usefixtures("stubs")
def test_installed_launch_files_refer_to_installed_files(install: Path, urdf: Path) -> None:
    module = load(install / "share/part2gs_robotics/launch/display.launch.py")
    description = module.generate_launch_description()
    defaults = {
        a.args[0]: a.kwargs.get("default_value")
        for a in description.args[0]
        if isinstance(a, DeclareLaunchArgument)
    }
    assert Path(defaults["rvizconfig"]).is_file()
    assert Path(defaults["rvizconfig"]).is_relative_to(install)
    assert len(started(description, model=str(urdf))) == 4


@pytest.mark.parametrize("name", ["display", "simulate", "gazebo"])
def test_real_launch_accepts_the_files(name: str) -> None:
    pytest.importorskip("launch_ros", reason="needs a ROS 2 installation")
    assert load(ROOT / f"launch/{name}.launch.py").generate_launch_description().entities
