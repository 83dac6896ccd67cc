"""twin.yaml: the neutral description of a twin, with the provenance of every number."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.dynamics import (
    ARMATURE,
    COAST,
    FORCE_MARGIN,
    FRICTION,
    SAG,
    SERVO_FREQUENCY,
    TRAVEL_TIME,
    JointDynamics,
    Physics,
    physics_of,
)
from part2gs_robotics.exporters.inertia import MassProperties, density, density_per_unit
from part2gs_robotics.exporters.meshfile import piece_name, texture_name, visual_name
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.exporters.xmlio import parsed_yaml
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import moves
from part2gs_robotics.model.materials import DEFAULT
from part2gs_robotics.model.solids import watertight
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.runtime.atomic import write_bytes_atomic
from part2gs_robotics.runtime.hashing import digest_of_text_or_picture

Source = Literal["measured", "fitted", "derived", "assumed"]
Tree = dict[str, object]
MAX_YAML_BYTES = 20_000_000  # a twin of 20 parts is 100 kB
FORMAT = 2  # version of the file's layout; 2 names files from the twin folder, in assets/


def write_twin_yaml(twin: Twin, folder: Path, extra: Mapping[str, object] | None = None) -> Path:
    """Write twin.yaml, with digests of the meshes and pictures that are there; return the file.

    Args:
        twin: the twin.
        folder: where it goes.
        extra: plain values of the build (scene counts, versions), stored under `build`.
    """
    import yaml

    document = twin_document(twin) | {"files": digests(twin, folder), "build": dict(extra or {})}
    text = yaml.safe_dump(_plain(document), sort_keys=False, allow_unicode=True, width=100)
    write_bytes_atomic(folder / "twin.yaml", text.encode())
    return folder / "twin.yaml"


def digests(twin: Twin, folder: Path) -> dict[str, str]:
    """Return sha256 by name of the twin's meshes, materials and pictures in a folder."""
    named = [n for p in twin.parts for n in (
        visual_name(p), f"{visual_name(p).removesuffix('.obj')}.mtl", texture_name(p),
        *(piece_name(p, i) for i in range(len(p.pieces))))]
    return {n: digest_of_text_or_picture(folder / n) for n in named if (folder / n).is_file()}


def twin_document(twin: Twin) -> Tree:
    """Return the whole description; every number is {value, source, note}."""
    physics = physics_of(twin)
    return {
        "format": FORMAT,
        "name": twin.name,
        "frame": "world of the input scene, lengths in scene units, joint position 0 = state 0",
        "meters_per_unit": _scale(twin),
        "up": _up(twin),
        "material": _material(twin),
        "gravity": _value(
            physics.gravity,
            "assumed",
            "9.81 m/s2 along -up, in scene units; scene.xml alone has it",
        ),
        "timestep": _value(
            physics.step,
            "assumed",
            "s; resolves the fastest servo at gain x 100; scene.xml alone has it",
        ),
        "parts": [_part(twin, p, m) for p, m in zip(twin.parts, physics.masses, strict=True)],
        "joints": [_joint(twin, i, physics) for i in range(1, len(twin.parts))],
        "notes": list(twin.notes),
    }


def _scale(twin: Twin) -> Tree:
    if twin.meters_per_unit is None:
        taken = f"{twin.assumed_meters:g} m per unit"
        note = f"the scene gives no scale; masses and gravity take {taken}"
        return _value("unknown", "assumed", note) | {"taken": twin.assumed_meters}
    return _value(twin.meters_per_unit, "measured", twin.scale_note)


def _material(twin: Twin) -> Tree:
    if twin.material is None:
        return _value(DEFAULT, "assumed", "photos show no density; --material says it")
    return _value(twin.material, "measured", "given")


def _up(twin: Twin) -> Tree:
    if twin.up is None:
        return _value([0.0, 0.0, 1.0], "assumed", "the scene gives no up direction")
    return _value(twin.up, "measured", "given by the scene")


def _value(value: object, source: Source | str, note: str = "") -> Tree:
    return {"value": value, "source": source, "note": note}


def _part(twin: Twin, part: Part, props: MassProperties) -> Tree:
    """Return a part; its mass is as sure as the less sure one of scale and material."""
    made = "assumed" if twin.material is None else "measured"
    sure = "assumed" if twin.material is None or twin.meters_per_unit is None else "fitted"
    heavy = f"volume of the closed mesh times the {'given' if twin.material else 'assumed'} density"
    heavy += "" if twin.meters_per_unit else " at the assumed scale"
    return {
        "name": part.name,
        "parent": twin.parts[part.parent].name if part.parent >= 0 else None,
        "visual_mesh": visual_name(part),
        "texture": None if part.mesh.texture is None else texture_name(part),
        "collision_meshes": [piece_name(part, i) for i in range(len(part.pieces))],
        "watertight": watertight(part.mesh),
        "volume": _value(props.volume, "fitted", "exact integral over the closed mesh, units^3"),
        "density": _value(
            density_per_unit(twin), made, f"{density(twin):g} kg/m3, in kg per units^3"
        ),
        "mass": _value(props.mass, sure, heavy),
        "center": _value(props.center, "fitted", "uniform density; world frame at state 0"),
        "inertia": _value(props.inertia, sure, f"about the centre, kg units^2; {heavy}"),
        "synthesised": _value(part.mesh.synthesised, "measured", "share of surface nobody saw"),
        "num_gaussians": _value(part.num_gaussians, "measured", "of both states"),
        "diagnostics": {k: _value(v, "fitted", "optimiser")
                        for k, v in part.diagnostics.items() if math.isfinite(v)},
    }


