"""The joints of a compiled model: which can be driven, what follows them, what they carry."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

OURS = "check_servo_"  # name of a servo that the check added
TURN = (-np.pi, np.pi)  # range driven when a hinge declares none


@dataclass(frozen=True)
class DrivenJoint:
    """One joint under test.

    Attributes:
        name.  index: joint id.  qpos, dof: addresses.  hinge: else slide.  low, high: range.
        servo: actuator id.  ours: added by the check.  moved: bodies it carries.
    """

    name: str
    index: int
    qpos: int
    dof: int
    hinge: bool
    low: float
    high: float
    servo: int
    ours: bool
    moved: frozenset[int]

    @property
    def span(self) -> float:
        """Width of the range."""
        return self.high - self.low

    @property
    def unit(self) -> str:
        """Unit of the joint position."""
        return "rad" if self.hinge else "units"


def is_simple(model: mujoco.MjModel, joint: int) -> bool:
    """Return whether a joint is a hinge or a slide."""
    import mujoco

    kinds = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return int(model.jnt_type[joint]) in kinds


def followers_of(model: mujoco.MjModel) -> tuple[tuple[int, int, F64], ...]:
    """Return (follower qpos, leader qpos, polynomial) of every joint coupling."""
    import mujoco

    out = []
    for e in range(model.neq):
        coupled = int(model.eq_type[e]) == int(mujoco.mjtEq.mjEQ_JOINT)
        if coupled and model.eq_active0[e] and model.eq_obj2id[e] >= 0:
            follower, leader = (
                int(model.jnt_qposadr[i]) for i in (model.eq_obj1id[e], model.eq_obj2id[e])
            )
            out.append((follower, leader, np.array(model.eq_data[e, :5])))
    return tuple(out)


def held_joints(
    model: mujoco.MjModel, joints: tuple[DrivenJoint, ...]
) -> tuple[DrivenJoint, ...]:
    """Return the joints that a weld or loop of the model holds: no servo moves one alone."""
    import mujoco

    kinds = (int(mujoco.mjtEq.mjEQ_WELD), int(mujoco.mjtEq.mjEQ_CONNECT))
    site = int(mujoco.mjtObj.mjOBJ_SITE)
    ends = []
    for e in range(model.neq):
        if int(model.eq_type[e]) in kinds and model.eq_active0[e]:
            pair = (int(model.eq_obj1id[e]), int(model.eq_obj2id[e]))
            sites = int(model.eq_objtype[e]) == site
            ends.append(tuple(int(model.site_bodyid[i]) for i in pair) if sites else pair)
    return tuple(j for j in joints if any((a in j.moved) != (b in j.moved) for a, b in ends))


def driven_joints(model: mujoco.MjModel) -> tuple[DrivenJoint, ...]:
    """Return every hinge and slide that does not merely follow another one."""
    import mujoco

    following = {f for f, _, _ in followers_of(model)}
    out = []
    for j in range(model.njnt):
        address = int(model.jnt_qposadr[j])
        if not is_simple(model, j) or address in following:
            continue
        low, high = model.jnt_range[j] if model.jnt_limited[j] else TURN
        hinge = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_HINGE)
        servo = servo_of(model, j)
        out.append(
            DrivenJoint(
                model.joint(j).name or f"joint {j}",
                j,
                address,
                int(model.jnt_dofadr[j]),
                hinge,
                float(low),
                float(high),
                servo,
                servo >= 0 and model.actuator(servo).name.startswith(OURS),
                _carried(model, int(model.jnt_bodyid[j])),
            )
        )
    return tuple(out)


def servo_of(model: mujoco.MjModel, joint: int) -> int:
    """Return the id of the position servo of a joint, -1 if it has none."""
    import mujoco

    kind, affine = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtBias.mjBIAS_AFFINE)
    for a in range(model.nu):
        on_joint = int(model.actuator_trntype[a]) == kind and model.actuator_trnid[a, 0] == joint
        servo = int(model.actuator_biastype[a]) == affine and model.actuator_biasprm[a, 1] < 0
        if on_joint and servo:
            return a
    return -1


def _carried(model: mujoco.MjModel, body: int) -> frozenset[int]:
    moved = {body}
    for b in range(body + 1, model.nbody):  # parents come before children
        if int(model.body_parentid[b]) in moved:
            moved.add(b)
    return frozenset(moved)
