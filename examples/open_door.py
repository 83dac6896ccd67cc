"""A two-finger gripper of boxes opens a twin's door by its handle, in MuJoCo.

    python examples/open_door.py out/demo part_1 45    # degrees; scene units for a drawer

Friction alone holds the handle: the hand follows the joint's path, nothing ties it to the part.
"""

import sys
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from part2gs_robotics import api
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.twin import Part

# Metres, kg, seconds. The hand is welded to a target that is led; fingers slide along x.
FINGER = """<body name="{0}" pos="{1}.05 0 -.03" gravcomp="1">
  <joint name="{0}" type="slide" axis="{1}1 0 0" range="-.05 .01" damping="100"/>
  <geom type="box" size=".006 .012 .03" mass=".1" friction="1.5" condim="4"/></body>"""
ROBOT = f"""<mujoco>
<option timestep=".001" integrator="implicitfast" cone="elliptic" impratio="10"/>
<worldbody><body name="target" mocap="true"/>
<body name="hand" gravcomp="1"><freejoint name="hand"/>
  <geom type="box" size=".07 .02 .01" pos="0 0 -.07" mass=".5"/>
  {FINGER.format("left", "-")}{FINGER.format("right", "+")}</body></worldbody>
<equality><weld body1="target" body2="hand" solref=".004 1"/></equality>
<actuator><motor name="left" joint="left"/><motor name="right" joint="right"/></actuator>
</mujoco>"""
Way = Callable[[float], tuple[float, float]]  # share of a time -> how far open, and way back
GRIP = 40.0  # N, what small parallel grippers hold with
FREE = 0.12  # m between the hand's start and the handle
TALL = 0.01  # m: what stands out furthest, by so much, is the handle
DEEP = 0.018  # m behind its front: where the hand's middle goes, as deep as fingertips reach


def opening_way(part: Part, joint: Joint) -> np.ndarray:
    """Return [3] where the part opens to: along its slide, or where most of a door's area faces."""
    if not joint.turns:
        return joint.axis * np.sign(joint.value)
    corners = part.mesh.vertices[part.mesh.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    spread = areas.T @ (areas / np.linalg.norm(areas, axis=1, keepdims=True).clip(1e-12))
    way = np.linalg.eigh(spread)[1][:, -1]
    arm = part.mesh.vertices.mean(0) - joint.origin
    return way * np.sign(np.cross(joint.axis, arm) @ way * joint.value)


def grasp(part: Part, joint: Joint, metre: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the handle is [3], and the hand's axes there [3, 3]: x closes, z approaches."""
    out = opening_way(part, joint)
    height = part.mesh.vertices @ out
    handle = part.mesh.vertices[height > height.max() - TALL * metre]
    up = joint.axis if joint.turns else np.eye(3)[np.argmin(np.abs(out))]
    close = min(np.cross(up, out), up, key=lambda way: np.ptp(handle @ way))
    if np.ptp(handle @ close) > 0.08 * metre:
        raise SystemExit(f"{part.name}: nothing stands out of it that a hand of 8 cm can hold")
    centre = (handle.min(0) + handle.max(0)) / 2
    centre += out * (height.max() - DEEP * metre - centre @ out)
    return centre, np.stack([close, np.cross(-out, close), -out], 1)


def world(folder: Path, metre: float) -> mujoco.MjModel:
    """Return the model of robot and twin; the twin's names begin with `twin/`."""
    spec = mujoco.MjSpec.from_string(ROBOT)
    for body in spec.bodies[1:]:  # from metres to the twin's scene units
        body.pos = body.pos * metre
    for geom in spec.geoms:
        geom.pos, geom.size = geom.pos * metre, geom.size * metre
    for joint in spec.joints:
        joint.range = joint.range * metre
    twin = mujoco.MjSpec.from_file(str(folder / "twin.xml"))
    spec.attach(twin, prefix="twin/", frame=spec.worldbody.add_frame())
    spec.option.gravity = mujoco.MjModel.from_xml_path(str(folder / "scene.xml")).opt.gravity
    return spec.compile()


def main(folder: Path, name: str, asked: float) -> float:
    """Open a part by degrees (scene units, if it slides); return how far it came."""
    twin = api.read_twin(folder)
    moving = {part.name: (part, part.joint) for part in twin.parts if part.joint is not None}
    if name not in moving:
        raise SystemExit(f"{name}: moves nothing of {folder}; there are {', '.join(moving)}")
    (part, joint), metre = moving[name], 1 / twin.meters
    unit = np.radians(1) if joint.turns else 1.0
    centre, axes = grasp(part, joint, metre)
    model = world(folder, metre)
    data = mujoco.MjData(model)

    def during(seconds: float, force: float, way: Way) -> None:
        """Step while the hand goes its way and the fingers press by newtons."""
        for t in np.linspace(0, 1, round(seconds / model.opt.timestep)):
            opened, back = way(t)
            pose = joint.transform(opened * unit * np.sign(joint.value))
            data.mocap_pos[0] = pose[:3, :3] @ (centre - axes[:, 2] * back * metre) + pose[:3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[0], (pose[:3, :3] @ axes).ravel())
            if data.time == 0:
                data.joint("hand").qpos = *data.mocap_pos[0], *data.mocap_quat[0]
            data.ctrl[:2] = -force * metre
            mujoco.mj_step(model, data)

    during(0.5, -5.0, lambda t: (0.0, FREE * (1 - t)))  # to the handle, with open fingers
    during(0.5, GRIP, lambda t: (0.0, 0.0))
    during(2.0, GRIP, lambda t: (asked * t, 0.0))
    return abs(float(data.joint(f"twin/{name}_joint").qpos[0])) / unit


if __name__ == "__main__":
    reached = main(Path(sys.argv[1]), sys.argv[2], float(sys.argv[3]))
    print(f"{sys.argv[2]}: asked {sys.argv[3]}, reached {reached:.3g}")
