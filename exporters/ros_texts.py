"""Texts of an exported ROS 2 package; $package, $robot, $base and the like are filled in."""

from __future__ import annotations

PACKAGE_XML = """\
<?xml version="1.0"?>
<?xml-model href="http://download.ros.org/schema/package_format3.xsd" \
schematypens="http://www.w3.org/2001/XMLSchema"?>
<package format="3">
  <name>$package</name>
  <version>0.1.0</version>
  <description>Digital twin of $robot: URDF, meshes, MJCF, controllers.</description>
  <maintainer email="maintainer@example.invalid">who exported it</maintainer>
  <license>see README.md</license>

  <exec_depend>launch</exec_depend>
  <exec_depend>launch_ros</exec_depend>
  <exec_depend>xacro</exec_depend>
  <exec_depend>robot_state_publisher</exec_depend>
  <exec_depend>joint_state_publisher</exec_depend>
  <exec_depend>joint_state_publisher_gui</exec_depend>
  <exec_depend>rviz2</exec_depend>
$control
  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
"""

# Of a twin that moves. The simulators stay optional: each is needed with its own hardware alone.
CONTROL_DEPENDS = """\
  <exec_depend>controller_manager</exec_depend>
  <exec_depend>joint_state_broadcaster</exec_depend>
  <exec_depend>joint_trajectory_controller</exec_depend>
"""

# ament_python, since colcon builds it also where ROS is not installed; ament_cmake asks for ROS.
SETUP_PY = '''\
"""Install what the package holds below share/: it has no code of its own."""

from pathlib import Path

from setuptools import setup

NAME = "$package"
SHARE = Path("share") / NAME
FOLDERS = ("urdf", "meshes", "mujoco", "launch", "rviz", "config")
FILES = sorted(p for folder in FOLDERS for p in Path(folder).rglob("*")
               if p.is_file() and "__pycache__" not in p.parts)

setup(
    name=NAME,
    version="0.1.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (str(SHARE), ["package.xml", "README.md"]),
        *((str(SHARE / p.parent), [str(p)]) for p in FILES),
    ],
)
'''

DISPLAY = '''\
"""Show the twin in RViz with joint sliders: ros2 launch $package display.launch.py."""

from pathlib import Path

import xacro
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(__file__).parents[1]
MODEL = SHARE / "urdf/$robot.urdf.xacro"
RVIZ = SHARE / "rviz/$robot.rviz"


def generate_launch_description():
    """Return the arguments and the nodes."""
    text = xacro.process_file(str(MODEL), mappings={"hardware": "none"}).toxml()
    clock = {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}
    description = {"robot_description": ParameterValue(text, value_type=str)}
    publisher = "joint_state_publisher"
    return LaunchDescription([
        DeclareLaunchArgument("gui", default_value="true", description="joint sliders"),
        DeclareLaunchArgument("rviz", default_value="true", description="start RViz"),
        DeclareLaunchArgument("rvizconfig", default_value=str(RVIZ), description="RViz settings"),
        DeclareLaunchArgument("use_sim_time", default_value="false", description="follow /clock"),
        Node(package="robot_state_publisher", executable="robot_state_publisher",
             parameters=[description | clock]),
        Node(package=f"{publisher}_gui", executable=f"{publisher}_gui", parameters=[clock],
             condition=IfCondition(LaunchConfiguration("gui"))),
        Node(package=publisher, executable=publisher, parameters=[clock],
             condition=UnlessCondition(LaunchConfiguration("gui"))),
        Node(package="rviz2", executable="rviz2", parameters=[clock],
             arguments=["-d", LaunchConfiguration("rvizconfig")],
             condition=IfCondition(LaunchConfiguration("rviz"))),
    ])
'''

CONTROL = '''\
"""Drive the twin by ros2_control: ros2 launch $package control.launch.py hardware:=mujoco."""

from pathlib import Path

import xacro
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

SHARE = Path(__file__).parents[1]
MODEL = SHARE / "urdf/$robot.urdf.xacro"
CONTROLLERS = SHARE / "config/controllers.yaml"
WORLD = SHARE / "mujoco/scene.xml"
# MuJoCo brings the same node, built with its simulator.
NODE_OF = {"mock": "controller_manager", "mujoco": "mujoco_ros2_control"}


def start(context):
    """Return the nodes for the hardware that is asked for."""
    hardware = LaunchConfiguration("hardware").perform(context)
    if hardware not in NODE_OF:
        raise ValueError(f"hardware:={hardware}. Expected one of {', '.join(NODE_OF)}; Gazebo is "
                         "started by part2gs_robotics gazebo.launch.py")
    given = {"hardware": hardware, "mujoco_model": str(WORLD)}
    text = xacro.process_file(str(MODEL), mappings=given).toxml()
    clock = {"use_sim_time": hardware == "mujoco"}
    description = {"robot_description": ParameterValue(text, value_type=str)}
    return [
        Node(package="robot_state_publisher", executable="robot_state_publisher",
             parameters=[description | clock]),
        Node(package=NODE_OF[hardware], executable="ros2_control_node", output="screen",
             parameters=[str(CONTROLLERS), clock]),
        Node(package="controller_manager", executable="spawner", output="screen",
             arguments=["joint_state_broadcaster", "twin_controller"]),
    ]


def generate_launch_description():
    """Return the argument and the nodes."""
    return LaunchDescription([
        DeclareLaunchArgument("hardware", default_value="mock", description="mock or mujoco"),
        OpaqueFunction(function=start),
    ])
'''

README = """\
# $package

Digital twin of `$robot`, written by part2gs-robotics. Put this folder into a workspace,
`colcon build`, then

    ros2 launch $package display.launch.py     # RViz with joint sliders
$run
| folder | holds |
|---|---|
| `urdf/` | the model; arguments `hardware`, `meshes`, `controllers`, `mujoco_model` |
| `meshes/` | visual meshes with their textures, convex collision pieces |
| `mujoco/` | the same twin as MJCF with servos, in a world |
| `config/` | controllers |

Unit: $unit. Joint position 0 is the first photographed state. Masses, friction and forces of joints
are assumed unless the build was told better. Licence and maintainer of `package.xml` are for you to
fill in.
"""

CONTROL_RUN = """\
    ros2 launch $package control.launch.py     # ros2_control: hardware:=mock, or mujoco

Gazebo: `gazebo.launch.py` of part2gs_robotics with `model:=` the xacro and `controllers:=` the file
`config/controllers.yaml`.
"""
