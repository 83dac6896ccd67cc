"""What is seen besides colours: meshes that name their material, normals, doubles, own paint."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import Part, Twin

if TYPE_CHECKING:
    import mujoco

UNPAINTED = (0.5, 0.5, 0.5, 1.0)  # rgba of a geom that says none: only then its material counts
UPRIGHT = 0.5  # mean cosine between faces and their normals; ours, creased at 30 degrees, have 0.9


def shown(folder: Path, twin: Twin, models: Mapping[str, mujoco.MjModel]) -> list[CheckResult]:
    """Return a row per mesh, model or body that viewers show as something else.

    Args:
        folder: of the twin.
        twin: with its meshes.
        models: compiled, by file.
    """
    out = [row for part in twin.parts for row in _mesh(folder, part)]
    for file, model in models.items():
        out += _painted(file, model) if file.endswith(".xml") else []
    return out


def _bad(where: str, text: str, cause: str) -> CheckResult:
    return fails("same look", where, text, f"{where.partition(':')[0]}: {cause}")


def _mesh(folder: Path, part: Part) -> Iterator[CheckResult]:
    """Yield what engines that read materials or normals from the OBJ itself show otherwise."""
    stem = f"{part.name}_visual"
    file = f"assets/{stem}.obj"
    try:
        data = (folder / file).read_bytes()
    except OSError:
        return  # the row `assets` says so
    wanted = [f"mtllib {stem}.mtl", f"usemtl {stem}"] if part.mesh.texture is not None else []
    found = [line.decode("utf-8", "replace").strip()
             for line in re.findall(rb"^(?:mtllib|usemtl)[^\n]*", data, re.MULTILINE)]
    if found != wanted:
        yield _bad(file, f"names the materials {found}; needed {wanted}",
                   "restore it, or build the twin again")
    turn = _normals(data, part)
    if not turn >= UPRIGHT:
        yield _bad(file, f"its normals and its faces have a mean cosine of {turn:.2g}, so that it "
                   "is lit from the wrong side", "restore its vn, or build the twin again")


def _normals(data: bytes, part: Part) -> float:
    """Return the mean cosine between normals of corners and their faces, by area; 1 without any."""
    rows = re.findall(rb"^vn ([^\n]*)", data, re.MULTILINE)
    if not rows:
        return 1.0
    try:
        values = np.array(b" ".join(rows).split(), np.float64).reshape(-1, 3)
        words = b" ".join(re.findall(rb"^f ([^\n]*)", data, re.MULTILINE)).split()
        index = np.array([word.split(b"/")[2] for word in words], np.int64).reshape(-1, 3) - 1
        corners = values[index]
    except (ValueError, IndexError):
        return float("nan")
    tri = np.asarray(part.mesh.vertices, np.float64)[part.mesh.faces]
    if len(tri) != len(corners):
        return float("nan")
    across: F64 = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    along = (corners * across[:, None]).sum(2).mean(1)
    return float(along.sum() / max(float(np.linalg.norm(across, axis=1).sum()), 1e-300))


def _painted(file: str, model: mujoco.MjModel) -> Iterator[CheckResult]:
    """Yield visual geoms with a colour of their own over their material, and doubles of them."""
    seen = (model.geom_contype == 0) & (model.geom_conaffinity == 0) & (model.geom_bodyid > 0)
    seen &= model.geom_dataid >= 0
    for g in np.flatnonzero(seen):
        name, part = model.geom(int(g)).name, model.body(int(model.geom_bodyid[g])).name
        if model.geom_matid[g] >= 0 and not np.allclose(model.geom_rgba[g], UNPAINTED):
            yield _bad(f"{file}: {part}", f"{name or 'its mesh'} has rgba "
                       f"{model.geom_rgba[g].round(3).tolist()}, which hides its material",
                       f"remove rgba of {name or 'the visual geom'}")
        before = seen[:g] & (model.geom_bodyid[:g] == model.geom_bodyid[g])
        if (model.geom_dataid[:g][before] == model.geom_dataid[g]).any():
            yield _bad(f"{file}: {part}", f"{name or 'a mesh'} is there twice, and flickers",
                       f"leave one visual geom of {part}")
