"""The subject of a check: a compiled model, its joints, its exact solids."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.clear_steps import Shapes, Stepper, same_rules, shapes_of
from part2gs_robotics.assets.driven import (
    DrivenJoint,
    driven_joints,
    followers_of,
    held_joints,
    is_simple,
)
from part2gs_robotics.assets.pairs import keep_apart, meeting_pairs
from part2gs_robotics.assets.servos import add_servos
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.sim_checks.geometry import body_meshes, body_solid, lighter, pieces_solid

if TYPE_CHECKING:
    import mujoco
    from manifold3d import Manifold

SWEEP_TOLERANCE = 2e-4  # of the size: simplification of dense bodies, a tenth of the overlap limit


@dataclass(frozen=True)
class Subject:
    """A model ready to be checked: base fixed, automatic reset off, of ours parent filter too.

    Attributes:
        model: compiled.  joints: under test.  followers: (follower qpos, leader qpos, polynomial).
        meshes: true surfaces per body.  solids: their unions, None if open.  size: diagonal, units.
        states: qpos by keyframe name.  notes: what was changed or left out.
        around: by index of a joint that waits for others, qpos that these have while it is driven.
        ours: written by this program. Of others what collides counts, not what is seen.
        pairs: bodies that the engine lets meet, None = all.
        shapes: for steps that look for contacts only where there may be one, None = all do.
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
    ours: bool = True
    pairs: frozenset[tuple[int, int]] | None = None
    shapes: Shapes | None = None

    def body(self, index: int) -> str:
        """Return the name of a body."""
        return self.model.body(index).name or f"body {index}"

    def stepper(self, data: mujoco.MjData) -> Stepper:
        """Return what steps a simulation of the model."""
        return Stepper(self.shapes, self.model, data)

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
    """Return the model with every free joint removed, and notes about it.

    Raises:
        ValueError: MuJoCo's own message.
    """
    import mujoco

    spec = mujoco.MjSpec.from_file(str(path))
    for number, joint in enumerate(spec.joints):
        joint.name = joint.name or f"joint {number}"  # what has no name gets no servo
    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    if free:
        keep_apart(spec, [j.parent for j in free])
    for joint in free:
        spec.delete(joint)
    for key in list(spec.keys) if free else []:
        spec.delete(key)  # their qpos no longer fits
    _give_room(spec)
    return spec, (f"{len(free)} free joint(s) fixed to the world",) if free else ()


def _give_room(spec: mujoco.MjSpec) -> None:
    """Let the engine choose its memory, if what the file gives it is enough to begin.

    Raises:
        ValueError: it is not.
    """
    import mujoco

    if spec.memory < 0:
        return
    model = spec.compile()
    try:
        mujoco.mj_forward(model, mujoco.MjData(model))
    except mujoco.FatalError as error:
        raise ValueError(f"{str(error).splitlines()[0]}: remove memory of <size>") from None
    spec.memory = -1  # what runs out of it half-way ends the whole check


def compile_spec(path: Path) -> mujoco.MjModel:
    """Return a model as its file says, but for free joints.

    Raises:
        ValueError: MuJoCo's own message, or a number that no model can have.
    """
    model = load_spec(path)[0].compile()
    require_finite(model)
    return model


def make_subject(
    path: Path, options: mujoco.MjOption | None = None, *, servos: bool = True, ours: bool = True
) -> Subject:
    """Compile a confined model file and collect everything the checks look at.

    Args:
        path: MJCF or URDF file.
        options: those of the world it is meant for; None = its own.
        servos: add one to every joint that has none.
        ours: written by this program; of others contact filters and what is only seen are theirs.

    Raises:
        ValueError: MuJoCo's own message, if it does not compile.
    """
    spec, notes = load_spec(path)
    model = _prepared(spec, options, ours)
    added = add_servos(spec, model) if servos else []
    if added:
        model = _prepared(spec, options, ours)
        notes += (f"servos added to joints without one: {', '.join(added)}",)
    if model.nexclude:
        notes += (f"{model.nexclude} body pair(s) excluded from contact by the model",)
    skipped = [model.joint(j).name for j in range(model.njnt) if not is_simple(model, j)]
    if skipped:
        notes += (f"ball joints are not driven: {', '.join(skipped)}",)
    subject = _geometry(model, notes, ours)
    return subject if ours else _without_held(subject)


