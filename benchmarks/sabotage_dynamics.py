"""Kinds of sabotage of joints and servos that all files agree on: physics alone can tell."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
from sabotage_models import DRIVEN, JOINT, SERVO
from sabotage_tools import MJCF, Deed, Kind, NotHereError, both, edit_xml, put, times, told

URDF, YAML = "twin.urdf", "twin.yaml"
OF_URDF = ".//joint[@name='part_1_joint']"
SDF = ".//joint[@name='part_1_joint']/axis"
WEAK = ("reach", "tracking", "fast drive", "hold")


def _sdf(path: str, factor: float) -> Deed:
    """Return a deed on the number of an exported model.sdf, if there is one."""
    deed = put("sdf/model.sdf", f"{SDF}/{path}", "TEXT", times(factor))

    def where_it_is(folder: Path) -> None:
        try:
            deed(folder)
        except NotHereError:
            return

    return where_it_is


def _falls(folder: Path) -> None:
    """Raise if no weight pulls at the first joint in a keyframe: friction holds nothing there."""
    model = mujoco.MjModel.from_xml_path(str(folder / "twin.xml"))
    data, pulled = mujoco.MjData(model), []
    for key in range(model.nkey):
        mujoco.mj_resetDataKeyframe(model, data, key)
        mujoco.mj_forward(model, data)
        pulled.append(abs(data.qfrc_bias[0]))
    if not np.max(pulled) > 0.5 * model.dof_frictionloss[0]:
        raise NotHereError("no joint that friction holds against gravity")


def kinds() -> list[Kind]:
    """Return every kind, in the order of the table."""
    names = ("twin.xml", DRIVEN, URDF, YAML)
    return [
        Kind("servo that swings (dampratio 0.12)", (DRIVEN,),
             ("overshoot", "settling", "jitter"), put(DRIVEN, SERVO, "dampratio", "0.12")),
        Kind("effort x 0.05, in every file", names, WEAK, both(
            put(DRIVEN, SERVO, "forcerange", times(0.05)),
            put(URDF, f"{OF_URDF}/limit", "effort", times(0.05)),
            _sdf("limit/effort", 0.05), told("joints", "force", lambda old: old * 0.05))),
        Kind("friction x 20, in every file", names, ("push", *WEAK), both(
            put(MJCF, JOINT, "frictionloss", times(20)),
            put(URDF, f"{OF_URDF}/dynamics", "friction", times(20)),
            _sdf("dynamics/friction", 20), told("joints", "friction", lambda old: old * 20))),
        Kind("friction x 0.02, in every file", names, ("stands",), both(
            _falls, put(MJCF, JOINT, "frictionloss", times(0.02)),
            put(URDF, f"{OF_URDF}/dynamics", "friction", times(0.02)),
            _sdf("dynamics/friction", 0.02), told("joints", "friction", lambda old: old * 0.02))),
        Kind("friction creeps (solimpfriction as MuJoCo has it)", MJCF, ("own settings", "stands"),
             edit_xml(MJCF, lambda r: [j.attrib.pop("solimpfriction", None)
                                       for j in r.iter("joint")])),
        Kind("damping x 50, in every file", names, ("push", *WEAK), both(
            put(MJCF, JOINT, "damping", times(50)),
            put(URDF, f"{OF_URDF}/dynamics", "damping", times(50)),
            _sdf("dynamics/damping", 50), told("joints", "damping", lambda old: old * 50))),
    ]
