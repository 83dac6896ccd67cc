"""Two motions of a model: a smooth one, and one that meets stops and a ball."""

from __future__ import annotations

from copy import copy
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.servos import add_servos
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.sim_checks.subject import Subject, load_spec
from part2gs_robotics.stress.cells import Start

if TYPE_CHECKING:
    import mujoco

FROM, TO = 0.25, 0.75  # of the range: clear of the limits, and far enough to swing
NEAR, FAST = 0.9, 4.0  # of the range; ranges per s: a joint slammed against its stop in 25 ms
BALL = 0.02  # of the size, its radius: small beside any part, large beside a mesh
WEIGHT = 0.1  # of all that moves
FALLS, ABOVE = 0.05, 0.002  # of the size: how far it has fallen, and is above what it hits
ALL_BITS = 2**31 - 1  # it meets everything that collides
EARTH = 9.81  # units/s2 where a model has no gravity


def smooth(subject: Subject) -> Start:
    """Return all joints at a quarter of their range, their servos commanding three quarters.

    Without contacts, limits, dry friction and force limits: what is left is an ordinary
    differential equation with smooth solutions, whose orders of accuracy are known.
    """
    import mujoco

    model, bits = copy(subject.model), mujoco.mjtDisableBit
    model.opt.disableflags |= int(bits.mjDSBL_CONTACT) | int(bits.mjDSBL_LIMIT) | int(
        bits.mjDSBL_FRICTIONLOSS) | int(bits.mjDSBL_CLAMPCTRL)
    model.actuator_forcelimited[:] = 0
    model.jnt_actfrclimited[:] = 0
    joints = [j for j in subject.joints if j.span > 0]
    qpos = subject.at({j.qpos: j.low + FROM * j.span for j in joints})
    ctrl = np.zeros(model.nu)
    for j in joints:
        if j.servo >= 0:
            ctrl[j.servo] = j.low + TO * j.span
    return Start(model, qpos, np.zeros(model.nv), ctrl, tuple(j.qpos for j in joints),
                 np.array([j.span for j in joints]))


def contact(subject: Subject, path: Path) -> Start:
    """Return the heaviest joint slammed against its stop, while a ball falls onto the model.

    The others are where that joint needs them, their servos hold them there. A model nothing of
    which collides has no ball.

    Args:
        subject: with servos.
        path: the file that it was compiled from.
    """
    joints = [j for j in subject.joints if j.span > 0]
    slammed = max(joints, key=lambda j: float(subject.model.body_mass[list(j.moved)].sum()))
    qpos = subject.at({slammed.qpos: slammed.low + NEAR * slammed.span}, slammed)
    hit = _highest(subject, qpos)
    model = subject.model if hit is None else _with_ball(subject, path, hit)
    start = np.concatenate([qpos, np.array(model.qpos0)[len(qpos):]])
    qvel, ctrl = np.zeros(model.nv), np.zeros(model.nu)
    for j in joints:
        if j.servo >= 0:
            ctrl[j.servo] = qpos[j.qpos]
    if slammed.servo >= 0:
        ctrl[slammed.servo] = slammed.high
    qvel[slammed.dof] = FAST * slammed.span
    watched, scale = tuple(j.qpos for j in joints), [j.span for j in joints]
    if hit is not None:
        down = _down(model)
        qvel[-6:-3] = np.sqrt(2 * _gravity(model) * FALLS * subject.size) * down
        watched += tuple(range(model.nq - 7, model.nq - 4))
        scale += [subject.size] * 3
    return Start(model, start, qvel, ctrl, watched, np.array(scale))


def _gravity(model: mujoco.MjModel) -> float:
    return float(np.linalg.norm(model.opt.gravity)) or EARTH


def _down(model: mujoco.MjModel) -> F64:
    gravity = np.array(model.opt.gravity)
    return gravity / np.linalg.norm(gravity) if gravity.any() else np.array([0.0, 0.0, -1.0])


def _highest(subject: Subject, qpos: F64) -> F64 | None:
    """Return [3] where a ball from above meets what collides; None where nothing does."""
    import mujoco

    model = copy(subject.model)
    strikes = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    solid = strikes & (model.geom_bodyid > 0) & (model.geom_type != int(
        mujoco.mjtGeom.mjGEOM_PLANE))
    if not solid.any():
        return None
    model.geom_matid[:], model.geom_rgba[:, 3] = -1, solid  # rays see nothing else
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    down, best = _down(model), None
    for g in np.flatnonzero(solid):
        above = np.array(data.geom_xpos[g]) - 2 * subject.size * down
        far = np.array([-1], np.int32)
        distance = mujoco.mj_ray(model, data, above, down, None, 1, -1, far)
        if distance >= 0 and solid[far[0]] and (best is None or distance < best[0]):
            best = distance, above + distance * down
    return None if best is None else best[1]


def _with_ball(subject: Subject, path: Path, hit: F64) -> mujoco.MjModel:
    """Return the model with a ball above a point; it touches as the model's own geoms do."""
    import mujoco

    spec, _ = load_spec(path)
    if any(j.ours for j in subject.joints):  # the check's own servos are not in the file
        add_servos(spec, spec.compile())
    old, down = subject.model, _down(subject.model)
    g = int(np.flatnonzero((old.geom_contype != 0) | (old.geom_conaffinity != 0))[-1])
    radius = BALL * subject.size
    body = spec.worldbody.add_body(name="stress_ball", pos=hit - down * (
        radius + ABOVE * subject.size))
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], contype=ALL_BITS,
                  conaffinity=ALL_BITS, condim=int(old.geom_condim[g]),
                  mass=WEIGHT * max(float(old.body_subtreemass[0]), 1e-12),
                  solref=old.geom_solref[g], solimp=old.geom_solimp[g],
                  friction=old.geom_friction[g])
    for key in list(spec.keys):
        spec.delete(key)  # of another number of positions
    model = spec.compile()
    for name in dir(old.opt):
        if not name.startswith("_"):
            setattr(model.opt, name, getattr(old.opt, name))
    return model
