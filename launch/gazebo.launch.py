"""Put a twin into Gazebo, with ros2_control where controllers are given.

ros2 launch part2gs_robotics gazebo.launch.py model:=/path/to/out/twin.urdf
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CLOCK = "/clock@rosgraph_msgs/msg/Clock[gz.msgs.Clock"  # [: from Gazebo to ROS only
SYSTEM = "gz_ros2_control/GazeboSimSystem"
PLUGIN = {"filename": "gz_ros2_control-system",
          "name": "gz_ros2_control::GazeboSimROS2ControlPlugin"}  # fmt: skip


def description(model: Path, controllers: str) -> str:
    """Return the URDF text that Gazebo takes: file URIs, and ros2_control tags with controllers.

    A xacro is that of an exported ROS 2 package, which has tags of its own.
    """
    if model.suffix == ".xacro":
        import xacro

        given = {"hardware": "gz" if controllers else "none", "controllers": controllers,
                 "meshes": (model.parents[1] / "meshes").as_uri()}  # fmt: skip
        robot = ET.fromstring(xacro.process_file(str(model), mappings=given).toxml())
    else:
        robot = ET.parse(model).getroot()
    for mesh in robot.iter("mesh"):
        name = mesh.attrib["filename"]
        if "://" not in name:  # twin.urdf names its meshes bare, Gazebo resolves URIs only
            mesh.set("filename", (model.parent / name).as_uri())
    if controllers and robot.find("ros2_control") is None:
        add_control(robot, controllers)
    return ET.tostring(robot, encoding="unicode")


def add_control(robot: ET.Element, controllers: str) -> None:
    """Add ros2_control tags for every joint that moves, and the plugin that reads them."""
    control = ET.SubElement(robot, "ros2_control", name="twin", type="system")
    ET.SubElement(ET.SubElement(control, "hardware"), "plugin").text = SYSTEM
    for joint in robot.findall("joint"):
        limit = joint.find("limit")
        if limit is None:
            continue
        entry = ET.SubElement(control, "joint", name=joint.attrib["name"])
        if joint.find("mimic") is None:  # the slide of a screw follows its turn
            command = ET.SubElement(entry, "command_interface", name="position")
            for end, key in (("min", "lower"), ("max", "upper")):
                ET.SubElement(command, "param", name=end).text = limit.attrib[key]
        for state in ("position", "velocity"):
            ET.SubElement(entry, "state_interface", name=state)
    plugin = ET.SubElement(ET.SubElement(robot, "gazebo"), "plugin", PLUGIN)
    ET.SubElement(plugin, "parameters").text = controllers


def controller_names(path: Path) -> list[str]:
    """Return what the controller manager's parameters give a type to."""
    parameters = yaml.safe_load(path.read_text(encoding="utf-8"))
    manager = parameters["controller_manager"]["ros__parameters"]
    return [name for name, value in manager.items() if isinstance(value, dict) and "type" in value]


def start(context: LaunchContext) -> list[Node]:
    """Return the nodes for the model and the controllers that the arguments name."""
    model, controllers = (LaunchConfiguration(n).perform(context) for n in ("model", "controllers"))
    path = Path(model).expanduser().resolve()
    settings = Path(controllers).expanduser().resolve() if controllers else None
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: no such URDF. Expected the twin.urdf of a build; give model:=/path/twin.urdf"
        )
    if settings is not None and not settings.is_file():
        raise FileNotFoundError(
            f"{settings}: no such controllers. Expected the controllers.yaml of an exported ROS 2 "
            "package; give controllers:=/path/controllers.yaml"
        )
    text = description(path, str(settings or ""))
    parameters = {"robot_description": ParameterValue(text, value_type=str), "use_sim_time": True}
    name = ET.fromstring(text).attrib["name"]
    nodes = [
        Node(package="robot_state_publisher", executable="robot_state_publisher",
             parameters=[parameters]),
        Node(package="ros_gz_sim", executable="create", output="screen",
             arguments=["-topic", "robot_description", "-name", name]),
        Node(package="ros_gz_bridge", executable="parameter_bridge", arguments=[CLOCK]),
    ]  # fmt: skip
    if settings is not None:
        nodes.append(Node(package="controller_manager", executable="spawner", output="screen",
                          arguments=controller_names(settings)))  # fmt: skip
    return nodes


def generate_launch_description() -> LaunchDescription:
    """Return the arguments, the simulator and the nodes."""
    simulator = PathJoinSubstitution([FindPackageShare("ros_gz_sim"), "launch", "gz_sim.launch.py"])
    arguments = {"gz_args": ["-r ", LaunchConfiguration("world")]}
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "model", description="twin.urdf of a build, or the .urdf.xacro of its ROS 2 package"
            ),
            DeclareLaunchArgument(
                "controllers", default_value="", description="controllers.yaml; none: parts swing"
            ),
            DeclareLaunchArgument("world", default_value="empty.sdf", description="SDF world"),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(simulator), launch_arguments=arguments.items()
            ),
            OpaqueFunction(function=start),
        ]
    )
