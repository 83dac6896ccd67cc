"""Servos for joints that have none: the check's own motor, critically damped."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.driven import OURS, DrivenJoint, driven_joints

if TYPE_CHECKING:
    import mujoco

SERVO_FREQUENCY = 30.0  # rad/s of a servo added to a model that has none
STIFFEST = 0.4  # frequency x step of such a servo: stable with every integrator
SAG = 0.004  # of the range: droop under gravity and friction such a servo may have


def add_servos(spec: mujoco.MjSpec, model: mujoco.MjModel) -> list[str]:
    """Add a critically damped position servo to every driven joint without one.

    The check's motor also carries the weight of what it moves: how far it droops says nothing about
    a model that has no motor.
    """
    import mujoco

    added = []
    for joint in driven_joints(model):
        if joint.servo >= 0 or not model.joint(joint.index).name:
            continue
        mass = max(float(model.dof_M0[joint.dof]), 1e-12)
        damping = float(model.dof_damping[joint.dof])
        kp = max(mass * SERVO_FREQUENCY**2, _load(model, joint) / (SAG * max(joint.span, 1e-9)),
                 damping * SERVO_FREQUENCY)
        kp = min(kp, mass * (STIFFEST / model.opt.timestep) ** 2)
        servo = spec.add_actuator(
            name=OURS + joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        gain, bias = np.zeros(len(servo.gainprm)), np.zeros(len(servo.biasprm))
        gain[0], bias[1:3] = kp, (-kp, -max(2 * np.sqrt(kp * mass) - damping, 0.0))
        servo.gainprm, servo.biasprm = gain, bias
        added.append(joint.name)
        for body in joint.moved:
            spec.bodies[body].gravcomp = 1.0
    return added


def _load(model: mujoco.MjModel, joint: DrivenJoint) -> float:
    """Return the largest force of weight, springs and friction on a joint along its range."""
    import mujoco

    data, load = mujoco.MjData(model), 0.0
    for q in np.linspace(joint.low, joint.high, 9):
        data.qpos[joint.qpos] = q
        mujoco.mj_forward(model, data)
        force = data.qfrc_bias[joint.dof] - data.qfrc_passive[joint.dof]
        load = max(load, abs(float(force)))
    return load + float(model.dof_frictionloss[joint.dof])
