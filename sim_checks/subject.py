"""The subject of a check: a compiled model, its joints, its exact solids."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.sim_checks.geometry import body_meshes, body_solid, lighter

if TYPE_CHECKING:
    import mujoco
    from manifold3d import Manifold

SWEEP_TOLERANCE = 2e-4  # of the size: simplification of dense bodies, a tenth of the overlap limit
SERVO_FREQUENCY = 30.0  # rad/s of a servo added to a model that has none
OURS = "check_servo_"  # name of such a servo
STIFFEST = 0.4  # frequency x step of such a servo: stable with every integrator
SAG = 0.004  # of the range: droop under gravity such a servo may have
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


@dataclass(frozen=True)
class Subject:
    """A model ready to be checked: base fixed, parent filter and automatic reset off.

    Attributes:
        model: compiled.  joints: under test.  followers: (follower qpos, leader qpos, polynomial).
        meshes: true surfaces per body.  solids: their unions, None if open.  size: diagonal, units.
        states: qpos by keyframe name.  notes: what was changed or left out.
        around: by index of a joint that waits for others, qpos that these have while it is driven.
    """

    model: mujoco.MjModel
    joints: tuple[DrivenJoint, ...]
    followers: tuple[tuple[int, int, F64], ...]
    meshes: dict[int, list[PartMesh]]
    solids: dict[int, Manifold | None]
    size: float
    states: dict[str, F64]
    notes: tuple[str, ...]
    around: dict[int, F64] = field(default_factory=dict)

    def body(self, index: int) -> str:
        """Return the name of a body."""
        return self.model.body(index).name or f"body {index}"

    def at(self, positions: dict[int, float], driven: DrivenJoint | None = None) -> F64:
        """Return qpos with joints (by qpos address) set and their followers in place.

        The others are where the driven joint needs them, at the reference without one.
        """
        rest = self.around.get(driven.index) if driven else None
        qpos = np.array(self.model.qpos0 if rest is None else rest)
        for address, value in positions.items():
            qpos[address] = value
        for follower, leader, poly in self.followers:
            lead = qpos[leader] - self.model.qpos0[leader]
            qpos[follower] = self.model.qpos0[follower] + np.polyval(poly[::-1], lead)
        return qpos


def load_spec(path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Return the model with every free joint removed, and notes about it."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    for joint in free:
        spec.delete(joint)
    for key in list(spec.keys) if free else []:
        spec.delete(key)  # their qpos no longer fits
    return spec, (f"{len(free)} free joint(s) fixed to the world",) if free else ()


def make_subject(path: Path) -> Subject:
    """Compile a confined model file and collect everything the checks look at.

    Raises:
        ValueError: MuJoCo's own message, if it does not compile.
    """
    import mujoco

    spec, notes = load_spec(path)
    first = spec.compile()
    added = _add_servos(spec, first)
    model = spec.compile() if added else first
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    if added:
        notes += (f"servos added to joints without one: {', '.join(added)}",)
    if model.nexclude:
        notes += (f"{model.nexclude} body pair(s) excluded from contact by the model",)
    skipped = [model.joint(j).name for j in range(model.njnt) if not _simple(model, j)]
    if skipped:
        notes += (f"ball joints are not driven: {', '.join(skipped)}",)
    return _geometry(model, notes)


def _geometry(model: mujoco.MjModel, notes: tuple[str, ...]) -> Subject:
    meshes = {b: body_meshes(model, b) for b in range(model.nbody)}
    meshes = {b: m for b, m in meshes.items() if m}
    solids = {b: body_solid(m) for b, m in meshes.items()}
    subject = Subject(
        model,
        driven_joints(model),
        followers_of(model),
        meshes,
        solids,
        float("nan"),
        {model.key(k).name: np.array(model.key_qpos[k]) for k in range(model.nkey)},
        notes,
    )
    size = _size(subject)
    lightened = []
    for body, solid in solids.items():
        if solid is not None:
            solids[body], changed = lighter(solid, SWEEP_TOLERANCE * size)
            lightened += [subject.body(body)] if changed else []
    if lightened:
        notes += (
            f"overlap of {', '.join(lightened)} measured on copies simplified "
            f"within {SWEEP_TOLERANCE * size:.2g} units",
        )
    return replace(subject, size=size, notes=notes)


def _size(subject: Subject) -> float:
    """Return the diagonal of everything at the reference position."""
    import mujoco

    data = mujoco.MjData(subject.model)
    mujoco.mj_kinematics(subject.model, data)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for body, meshes in subject.meshes.items():
        placed = np.concatenate([m.vertices for m in meshes]) @ data.xmat[body].reshape(3, 3).T
        low = np.minimum(low, placed.min(0) + data.xpos[body])
        high = np.maximum(high, placed.max(0) + data.xpos[body])
    return float(np.linalg.norm(high - low)) if subject.meshes else float("nan")


def _simple(model: mujoco.MjModel, joint: int) -> bool:
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


def driven_joints(model: mujoco.MjModel) -> tuple[DrivenJoint, ...]:
    """Return every hinge and slide that does not merely follow another one."""
    import mujoco

    following = {f for f, _, _ in followers_of(model)}
    out = []
    for j in range(model.njnt):
        address = int(model.jnt_qposadr[j])
        if not _simple(model, j) or address in following:
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


def _add_servos(spec: mujoco.MjSpec, model: mujoco.MjModel) -> list[str]:
    """Add a critically damped position servo to every driven joint without one."""
    import mujoco

    added = []
    for joint in driven_joints(model):
        if joint.servo >= 0 or not model.joint(joint.index).name:
            continue
        mass = max(float(_joint_mass(model)[joint.dof]), 1e-12)
        kp = max(mass * SERVO_FREQUENCY**2, _load(model, joint) / (SAG * max(joint.span, 1e-9)))
        kp = min(kp, mass * (STIFFEST / model.opt.timestep) ** 2)
        servo = spec.add_actuator(
            name=OURS + joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.gaintype, servo.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
        gain, bias = np.zeros(len(servo.gainprm)), np.zeros(len(servo.biasprm))
        gain[0], bias[1:3] = kp, (-kp, -2 * np.sqrt(kp * mass))
        servo.gainprm, servo.biasprm = gain, bias
        added.append(joint.name)
    return added


def _joint_mass(model: mujoco.MjModel) -> F64:
    return np.array(model.dof_M0) + 0.0


def _load(model: mujoco.MjModel, joint: DrivenJoint) -> float:
    """Return the largest force gravity puts on a joint along its range."""
    import mujoco

    data, load = mujoco.MjData(model), 0.0
    for q in np.linspace(joint.low, joint.high, 9):
        data.qpos[joint.qpos] = q
        mujoco.mj_forward(model, data)
        load = max(load, abs(float(data.qfrc_bias[joint.dof])))
    return load
