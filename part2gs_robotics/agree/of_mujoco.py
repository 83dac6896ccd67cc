"""A compiled MJCF in the words of `described.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.agree.described import NO, Body, Described, Drive, rotated
from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)  # corners


def of_mujoco(file: str, model: mujoco.MjModel) -> Described:
    """Return what a model says; every body below the world is a part.

    Args:
        file: its name.
        model: compiled, world frame = that of the scene.
    """
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    bodies = {b.name: b for b in (_body(model, data, i) for i in range(1, model.nbody))}
    title = bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace")
    return Described(file, bodies, title="" if file == "scene.xml" else title)


def _body(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> Body:
    parent = int(model.body_parentid[index])
    turn = data.ximat[index].reshape(3, 3)
    mine = np.flatnonzero(model.geom_bodyid == index)
    meets = (model.geom_contype[mine] != 0) | (model.geom_conaffinity[mine] != 0)
    seen = [corners(model, data, int(g)) for g in mine[~meets]]
    name = model.body(index).name
    return Body(
        name, model.body(parent).name if parent else "", float(model.body_mass[index]),
        np.array(data.xipos[index]), rotated(np.diag(model.body_inertia[index]), turn),
        np.concatenate(seen) if seen else np.zeros((0, 3)),
        tuple(corners(model, data, int(g)) for g in mine[meets]), _drive(model, data, index))


def corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> F64:
    """Return [N, 3] corners of a mesh or box, or of the box around any other shape, in the world.

    Args:
        model: compiled.
        data: with kinematics.
        geom: index.
    """
    import mujoco

    mesh = int(model.geom_dataid[geom])
    if int(model.geom_type[geom]) == int(mujoco.mjtGeom.mjGEOM_MESH) and mesh >= 0:
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        local = np.array(model.mesh_vert[start:start + count], np.float64)
    else:
        size = model.geom_size[geom]
        round_ = int(model.geom_type[geom]) != int(mujoco.mjtGeom.mjGEOM_BOX)
        # what no exporter writes is like no other
        local = np.full((1, 3), NO) if round_ else SIGNS * size
    return np.asarray(local @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])


def _drive(model: mujoco.MjModel, data: mujoco.MjData, index: int) -> Drive | None:
    import mujoco

    first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
    if not count:
        return None if not int(model.body_parentid[index]) else Drive(
            "fixed", np.array([0.0, 0.0, 1.0]), np.array(data.xpos[index]))
    names = {int(mujoco.mjtJoint.mjJNT_HINGE): "revolute",
             int(mujoco.mjtJoint.mjJNT_SLIDE): "prismatic"}
    kinds = [names.get(int(model.jnt_type[j]), "free") for j in range(first, first + count)]
    pitch, kind = 0.0, kinds[0]
    if kinds == ["revolute", "prismatic"]:
        kind, pitch = "screw", _pitch(model, first)
    elif count > 1:
        kind = " and ".join(kinds)
    limits = tuple(map(float, model.jnt_range[first])) if model.jnt_limited[first] else (
        -np.inf, np.inf)
    return Drive(kind, np.array(data.xaxis[first]), np.array(data.xanchor[first]), pitch,
                 (limits[0], limits[1]), _numbers(model, first), _states(model, first),
                 model.joint(first).name)


def _pitch(model: mujoco.MjModel, joint: int) -> float:
    """Return the units per radian of a screw whose slide is the joint after its turn."""
    import mujoco

    for e in range(model.neq):
        pair = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
        coupled = int(model.eq_type[e]) == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_active0[e]
        if coupled and pair == (joint + 1, joint):
            bent = np.delete(np.array(model.eq_data[e, :5]), 1).any()
            return NO if bent else float(model.eq_data[e, 1])
    return 0.0


def _numbers(model: mujoco.MjModel, joint: int) -> dict[str, float]:
    dof = int(model.jnt_dofadr[joint])
    out = {"damping": float(model.dof_damping[dof]), "friction": float(model.dof_frictionloss[dof]),
           "armature": float(model.dof_armature[dof]), "stiffness": float(
               model.jnt_stiffness[joint])}
    mine = actuators(model, joint)
    servos = [a for a in mine if model.actuator_biasprm[a, 1] < 0]
    out |= {"servos": float(len(servos)), "motors": float(len(mine) - len(servos))}
    if len(servos) != 1:
        return out
    a = servos[0]
    force = model.actuator_forcerange[a] if model.actuator_forcelimited[a] else (
        -np.inf, np.inf)
    command = model.actuator_ctrlrange[a] if model.actuator_ctrllimited[a] else (-np.inf, np.inf)
    return out | {
        "kp": float(model.actuator_gainprm[a, 0]), "effort": float(force[1]),
        "effort back": -float(force[0]), "command low": float(command[0]),
        "command high": float(command[1]), "gear": float(model.actuator_gear[a, 0]),
        "kp back": -float(model.actuator_biasprm[a, 1]),
        "kv": -float(model.actuator_biasprm[a, 2]), "bias": float(model.actuator_biasprm[a, 0])}


def actuators(model: mujoco.MjModel, joint: int) -> list[int]:
    """Return the actuators that act on a joint itself."""
    import mujoco

    kind = int(mujoco.mjtTrn.mjTRN_JOINT)
    return [a for a in range(model.nu) if int(model.actuator_trntype[a]) == kind
            and int(model.actuator_trnid[a, 0]) == joint]


def _states(model: mujoco.MjModel, joint: int) -> dict[str, float]:
    """Return the joint's position by keyframe, and its servo's command as `command NAME`."""
    out, at = {}, int(model.jnt_qposadr[joint])
    servo = actuators(model, joint)
    for k in range(model.nkey):
        name = model.key(k).name
        out[name] = float(model.key_qpos[k, at])
        if len(servo) == 1:
            out[f"command {name}"] = float(model.key_ctrl[k, servo[0]])
    return out
