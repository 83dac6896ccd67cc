"""What one compiled model must be whatever the others say: contacts, servos, the world."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.agree.of_mujoco import actuators
from part2gs_robotics.exporters.inertia import gravity_vector
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.model.twin import COLLIDES_GROUP, SEEN_GROUP, Twin

if TYPE_CHECKING:
    import mujoco

SAME = 1e-6  # relative; files have ten digits
STABLE = 4.83  # servo frequency x step: up to it an implicit, critically damped servo settles
WIDE = 0.002  # of the size: a margin beyond what `overlap` allows pushes parts that do not touch
RUBS = 3  # directions of a contact's force: the fewest with friction
GRIPS = 0.05, 10.0  # of sliding friction: ice on steel is 0.03, soft rubber 4; ours is 1
FIRM = 0.5  # of solimp: less of a constraint and parts pass through; the engine's own is 0.9
SOFT = 0.1  # s in which a contact gives back; the engine's own is 0.02, ours 0.008
# The least an engine may try: half of MuJoCo's own iterations, its laxest own tolerance.
TRIES, LAX = 50, 1e-6
NEAREST = 1e-4  # of the size, to which contacts are found at least; the engine's own is 1e-6 units
STIFF = 1e3  # of impratio: ours is 10; beyond a thousand the solver's matrices lose digits
FAR = 30.0  # x the size that the world may be for a viewer: an object in a large room
REACH = 9  # positions of every joint at which excluded parts are looked at


def contact_rules(file: str, model: mujoco.MjModel, size: float) -> list[CheckResult]:
    """Return what keeps parts of a model from meeting each other or a hand, or makes them spring.

    Args:
        file: its name.
        model: compiled.
        size: of the object, scene units.
    """
    bits = model.geom_contype & model.geom_conaffinity & 1
    meets = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
    out = []
    for g in np.flatnonzero(meets):
        part = model.body(int(model.geom_bodyid[g])).name or "world"
        name = model.geom(int(g)).name or f"geom {g}"
        text, goal = "", ""
        if not bits[g]:
            text, goal = "meets nothing by its contype and conaffinity", "contype and conaffinity 1"
        elif model.geom_solref[g, 0] <= 0:
            text = f"has solref {model.geom_solref[g].tolist()}, past the engine's stability clamp"
            goal = "a positive solref, two time steps or more"
        elif not model.geom_solref[g, 0] <= SOFT:
            text = f"has solref {model.geom_solref[g].tolist()}, so soft that it lets through"
            goal = "solref 0.008 1"
        elif model.geom_bodyid[g] and model.geom_group[g] != COLLIDES_GROUP:
            text, goal = f"collides in group {model.geom_group[g]}", f"group {COLLIDES_GROUP}"
        elif not FIRM <= model.geom_solimp[g, 0] <= model.geom_solimp[g, 1] < 1:
            text, goal = f"has solimp {model.geom_solimp[g].tolist()}", "solimp 0.9 0.95 0.001"
        elif not abs(model.geom_margin[g]) + abs(model.geom_gap[g]) <= WIDE * size:
            text, goal = f"has margin {model.geom_margin[g]:g} units", "margin and gap 0"
        elif not (GRIPS[0] <= model.geom_friction[g, 0] <= GRIPS[1]
                  and model.geom_condim[g] >= RUBS):
            text = f"has friction {model.geom_friction[g, 0]:g}, condim {model.geom_condim[g]}"
            goal = f"friction 1 0.005 0.0001 and condim {RUBS} or more"
        if text:
            out.append(fails("contact rules", f"{file}: {part}", f"{name} {text}",
                             f"{file}: give {name} {goal}"))
    return [*out[:1], *_pairs(file, model, size)] or [
        passes("contact rules", file, "pieces meet what they touch")]


def _pairs(file: str, model: mujoco.MjModel, size: float) -> list[CheckResult]:
    out = []
    if model.npair:
        out.append(fails("contact rules", file, f"{model.npair} pairs of geoms with contact rules "
                         "of their own", f"{file}: remove <pair>; what its geoms say must do"))
    for pair in model.exclude_signature:
        one, two = int(pair) >> 16, int(pair) & 0xFFFF
        names = f"{model.body(one).name} and {model.body(two).name}"
        near, at = _nearest(model, (one, two))
        meets = near <= WIDE * size
        out.append(CheckResult(
            "contact exclude", f"{file}: {names}", "fail" if meets else "warn", near, WIDE * size,
            "units", f"excluded from contact; nearest {near:.4g} units at qpos {at}",
            f"{file}: remove <exclude> of {names}, and part their pieces where they overlap"))
    return out


def _nearest(model: mujoco.MjModel, pair: tuple[int, int]) -> tuple[float, list[float]]:
    """Return how near the pieces of two bodies come while each joint moves alone, and where."""
    import mujoco

    data, best, at, span = mujoco.MjData(model), np.inf, list[float](), np.zeros(6)
    pieces = [[g for g in range(model.ngeom) if model.geom_bodyid[g] == b
               and (model.geom_contype[g] or model.geom_conaffinity[g])] for b in pair]
    for j in range(model.njnt):
        for q in np.linspace(float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]), REACH):
            data.qpos[:] = 0
            data.qpos[model.jnt_qposadr[j]] = q
            mujoco.mj_kinematics(model, data)
            gap = min((mujoco.mj_geomDistance(model, data, a, b, 1e3, span)
                       for a in pieces[0] for b in pieces[1]), default=np.inf)
            if gap < best:
                best, at = float(gap), data.qpos.round(4).tolist()
    return best, at


def servo_rules(file: str, model: mujoco.MjModel, wanted: int, step: float) -> list[CheckResult]:
    """Return joints without the servo they must have, or with one too stiff for the time step.

    Args:
        file: its name.
        model: compiled.
        wanted: servos per joint: 1, in the passive twin 0.
        step: s, of scene.xml.
    """
    out, driven = [], 0
    followers = {int(model.eq_obj1id[e]) for e in range(model.neq)}
    for j in range(model.njnt):
        mine, name = actuators(model, j), model.joint(j).name
        goal = 0 if j in followers else wanted
        if len(mine) != goal:
            out.append(fails("servos", f"{file}: {name}", f"{len(mine)} actuators; needed {goal}",
                             f"{file}: " + (f"add a position servo to {name}" if goal
                                            else f"remove the actuators of {name}")))
            continue
        if text := _unlike_servo(model, j, mine):
            out.append(fails("servos", f"{file}: {name}", text,
                             f"{file}: give {name} one plain <position> servo, as twin.yaml says"))
        driven += len(mine)
        kp = max([0.0, *(float(model.actuator_gainprm[a, 0]) for a in mine)])
        felt = float(model.dof_M0[model.jnt_dofadr[j]])
        rate = float(np.sqrt(kp / max(felt, 1e-300))) * step
        if not rate <= STABLE:
            out.append(CheckResult(
                "servos", f"{file}: {name}", "fail", rate, STABLE, "rad per step",
                f"kp {kp:.4g} on an inertia of {felt:.4g} at {step:g} s a step",
                f"{file}: lower kp of {name}'s servo to what twin.yaml says, or the time step of "
                "scene.xml"))
    if driven != model.nu and not out:
        out.append(fails("servos", file, f"{model.nu - driven} actuators act on no joint",
                         f"{file}: remove them"))
    return out[:4] or [passes("servos", file, f"{wanted} per joint")]


def _unlike_servo(model: mujoco.MjModel, joint: int, actuators: list[int]) -> str:
    """Return why an actuator is no position servo, or why its force does not arrive."""
    for a in actuators:
        if model.actuator(a).name != f"{model.joint(joint).name.removesuffix('_joint')}_servo":
            return f"its actuator is called {model.actuator(a).name!r}"
        if not (model.actuator_biasprm[a, 1] < 0 < model.actuator_gainprm[a, 0]):
            return "its actuator is no position servo"
        if int(model.actuator_dyntype[a]):
            return "its actuator answers late (dyntype)"
    limited = actuators and model.jnt_actfrclimited[joint]
    return f"actuatorfrcrange holds {model.jnt_actfrcrange[joint]} back" if limited else ""


def extras(file: str, model: mujoco.MjModel) -> list[CheckResult]:
    """Return what holds or lifts parts besides joints: welds, tendons, springs, no gravity."""
    import mujoco

    screws = sum(int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
                 and j > 0 and model.jnt_bodyid[j] == model.jnt_bodyid[j - 1]
                 for j in range(model.njnt))
    found = {"constraints besides those of screws": model.neq - screws, "tendons": model.ntendon,
             "bodies without their weight (gravcomp)": int((model.body_gravcomp != 0).sum()),
             "joints with springs": int((model.jnt_stiffness != 0).sum()),
             "numbers of damping or springs that grow with speed or way": _bent(model),
             "joints whose limits give way (solreflimit, solimplimit, margin)": int(_soft(model)),
             "keyframes beyond the joints' limits": int(_beyond(model)),
             "keyframes in motion (qvel)": int((model.key_qvel != 0).any(1).sum()),
             "free or ball joints": int((model.jnt_type < 2).sum()),
             "bodies that are carried about (mocap)": int(model.nmocap),
             "couplings that give way (solref, solimp)": int(_loose(model)),
             "things that are seen in a group that viewers hide": int(_hidden(model))}
    out = [fails("own settings", file, f"{count} {what}",
                 f"{file}: remove them; a twin's parts hang on their joints alone")
           for what, count in found.items() if count > 0]
    return out or [passes("own settings", file, "parts hang on joints alone")]


def _beyond(model: mujoco.MjModel) -> int:
    """Return how many keyframes put a joint outside of its range."""
    at, limited = model.jnt_qposadr, model.jnt_limited.astype(bool)
    low, high = model.jnt_range[limited].T
    slack = SAME * np.maximum(np.abs(low), np.abs(high))
    values = model.key_qpos[:, at[limited]]
    return int(((values < low - slack) | (values > high + slack)).any(1).sum())


def _soft(model: mujoco.MjModel) -> int:
    """Return how many joints have a limit or a friction that does not press back."""
    press = (model.jnt_solref[:, 0] > 0) & (model.jnt_solref[:, 0] <= SOFT)
    if model.njnt:
        first = model.dof_solref[model.jnt_dofadr, 0]
        press &= (first > 0) & (first <= SOFT) & (model.dof_solimp[model.jnt_dofadr, 0] >= FIRM)
    press &= (model.jnt_solimp[:, 0] >= FIRM) & (model.jnt_margin == 0)
    return int((~press).sum())


def _bent(model: mujoco.MjModel) -> int:
    """Return how many terms of higher order joints have; engines before 3.17 know none."""
    terms = (getattr(model, name, np.zeros(0)) for name in ("dof_dampingpoly", "jnt_stiffnesspoly"))
    return sum(int(np.count_nonzero(t)) for t in terms)


def _loose(model: mujoco.MjModel) -> int:
    """Return how many couplings of joints do not hold."""
    first = model.eq_solref[:, 0]
    return int((~((first > 0) & (first <= SOFT) & (model.eq_solimp[:, 0] >= FIRM))).sum())


def _hidden(model: mujoco.MjModel) -> int:
    """Return how many geoms of parts, which collide with nothing, are not in the visual group."""
    seen = (model.geom_contype == 0) & (model.geom_conaffinity == 0) & (model.geom_bodyid > 0)
    return int((seen & (model.geom_group != SEEN_GROUP)).sum())


def options(model: mujoco.MjModel, twin: Twin | None, told: F64, step: float) -> list[CheckResult]:
    """Return what of the world in scene.xml contradicts twin.yaml, or is no world.

    Args:
        model: of scene.xml.
        twin: None where twin.yaml cannot be read.
        told: [3] gravity of twin.yaml.
        step: time step of twin.yaml, s.
    """
    found, file = model.opt, "scene.xml"
    weight = told if twin is None else gravity_vector(twin)
    faults = []
    if not np.abs(told - weight).max() <= SAME * np.abs(weight).max():
        faults.append(("twin.yaml", f"gravity is {told.tolist()}; 9.81 m/s2 along -up is "
                       f"{weight.round(6).tolist()}", "correct gravity, up or meters_per_unit"))
    if not np.abs(found.gravity - weight).max() <= SAME * np.abs(weight).max():
        faults.append((file, f"gravity is {found.gravity.tolist()}; twin.yaml has "
                       f"{weight.round(6).tolist()}", "correct <option gravity>"))
    if not 0 < found.timestep <= step * (1 + SAME):
        faults.append((file, f"timestep is {found.timestep:g} s; twin.yaml has {step:g} s, which "
                       "its servos need", f"set <option timestep> to {step:g} or less"))
    for name, good in (("disableflags", 0), ("disableactuator", 0), ("density", 0.0),
                       ("viscosity", 0.0)):
        if getattr(found, name) != good:
            faults.append((file, f"{name} is {getattr(found, name)}", f"set {name} back to {good}"))
    tries = min(found.iterations, 2 * found.ls_iterations, 2 * found.ccd_iterations)
    size = float(model.stat.extent) if twin is None else size_of(twin)
    close = found.ccd_tolerance <= max(LAX, NEAREST * size)
    if not (tries >= TRIES and found.tolerance <= LAX and 1 <= found.impratio <= STIFF and close):
        faults.append((file, f"the solver has {found.iterations} iterations, {found.ls_iterations} "
                       f"of lines, {found.ccd_iterations} of shapes, tolerance "
                       f"{found.tolerance:g}, of shapes {found.ccd_tolerance:g}, impratio "
                       f"{found.impratio:g}",
                       "remove these from <option>, or set them to MuJoCo's own"))
    if np.abs(found.wind).max() > 0:
        faults.append((file, f"wind is {found.wind.tolist()}", "remove <option wind>"))
    if int(found.enableflags):
        faults.append((file, f"enableflags is {int(found.enableflags)}: contacts "
                       "overridden, bodies asleep or other", "remove <flag ...='enable'>"))
    far = float(model.stat.extent) / max(1e-300, 0.0 if twin is None else size)
    if twin is not None and not 1 / FAR <= far <= FAR:
        faults.append((file, f"<statistic extent> is {far:.3g} times the size",
                       "set <statistic extent> to the size of the object"))
    out = [fails("options", f, text, f"{f}: {goal}") for f, text, goal in faults]
    return out or [passes("options", file, f"gravity and a time step of "
                           f"{found.timestep:g} s as in twin.yaml")]


def size_of(twin: Twin) -> float:
    """Return the diagonal of all parts at state 0, units."""
    low, high = bounds(tuple(p.mesh for p in twin.parts))
    return float(np.linalg.norm(high - low))


def leaking(path: Path) -> list[CheckResult]:
    """Return settings in a twin's own file that change the world it is put into."""
    import xml.etree.ElementTree as ET

    root = ET.parse(path).getroot()
    tags = [t for t in ("option", "compiler", "size", "statistic") if root.find(t) is not None]
    tags += [f"joint {j.get('name')}" for j in root.iter("joint")
             if j.get("type") in ("free", "ball")]
    tags += ["freejoint" for _ in root.iter("freejoint")]
    for default in root.iterfind("default"):
        tags += [f"default {kind.tag}" for kind in default if kind.tag != "default"]
    return [fails("own settings", path.name,
                  f"<{tag}> frees the twin, or counts for every model beside it",
                  f"{path.name}: remove <{tag}>, or move it into scene.xml or a class of its own")
            for tag in tags]
