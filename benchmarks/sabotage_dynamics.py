"""Kinds of sabotage of joints and servos that all files agree on: physics alone can tell."""

from __future__ import annotations

from pathlib import Path

from sabotage_models import DRIVEN, JOINT, SERVO
from sabotage_tools import MJCF, Deed, Kind, NotHereError, both, put, times, told

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
        Kind("damping x 50, in every file", names, ("push", *WEAK), both(
            put(MJCF, JOINT, "damping", times(50)),
            put(URDF, f"{OF_URDF}/dynamics", "damping", times(50)),
            _sdf("dynamics/damping", 50), told("joints", "damping", lambda old: old * 50))),
    ]