def _without_held(subject: Subject) -> Subject:
    """Return a subject of others without the joints that its own welds hold."""
    held = held_joints(subject.model, subject.joints)
    if not held:
        return subject
    note = f"held by a weld or loop of the model, not driven: {', '.join(j.name for j in held)}"
    return replace(subject, joints=tuple(j for j in subject.joints if j not in held),
                   notes=(*subject.notes, note))


def actuated_twin(passive: Subject, path: Path, options: mujoco.MjOption | None) -> Subject:
    """Return the same bodies with the servos of another file; solids are not made again.

    Raises:
        ValueError: MuJoCo's own message, if it does not compile.
    """
    model = _prepared(load_spec(path)[0], options)
    if difference(passive.model, model):
        return make_subject(path, options, servos=False)
    shapes = passive.shapes if same_rules(passive.model, model) else shapes_of(model)
    return replace(passive, model=model, joints=driven_joints(model), states=_states(model),
                   shapes=shapes)


UNREAL = "a number is out of this world:"
FARTHEST = 1e18  # scene units, kg, N: float32, which every engine takes, still squares it
REAL = ("body_pos", "body_mass", "body_inertia", "body_ipos", "jnt_pos", "jnt_axis", "jnt_range",
        "dof_damping", "dof_frictionloss", "geom_pos", "geom_size", "mesh_vert", "key_qpos",
        "actuator_gainprm", "actuator_ctrlrange")  # fmt: skip

SAME = (  # what must agree: kinematics, masses, passive forces, shapes, observed states
    "body_parentid", "body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat",
    "body_inertia", "jnt_type", "jnt_bodyid", "jnt_pos", "jnt_axis", "jnt_range", "dof_damping",
    "dof_frictionloss", "dof_armature", "geom_type", "geom_bodyid", "geom_pos", "geom_quat",
    "geom_size", "geom_contype", "mesh_vert", "mesh_face", "eq_data", "key_qpos",
)  # fmt: skip


def difference(one: mujoco.MjModel, two: mujoco.MjModel) -> str:
    """Return the first of SAME in which two models differ, "" if they are one but for servos."""
    for name in SAME:
        if not np.array_equal(getattr(one, name), getattr(two, name)):
            return name
    names = [[m.joint(j).name for j in range(m.njnt)] for m in (one, two)]
    return "" if names[0] == names[1] else "names of joints"


def require_finite(model: mujoco.MjModel) -> None:
    """Stop at a number that no twin can have, which the engine compiles without a word.

    Raises:
        ValueError: naming it.
    """
    for name in REAL:
        found = np.asarray(getattr(model, name))
        if not (np.abs(found) < FARTHEST).all():  # NaN too
            worst = found.ravel()[~(np.abs(found.ravel()) < FARTHEST)][0]
            raise ValueError(f"{UNREAL} {name} holds {worst:g}")
    if not 1 / FARTHEST < model.opt.timestep < FARTHEST or not np.isfinite(model.opt.gravity).all():
        raise ValueError(f"{UNREAL} option has timestep {model.opt.timestep:g} and gravity "
                         f"{model.opt.gravity.tolist()}")


def _prepared(
    spec: mujoco.MjSpec, options: mujoco.MjOption | None, ours: bool = True
) -> mujoco.MjModel:
    """Compile with options of a world, automatic reset off, and the parent filter of our own."""
    import mujoco

    model = spec.compile()
    require_finite(model)
    if options is not None:
        for name in dir(options):
            if not name.startswith("_"):
                setattr(model.opt, name, getattr(options, name))
    if ours:
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    return model


def _states(model: mujoco.MjModel) -> dict[str, F64]:
    return {model.key(k).name: np.array(model.key_qpos[k]) for k in range(model.nkey)}


def _geometry(model: mujoco.MjModel, notes: tuple[str, ...], ours: bool) -> Subject:
    meshes = {b: body_meshes(model, b) for b in range(model.nbody)}
    meshes = {b: m for b, m in meshes.items() if m}
    if ours:
        solids = {b: body_solid(m) for b, m in meshes.items()}
    else:
        solids = {b: pieces_solid(model, b) for b in range(model.nbody)}
        notes += ("not a twin of ours: what collides stands in for what is seen",)
    subject = Subject(
        model,
        driven_joints(model),
        followers_of(model),
        meshes,
        solids,
        float("nan"),
        _states(model),
        notes,
        ours=ours,
        pairs=None if ours else meeting_pairs(model),
        shapes=shapes_of(model),
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
