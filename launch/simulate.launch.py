"""Simulate a twin in MuJoCo's own viewer, with a slider for every actuator.

ros2 launch part2gs_robotics simulate.launch.py model:=/path/to/out/scene.xml
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.substitutions import LaunchConfiguration

# mujoco.viewer's own command, but warnings go to the screen: by default the engine leaves them in
# a file MUJOCO_LOG.TXT where the user stands.
VIEWER = (
    "import sys, mujoco, mujoco.viewer; "
    "mujoco.set_mju_user_warning(lambda text: print('MuJoCo:', text, file=sys.stderr)); "
    "mujoco.viewer.launch_from_path(sys.argv[1])"
)


def simulate(context: LaunchContext) -> list[ExecuteProcess]:
    """Return the viewer's process for the MJCF that the argument `model` names."""
    path = Path(LaunchConfiguration("model").perform(context)).expanduser().resolve()
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such MJCF. Expected the scene.xml of a build; give model:=/path/scene.xml"
        )
    python = LaunchConfiguration("python").perform(context)
    command = [python, "-c", VIEWER, str(path)]
    return [ExecuteProcess(cmd=command, output="screen")]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the viewer's process."""
    return LaunchDescription(
        [
            DeclareLaunchArgument("model", description="scene.xml of a build"),
            DeclareLaunchArgument(
                "python",
                default_value="python3",
                description="Python that has mujoco, where ROS uses another one",
            ),
            OpaqueFunction(function=simulate),
        ]
    )
