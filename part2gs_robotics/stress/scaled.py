"""One model at a thousandth and at a thousand times its size: similar models move alike."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.stress.cells import Cell, Start, judged, run
from part2gs_robotics.stress.extremes import MEETS, own_count
from part2gs_robotics.stress.precision import SECONDS

if TYPE_CHECKING:
    import mujoco

SCALES = tuple(10.0**k for k in range(-3, 4))  # a matchbox house to a hangar
LINEAR = {0: 3, 2: 1}  # lengths among the numbers of a free joint and of a slide
# Powers of the scale at which a number grows while density and time stay as they are.
LENGTHS = ("body_pos", "body_ipos", "geom_pos", "geom_size", "geom_rbound", "geom_margin",
           "geom_gap", "geom_aabb", "site_pos", "site_size", "cam_pos", "light_pos", "mesh_vert",
           "bvh_aabb", "jnt_pos", "jnt_margin")  # fmt: skip


def scales(start: Start) -> list[Cell]:
    """Return a cell per scale: the scaled run, scaled back, against the run at scale 1.

    Lengths grow by s, masses by s^3, gravity and speeds by s, forces by s^4, torques by s^5: then
    every joint moves as before. What differs comes from absolute numbers in the engine.
    """
    count = own_count(start.model.opt.timestep)
    right = run(start, SECONDS, count).path
    return [judged(run(scaled(start, s), SECONDS, count), right, {"scale": s}, MEETS)
            for s in SCALES]


def scaled(start: Start, scale: float) -> Start:
    """Return the same start of a model whose lengths are `scale` times as large."""
    import mujoco

    model = copy(start.model)
    for name in LENGTHS:
        getattr(model, name)[:] *= scale
    model.geom_solimp[:, 2] *= scale
    model.body_mass[:] *= scale**3
    model.body_inertia[:] *= scale**5
    model.opt.gravity[:] *= scale
    model.stat.extent *= scale
    model.stat.center *= scale
    places = _lengths(model, model.jnt_qposadr, model.nq)
    speeds = _lengths(model, model.jnt_dofadr, model.nv)
    grow, spin = scale ** places, scale ** speeds
    _joints(model, scale, speeds)
    for name in ("qpos0", "qpos_spring"):
        getattr(model, name)[:] *= grow
    model.key_qpos[:] *= grow
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    watched = list(start.watched)
    return replace(start, model=model, qpos=start.qpos * grow, qvel=start.qvel * spin,
                   ctrl=start.ctrl * scale ** _of_actuators(model, speeds),
                   scale=start.scale * grow[watched])


def _lengths(model: mujoco.MjModel, first: NDArray[np.int32], count: int) -> F64:
    """Return [count] 1 where a position, or speed, is one of lengths, 0 where it is an angle.

    Args:
        model: of joints.
        first: [njnt] where the numbers of every joint begin, `jnt_qposadr` or `jnt_dofadr`.
        count: of the numbers.
    """
    out = np.zeros(count)
    for kind, at in zip(model.jnt_type, first, strict=True):
        out[at:at + LINEAR.get(int(kind), 0)] = 1.0
    return out


def _of_actuators(model: mujoco.MjModel, speeds: F64) -> F64:
    """Return [nu] 1 where an actuator of a joint commands a length."""
    out = np.zeros(model.nu)
    for a in range(model.nu):
        if int(model.actuator_trntype[a]) in (0, 1):  # a joint, in its own frame or its parent's
            out[a] = speeds[model.jnt_dofadr[int(model.actuator_trnid[a, 0])]]
    return out


def _joints(model: mujoco.MjModel, scale: float, speeds: F64) -> None:
    """Grow what joints, couplings and actuators say."""
    stiff = 5.0 - 2.0 * speeds  # N m per rad, or N per unit
    model.dof_armature[:] *= scale ** stiff
    for name in ("dof_damping", "dof_dampingpoly"):
        numbers = getattr(model, name, None)
        if numbers is not None:
            numbers[:] = (numbers.reshape(model.nv, -1) * (scale ** stiff)[:, None]).reshape(
                numbers.shape)
    model.dof_frictionloss[:] *= scale ** (5.0 - speeds)
    slides = model.jnt_type == 2
    model.jnt_range[slides] *= scale
    model.jnt_stiffness[:] *= (scale ** stiff)[model.jnt_dofadr].reshape(
        (-1,) + (1,) * (model.jnt_stiffness.ndim - 1))
    for e in range(model.neq):
        _coupling(model, e, scale)
    lengths = _of_actuators(model, speeds)
    model.actuator_gainprm[:, 0] *= scale ** (5.0 - 2.0 * lengths)
    model.actuator_biasprm[:, 1:3] *= (scale ** (5.0 - 2.0 * lengths))[:, None]
    model.actuator_forcerange[:] *= (scale ** (5.0 - lengths))[:, None]
    model.actuator_ctrlrange[:] *= (scale ** lengths)[:, None]


def _coupling(model: mujoco.MjModel, e: int, scale: float) -> None:
    """Grow the polynomial of a joint that follows another one."""
    import mujoco

    if int(model.eq_type[e]) == int(mujoco.mjtEq.mjEQ_JOINT):
        pair = [int(model.jnt_type[i]) == 2 for i in (model.eq_obj1id[e], model.eq_obj2id[e])]
        powers = float(pair[0]) - float(pair[1]) * np.arange(5)
        model.eq_data[e, :5] *= scale ** powers
