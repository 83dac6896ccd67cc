"""All files of a twin folder, described and compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.agree import truth, world
from part2gs_robotics.agree.compare import compared
from part2gs_robotics.agree.described import NO, Described
from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.agree.meshes import Meshes
from part2gs_robotics.agree.of_glb import of_glb
from part2gs_robotics.agree.of_mujoco import of_mujoco
from part2gs_robotics.agree.of_sdf import of_sdf
from part2gs_robotics.agree.of_urdf import of_urdf
from part2gs_robotics.agree.of_usd import of_usd
from part2gs_robotics.agree.of_yaml import (
    YAML,
    array,
    density_of_material,
    frame,
    number,
    of_yaml,
    provenance,
    ranges,
)
from part2gs_robotics.errors import CheckError
from part2gs_robotics.model.twin import Twin

if TYPE_CHECKING:
    import mujoco

PASSIVE, ACTUATED, SCENE, URDF = "twin.xml", "twin_actuated.xml", "scene.xml", "twin.urdf"
NEEDED = (PASSIVE, ACTUATED, SCENE, URDF, YAML)
STEP = 0.002  # s, the engine's own, where twin.yaml does not say
# Where `export` puts other formats: beside the twin's files, or in a folder of the format's name.
MORE = {"sdf": "model.sdf", "glb": "twin.glb", "usd": "twin.usd"}


@dataclass(frozen=True)
class Told:
    """What twin.yaml gave; None and NaN where it cannot be read."""

    described: Described | None
    twin: Twin | None
    document: dict[str, object]


def further(folder: Path) -> dict[str, str]:
    """Return format by name of every further file of a twin, from its folder."""
    return {name: kind for kind, file in MORE.items() for name in (file, f"{kind}/{file}")
            if (folder / name).is_file()}


def agreement(folder: Path, models: Mapping[str, mujoco.MjModel]) -> list[CheckResult]:
    """Compare every file of a twin folder with every other, and with the meshes they show.

    Args:
        folder: whose XML was inspected: plain, and nothing it names leaves the folder.
        models: compiled, by file; those that do not compile are left out.

    Example:
        rows = agreement(Path("out"), {"twin.xml": model})
    """
    with np.errstate(all="ignore"):  # what is no number is told by the row it spoils
        return _agreement(folder, models)


def _agreement(folder: Path, models: Mapping[str, mujoco.MjModel]) -> list[CheckResult]:
    out = [fails("files", name, "is not there", f"build the twin again: a twin needs {name}")
           for name in NEEDED if not (folder / name).is_file()]
    out = out or [passes("files", "", f"{', '.join(NEEDED)} are there")]
    told, found = _told(folder)
    out += found
    files = [told.described] if told.described else []
    readers: list[tuple[str, Callable[[], Described | None]]] = [
        (n, partial(of_mujoco, n, models[n])) for n in NEEDED if n in models and n != URDF]
    if (folder / URDF).is_file():
        readers.append((URDF, lambda: of_urdf(folder / URDF, Meshes(folder))))
    twin = told.twin
    if twin is not None:
        readers += [(n, _reader(folder, n, kind, twin)) for n, kind in further(folder).items()]
    for name, reader in readers:
        described, rows = _read(name, reader)
        files += [described] if described else []
        out += rows
    size = _size(files)
    if len(files) > 1:
        out += compared(files, size)
    out += _alone(folder, models, told, size)
    return out


def _told(folder: Path) -> tuple[Told, list[CheckResult]]:
    if not (folder / YAML).is_file():
        return Told(None, None, {}), []
    try:
        described, twin, document = of_yaml(folder)
    except CheckError as error:
        text = str(error)
        return Told(None, None, {}), [fails("assets", YAML, text, text.partition("Needed ")[2]
                                            or "build the twin again")]
    rows = provenance(document) + ranges(described, document) + frame(document)
    rows += density_of_material(twin, document)
    rows += truth.masses(described, twin, document)
    rows += truth.loose_bits(twin) + truth.textures(twin, folder, document)
    rows += truth.pieces(twin) + truth.changed(folder, document)
    return Told(described, twin, document), rows


def _reader(folder: Path, name: str, kind: str, twin: Twin) -> Callable[[], Described | None]:
    path = folder / name
    if kind == "sdf":
        place = str(path.parent.relative_to(folder))
        return lambda: of_sdf(path, name, Meshes(folder, place), twin)
    if kind == "glb":
        return lambda: of_glb(path, name, twin)
    return lambda: of_usd(path, name, twin)


def _read(name: str, reader: Callable[[], Described | None]
          ) -> tuple[Described | None, list[CheckResult]]:
    try:
        found = reader()
    except (ValueError, OSError, SyntaxError) as error:  # SyntaxError: XML that is none
        return None, [fails("readable", name, str(error).splitlines()[0][:200],
                            f"{name}: correct it, or build and export the twin again")]
    if found is None:
        return None, [CheckResult("readable", name, "warn", detail="not compared: usd-core is not "
                              "installed", cause="pip install 'part2gs-robotics[usd]'")]
    return found, []


def _size(files: Sequence[Described]) -> float:
    points = [b.surface for f in files[:1] for b in f.bodies.values() if len(b.surface)]
    size = float(np.linalg.norm(np.ptp(np.concatenate(points), axis=0))) if points else 1.0
    return size if np.isfinite(size) and size > 0 else 1.0


def _alone(folder: Path, models: Mapping[str, mujoco.MjModel], told: Told, size: float
           ) -> list[CheckResult]:
    """Return what is judged in one model by itself."""
    step = number(told.document, "timestep") if told.document else STEP
    rows = list[CheckResult]()
    for name in (PASSIVE, ACTUATED):
        if name in models:
            rows += world.leaking(folder / name) + world.extras(name, models[name])
            rows += world.contact_rules(name, models[name], size)
            rows += world.servo_rules(name, models[name], int(name == ACTUATED), step)
    if SCENE in models:
        told_gravity = array(told.document, "gravity", (3,)) if told.document else np.full(3, NO)
        given = told_gravity if told.document else models[SCENE].opt.gravity
        rows += world.extras(SCENE, models[SCENE]) + world.contact_rules(SCENE, models[SCENE], size)
        rows += world.servo_rules(SCENE, models[SCENE], 1, step)
        rows += world.options(models[SCENE], told.twin, np.array(given), step)
    return rows
