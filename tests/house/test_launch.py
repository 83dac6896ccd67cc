"""Launch files: what they would start, without ROS, and what colcon installs."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
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


class Recorded:
    """Stands for any launch class: keeps what it was called with."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        self.args, self.kwargs = args, kwargs


class LaunchDescription(Recorded):
    """A list of entities."""


class DeclareLaunchArgument(Recorded):
    """A declared argument."""


class OpaqueFunction(Recorded):
    """A function that runs once arguments are known."""


class ExecuteProcess(Recorded):
    """A process."""


class Node(Recorded):
    """A ROS node."""


class IfCondition(Recorded):
    """A condition."""


class UnlessCondition(Recorded):
    """The opposite condition."""


class ParameterValue(Recorded):
    """A typed parameter."""


@dataclass
class LaunchContext:
    """Values of the arguments."""

    values: dict[str, str] = field(default_factory=dict)


class LaunchConfiguration(Recorded):
    """A reference to an argument."""

    def perform(self, context: LaunchContext) -> str:
        return context.values[self.args[0]]


STUBS = {
    "launch": [LaunchDescription, LaunchContext],
    "launch.actions": [DeclareLaunchArgument, OpaqueFunction, ExecuteProcess],
    "launch.conditions": [IfCondition, UnlessCondition],
    "launch.substitutions": [LaunchConfiguration],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.parameter_descriptions": [ParameterValue],
}


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.name.replace(".", "_"), path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def stubs(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, classes in STUBS.items():
        module = ModuleType(name)
        for one in classes:
            setattr(module, one.__name__, one)
        monkeypatch.setitem(sys.modules, name, module)


def started(description: LaunchDescription, **given: str) -> list[Any]:
    """Return the entities that start, with declared defaults filled in."""
    entities = description.args[0]
    arguments = [e for e in entities if isinstance(e, DeclareLaunchArgument)]
    defaults = {a.args[0]: a.kwargs["default_value"] for a in arguments if len(a.kwargs) > 1}
    context = LaunchContext(defaults | given)
    functions = [e.kwargs["function"] for e in entities if isinstance(e, OpaqueFunction)]
    return [entity for function in functions for entity in function(context)]


def by_package(nodes: list[Node]) -> dict[str, Node]:
    return {n.kwargs["package"]: n for n in nodes}


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
    assert {m.get("filename") for m in robot.iter("mesh")} == files
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


@pytest.mark.usefixtures("stubs")
@pytest.mark.parametrize("name", ["display", "simulate"])
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
    needed = {"launch", "launch_ros", "robot_state_publisher", "joint_state_publisher_gui", "rviz2"}
    assert needed <= {d.name for d in package.exec_depends}


def test_launch_folder_is_data_not_a_package() -> None:
    assert not (ROOT / "launch/__init__.py").exists()


@pytest.fixture(scope="module")
def install(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package with colcon, as a ROS workspace would."""
    if shutil.which("colcon", path=str(Path(sys.executable).parent)) is None:
        pytest.skip("colcon is not installed; it is part of the dev extra")
    workspace = tmp_path_factory.mktemp("workspace")
    source = workspace / "src/part2gs_robotics"
    ignored = shutil.ignore_patterns(".*", "out", "build", "dist", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, ignore=ignored)
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    quiet = {"PYTHONWARNINGS": "ignore", "COLCON_LOG_LEVEL": "error", "PATH": path}
    command = ["colcon", "build", "--event-handlers", "console_direct+"]
    done = subprocess.run(
        command, cwd=workspace, env=os.environ | quiet, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / "install/part2gs_robotics"


def test_colcon_installs_the_ros_package(install: Path) -> None:
    share = install / "share/part2gs_robotics"
    assert (install / "share/ament_index/resource_index/packages/part2gs_robotics").is_file()
    assert (share / "package.xml").is_file()
    assert {p.name for p in (share / "launch").glob("*.*")} >= {
        "display.launch.py", "simulate.launch.py", "twin.rviz",
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


@pytest.mark.parametrize("name", ["display", "simulate"])
def test_real_launch_accepts_the_files(name: str) -> None:
    pytest.importorskip("launch_ros", reason="needs a ROS 2 installation")
    assert load(ROOT / f"launch/{name}.launch.py").generate_launch_description().entities