def _joint(twin: Twin, index: int, physics: Physics) -> Tree:
    part = twin.parts[index]
    joint = part.joint
    assert joint is not None  # every part but the base has one
    out: Tree = {
        "name": joint_name(part),
        "part": part.name,
        "parent": twin.parts[part.parent].name,
        "type": joint.kind,
        "axis": _value(joint.axis, "fitted", "world frame at state 0"),
        "origin": _value(joint.origin, "fitted", "a point on the axis, world frame at state 0"),
        "pitch": _value(joint.pitch, "fitted", "scene units per rad, screw only"),
        "range": _value(list(part.limits), part.limits_source, _range_note(part)),
        "observed": _value(sorted((0.0, joint.value)), "measured", "between the observed states"),
        "state_0": _value(0.0, "measured", "zero by definition"),
        "state_1": _value(joint.value, "fitted", "rad or scene units"),
        "sigma": _sigma(joint),
        "bic": {k: _value(v, "fitted", "lower is better") for k, v in joint.bic.items()},
        "confidence": _value(_known(joint.confidence), "fitted", "share of evidence explained"),
    }
    return out | _dynamics(physics.joints[index]) if moves(part) else out


def _range_note(part: Part) -> str:
    if part.limits_source == "derived":
        return ("covers both observed states, and beyond them what the closed meshes leave free; "
                "at most 180 degrees unless both stops are found, or a fifth of a slide inside its "
                "carrier")
    if part.limits_source == "assumed":
        return "set by hand"
    return "covers both observed states"


def _sigma(joint: Joint) -> Tree:
    return {
        "axis": _value(_known(joint.sigma_axis), "fitted", "rad; null = not estimated"),
        "origin": _value(_known(joint.sigma_origin), "fitted", "scene units; null = not estimated"),
        "value": _value(_known(joint.sigma_value), "fitted", "rad or units; null = not estimated"),
        "rise": _value(_known(joint.sigma_rise), "fitted",
                       "scene units, pitch times value of a screw; null = not estimated"),
    }


def _dynamics(dyn: JointDynamics) -> Tree:
    notes = {
        "damping": f"a push dies away in {COAST:g} s",
        "friction": f"{FRICTION:.0%} of the weight it carries, at the radius of gyration",
        "armature": f"{ARMATURE:.0%} of the joint's inertia",
        "kp": f"{SERVO_FREQUENCY:g} rad/s, or droop under gravity and friction below {SAG:.1%} of "
        "the range; twin_actuated.xml alone has it",
        "kv": "critical damping (dampratio 1); twin_actuated.xml alone has it",
        "force": f"{FORCE_MARGIN:g} times gravity, friction and the range in {TRAVEL_TIME:g} s",
        "velocity": f"full range in {TRAVEL_TIME:g} s, at most twice that speed",
    }
    return {key: _value(getattr(dyn, key), "assumed", note) for key, note in notes.items()}


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _plain(value: object) -> object:
    """Return the same tree in types YAML knows."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


@dataclass(frozen=True)
class TwinSummary:
    """What checks and reports read back from twin.yaml.

    Attributes:
        name: model name.  document: the whole tree.
        parts, joints: entries by name.  assumed: dotted path of every assumed number.
    """

    name: str
    document: Tree
    parts: dict[str, Tree]
    joints: dict[str, Tree]
    assumed: tuple[str, ...]

    def diagnostics(self, part: str) -> dict[str, float]:
        """Return the optimiser's losses of a part, empty if it has none."""
        entry = self.parts.get(part, {}).get("diagnostics")
        found = entry if isinstance(entry, dict) else {}
        return {k: float(v["value"]) for k, v in found.items() if _is_number(v)}


def _is_number(entry: object) -> bool:
    return isinstance(entry, dict) and isinstance(entry.get("value"), (int, float))


def read_twin_yaml(folder: Path) -> TwinSummary:
    """Read twin.yaml of a twin folder.

    Raises:
        CheckError: if it is missing, too large or not a description of a twin.
    """
    import yaml

    path = folder / "twin.yaml"
    try:
        if path.stat().st_size > MAX_YAML_BYTES:
            raise CheckError(f"{path}: larger than {MAX_YAML_BYTES} bytes. Needed our twin.yaml.")
        document = parsed_yaml(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError, RecursionError) as error:
        raise CheckError(
            f"{path}: cannot be read ({_first_line(error)}). "
            "Needed the file `build` writes; build the twin again."
        ) from None
    if not isinstance(document, dict) or not isinstance(document.get("parts"), list):
        raise CheckError(
            f"{path}: has no list `parts`. Needed the file `build` writes; build the twin again."
        )
    return TwinSummary(
        str(document.get("name", "")),
        document,
        _by_name(document["parts"]),
        _by_name(document.get("joints")),
        tuple(assumed_numbers(document)),
    )


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _by_name(entries: object) -> dict[str, Tree]:
    found = entries if isinstance(entries, list) else []
    return {str(e["name"]): e for e in found if isinstance(e, dict) and "name" in e}


def assumed_numbers(tree: object, path: str = "") -> Iterator[str]:
    """Yield the dotted path of every value nobody measured or fitted."""
    if isinstance(tree, dict):
        if tree.get("source") == "assumed":
            yield path
        for key, value in tree.items():
            yield from assumed_numbers(value, f"{path}.{key}" if path else str(key))
    elif isinstance(tree, list):
        for i, value in enumerate(tree):
            name = value.get("name", i) if isinstance(value, dict) else i
            yield from assumed_numbers(value, f"{path}.{name}")
