"""Show a twin in RViz: robot_state_publisher, joint sliders, RViz.

ros2 launch part2gs_robotics display.launch.py model:=/path/to/out/twin.urdf
"""

import re
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

RVIZ = Path(__file__).with_name("twin.rviz")
_MESH = re.compile(r'(<mesh\b[^>]*?\bfilename=)(["\'])(?![a-z0-9+.-]+://)(.*?)\2')


def with_file_uris(text: str, folder: Path) -> str:
    """Return the URDF text with every mesh name as a file URI below `folder`.

    The exported URDF names its meshes from its own folder, which MuJoCo and offline viewers need;
    RViz resolves URIs only.
    """
    return _MESH.sub(
        lambda found: f"{found[1]}{found[2]}{(folder / found[3]).as_uri()}{found[2]}", text
    )


def show(context: LaunchContext) -> list[Node]:
    """Return the nodes for the URDF that the argument `model` names."""
    path = Path(LaunchConfiguration("model").perform(context)).expanduser().resolve()
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such URDF. Expected the twin.urdf of a build; give model:=/path/twin.urdf"
        )
    text = with_file_uris(path.read_text(encoding="utf-8"), path.parent)
    description = {"robot_description": ParameterValue(text, value_type=str)}
    clock = {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}
    sliders = IfCondition(LaunchConfiguration("gui"))
    still = UnlessCondition(LaunchConfiguration("gui"))
    return [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[description | clock],
        ),
        Node(
            package="joint_state_publisher_gui",
            executable="joint_state_publisher_gui",
            parameters=[clock],
            condition=sliders,
        ),
        Node(
            package="joint_state_publisher",
            executable="joint_state_publisher",
            parameters=[clock],
            condition=still,
        ),
        Node(
            package="rviz2",
            executable="rviz2",
            arguments=["-d", LaunchConfiguration("rvizconfig")],
            parameters=[clock],
            condition=IfCondition(LaunchConfiguration("rviz")),
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the nodes."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("model", description="twin.urdf of a build"),
            DeclareLaunchArgument("gui", default_value="true", description="joint sliders"),
            DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
            DeclareLaunchArgument(
                "rvizconfig", default_value=str(RVIZ), description="RViz settings"
            ),
            DeclareLaunchArgument(
                "use_sim_time", default_value="false", description="follow /clock"
            ),
            OpaqueFunction(function=show),
        ]
    )
