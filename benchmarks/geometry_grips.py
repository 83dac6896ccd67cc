"""A parallel gripper on the handles of twins: a Robotiq 2F-85 of the kit closes and pulls.

Handles were found on the true meshes at state 0: places that the open fingers (85 mm) reach without
meeting anything, far from the hinge. Objects in normalised units are given a size in metres.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_kit import Case

TURN, SLIDE = 30.0, 0.2  # degrees, metres: how far a part is pulled
SHARE = 0.9  # of its way from state 0, where a slide has less: its end is no matter of grip
DIAGONAL = 0.7071  # of two axes
LONGEST = 300  # s of one grip; it takes 20 to 60


@dataclass(frozen=True)
class Handle:
    """Where and how a part is gripped; places in scene units, in the world at state 0.

    Attributes:
        name: for people.  part: of the truth, 1 = first moving part.  place: between the fingers.
        close: the way the fingers close.  approach: the way the hand comes.
        metres: per scene unit, assumed for normalised units.
    """

    name: str
    part: int
    place: tuple[float, float, float]
    close: tuple[float, float, float]
    approach: tuple[float, float, float]
    metres: float = 1.0


# Places are read off the true meshes; of size in metres: a desk is 0.7 m high, an oven 0.9 m.
HANDLES: dict[str, tuple[Handle, ...]] = {
    "pm_10211_laptop": (
        Handle("screen", 1, (0.688, 0.473, 0.563), (DIAGONAL, 0, -DIAGONAL), (0, -1, 0), 0.3),),
    "sektion_cabinet": (
        Handle("top drawer", 3, (0.357, 0.045, 0.327), (0, 0, 1), (-1, 0, 0)),
        Handle("left door's corner", 2, (0.3765, -0.0113, -0.3807), (0.5, 0.5, DIAGONAL),
               (-DIAGONAL, DIAGONAL, 0)),),
    "libero_microwave": (
        Handle("door", 1, (0.054, -0.17, 0.09), (1, 0, 0), (0, 1, 0)),),
    "libero_wooden_cabinet": (
        Handle("top drawer", 1, (0.0317, -0.101, 0.189), (DIAGONAL, 0, -DIAGONAL), (0, 1, 0)),
        Handle("bottom drawer", 3, (-0.0346, -0.0989, 0.0374), (DIAGONAL, 0, -DIAGONAL),
               (0, 1, 0)),),
    "robosuite_door": (
        Handle("lever", 1, (-0.1362, 0.1029, -0.0468), (DIAGONAL, 0.5, -0.5),
               (0, DIAGONAL, DIAGONAL)),),
    "pm_102209_trashcan": (
        Handle("lid", 1, (-0.365, 0.326, 0.845), (DIAGONAL, 0, DIAGONAL), (0, -1, 0), 0.35),),
    "bigym_dishwasher": (
        Handle("door", 1, (0.0478, -0.9363, 0.6204), (0, -DIAGONAL, DIAGONAL),
               (0, DIAGONAL, DIAGONAL)),),
    "libero_short_cabinet": (
        Handle("bottom drawer", 3, (0.0161, -0.092, 0.0402), (0, -DIAGONAL, DIAGONAL),
               (0, DIAGONAL, DIAGONAL)),),
    "iai_oven_area": (
        Handle("oven door", 1, (0.3976, -0.0472, 0.5384), (0, 0, 1), (-DIAGONAL, -DIAGONAL, 0)),
        Handle("upper drawer", 2, (0.3467, -0.2485, 0.0625), (0, 0, 1), (-1, 0, 0)),),
    "pm_7201_oven": (
        Handle("upper door", 5, (-0.714, 0.454, 0.359), (DIAGONAL, 0, DIAGONAL), (0, -1, 0), 0.57),
        Handle("lower door", 4, (-1.001, -0.419, -0.294), (DIAGONAL, 0, DIAGONAL), (0, 1, 0),
               0.57),),
    "pm_102703_toilet": (
        Handle("lid", 1, (-0.744, -0.011, 0.56), (0, 0, 1), (DIAGONAL, DIAGONAL, 0), 0.4),),
    "pm_103755_suitcase": (
        Handle("lid", 2, (-0.035, -0.389, 0.551), (1, 0, 0), (0, 0, -1), 0.4),),
    "pm_101619_safe": (
        Handle("door's edge", 1, (-0.279, 0.321, 0.75), (0, DIAGONAL, -DIAGONAL), (1, 0, 0), 0.3),),
    "pm_100221_box": (
        Handle("lid", 1, (-0.471, -0.508, 0.4), (DIAGONAL, 0, DIAGONAL), (0, 1, 0), 0.34),),
    "pm_7179_oven": (
        Handle("upper door", 5, (-0.677, -0.308, 0.342), (-DIAGONAL, 0, -DIAGONAL),
               (DIAGONAL, 0, -DIAGONAL), 0.57),),
    "pm_22301_table": (
        Handle("left door", 1, (0.861, -0.355, -0.111), (0, 1, 0), (DIAGONAL, 0, DIAGONAL), 0.65),
        Handle("right door", 2, (0.487, 0.483, -0.108), (0, 1, 0), (DIAGONAL, 0, DIAGONAL),
               0.65),),
    "pm_48492_box": (
        Handle("flap", 1, (-0.334, -0.372, 0.522), (0, 0, -1), (1, 0, 0), 0.3),),
}


def grips(case: Case, pictures: Path | None) -> list[dict[str, Any]]:
    """Return what the gripper did with every handle of an object."""
    return [gripped(case, handle, pictures) for handle in HANDLES.get(case.name, ())]


def gripped(case: Case, handle: Handle, pictures: Path | None) -> dict[str, Any]:
    """Return what the gripper did with one handle.

    `part`: of the twin, None where none matches; `opened`: both fingers touched it and it followed
    by 90 % of what was asked.
    """
    row = {"object": case.name, "handle": handle.name, "metres": handle.metres, "opened": False,
           "asked": None, "reached": None, "touching": []}
    part = case.score["parts"][handle.part - 1].get("twin_part")
    row["part"] = part
    if part is None:
        return row
    with tempfile.TemporaryDirectory() as folder:
        twin = exported(case.twin, handle.metres, Path(folder) / case.name)
        command = words(case.kit, twin, handle, part, asked(case.twin, part, handle.metres))
        if pictures:
            place = re.sub(r"\W+", "_", handle.name)
            picture = pictures / f"grip_{case.name}_{place}.png"
            command += ["--picture", str(picture.resolve())]
        environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # the kit may be read-only
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder,
                              env=environment, timeout=LONGEST)
    if not done.stdout.strip().startswith("{"):
        sys.stderr.write(f"{case.name}: {handle.name}: {done.stderr.strip()[-300:]}\n")
        return row
    said = json.loads(done.stdout)
    return row | {"opened": done.returncode == 0, "asked": said["asked"],
                  "reached": said["reached"], "touching": said["contacts_closed"]}


def words(kit: Path, twin: Path, handle: Handle, part: str, by: float) -> list[str]:
    """Return the command line of grasp.py for a twin in metres."""
    place = np.array(handle.place) * handle.metres
    flags = {"part": part, "handle": place, "close": handle.close, "approach": handle.approach}
    texts = [f"--{name}={value if isinstance(value, str) else ','.join(f'{x:.6g}' for x in value)}"
             for name, value in flags.items()]
    return [sys.executable, str(kit.resolve() / "grasp.py"), str(twin), *texts, f"--by={by:.6g}"]


def asked(twin: Any, part: str, metres: float) -> float:
    """Return how far a part is pulled: TURN, or SLIDE and never farther than its joint goes."""
    (found,) = (one for one in twin.parts if one.name == part)
    if found.joint.turns:
        return TURN
    return float(min(SLIDE, SHARE * metres * opening(found).limits[1]))


def exported(twin: Any, metres: float, folder: Path) -> Path:
    """Write the twin in metres, its joints opening upward; return twin.xml."""
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.sdf import in_metres

    folder.mkdir(parents=True)
    parts = tuple(opening(part) for part in twin.parts)
    write_mjcf(in_metres(replace(twin, parts=parts, meters_per_unit=metres)), folder)
    return folder / "twin.xml"


def opening(part: Any) -> Any:
    """Return a part whose joint goes up from state 0 to state 1."""
    joint = part.joint
    if joint is None or joint.value >= 0:
        return part
    turned = replace(joint, axis=-joint.axis, value=-joint.value)
    return replace(part, joint=turned, limits=(-part.limits[1], -part.limits[0]))
