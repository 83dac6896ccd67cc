"""ROS without ROS: stand-ins that record what a launch file would start, and colcon."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


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


class IncludeLaunchDescription(Recorded):
    """Another launch file."""


class PythonLaunchDescriptionSource(Recorded):
    """Where it is."""


class PathJoinSubstitution(Recorded):
    """A path of parts."""


class FindPackageShare(Recorded):
    """The share folder of a package."""


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
    "launch.actions": [DeclareLaunchArgument, OpaqueFunction, ExecuteProcess,
                       IncludeLaunchDescription],
    "launch.launch_description_sources": [PythonLaunchDescriptionSource],
    "launch.conditions": [IfCondition, UnlessCondition],
    "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution],
    "launch_ros": [],
    "launch_ros.actions": [Node],
    "launch_ros.parameter_descriptions": [ParameterValue],
    "launch_ros.substitutions": [FindPackageShare],
}  # fmt: skip


def load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.name.replace(".", "_"), path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def modules() -> dict[str, ModuleType]:
    """Return the stand-ins for ROS's own modules, by name."""
    made = {}
    for name, classes in STUBS.items():
        made[name] = ModuleType(name)
        for one in classes:
            setattr(made[name], one.__name__, one)
    return made


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


def colcon(workspace: Path) -> Path:
    """Build a workspace as ROS would; return its install tree."""
    if shutil.which("colcon", path=str(Path(sys.executable).parent)) is None:
        pytest.skip("colcon is not installed; it is part of the dev extra")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    quiet = {"PYTHONWARNINGS": "ignore", "COLCON_LOG_LEVEL": "error", "PATH": path}
    command = ["colcon", "build", "--event-handlers", "console_direct+"]
    done = subprocess.run(
        command, cwd=workspace, env=os.environ | quiet, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / "install"
