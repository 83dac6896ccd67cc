"""The small models that `fuzz_models.py` mutates: MJCF, URDF of a ROS package, a twin, OpenUSD."""

from __future__ import annotations

from pathlib import Path

from toy_scenes import toy_cabinet_twin

MJCF = """<mujoco model="m"><compiler angle="radian"/><option timestep="0.002"/>
<default><default class="c"><geom density="500"/></default></default>
<asset><mesh name="box" file="box.obj"/><material name="k" rgba="1 0 0 1"/></asset>
<worldbody><include file="part.xml"/><light pos="0 0 3"/>
<body name="b" pos="0 0 1"><joint name="j" type="slide" axis="1 0 0" range="0 .5" limited="true"/>
<inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>
<geom name="g" type="mesh" mesh="box" class="c" material="k"/>
<body name="c" pos="0 0 .3"><joint name="h" axis="0 1 0" range="0 1" limited="true"/>
<geom type="capsule" size=".02 .1" mass=".2"/></body></body></worldbody>
<contact><exclude body1="b" body2="c"/></contact>
<equality><joint joint1="h" joint2="j" polycoef="0 1 0 0 0" active="false"/></equality>
<actuator><position name="s" joint="j" kp="100" kv="20" ctrlrange="0 .5"/></actuator>
<keyframe><key name="state_0" qpos="0 0"/><key name="state_1" qpos=".4 .5"/></keyframe></mujoco>
"""
PART = '<mujocoinclude><geom name="floor" type="plane" size="1 1 .1" pos="0 0 -5"/></mujocoinclude>'
URDF = """<robot name="r"><link name="base"><inertial><mass value="2"/><inertia ixx=".1" ixy="0"
 ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial><collision><geometry><box size=".4 .4 .02"/>
</geometry></collision></link><link name="lid"><inertial><origin xyz="0 0 0"/><mass value="1"/>
<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial><visual><geometry>
<mesh filename="package://pack/meshes/box.obj" scale="1 1 1"/></geometry></visual><collision>
<geometry><mesh filename="package://pack/meshes/box.obj"/></geometry></collision></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="lid"/><origin xyz="0 0 .3"
 rpy="0 0 0"/><axis xyz="0 1 0"/><limit lower="0" upper="1" effort="10" velocity="1"/>
<dynamics damping=".1"/></joint></robot>
"""


def make_bases(folder: Path) -> dict[str, tuple[Path, str]]:
    """Write the models that are mutated; return folder and main file by name."""
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
    from part2gs_robotics.exporters.urdf import write_urdf
    from part2gs_robotics.exporters.usd import write_usd

    twin = toy_cabinet_twin(1)
    box = "".join(f"v {x} {y} {z}\n" for x in (-.1, .1) for y in (-.1, .1) for z in (-.1, .1))
    box += "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\n"
    box += "f 1 7 5\nf 2 6 8\nf 2 8 4\n"
    for name in ("mjcf", "ros/urdf", "ros/meshes", "twin", "usd"):
        (folder / name).mkdir(parents=True)
    (folder / "mjcf/m.xml").write_text(MJCF)
    (folder / "mjcf/part.xml").write_text(PART)
    (folder / "mjcf/box.obj").write_text(box)
    (folder / "ros/package.xml").write_text("<package><name>pack</name></package>")
    (folder / "ros/urdf/m.urdf").write_text(URDF)
    (folder / "ros/meshes/box.obj").write_text(box)
    write_mjcf(twin, folder / "twin")
    write_urdf(twin, folder / "twin")
    write_twin_yaml(twin, folder / "twin")
    write_usd(twin, folder / "usd")
    return {"MJCF": (folder / "mjcf", "m.xml"), "URDF": (folder / "ros", "urdf/m.urdf"),
            "twin": (folder / "twin", ""), "USD": (folder / "usd", "twin.usd")}
