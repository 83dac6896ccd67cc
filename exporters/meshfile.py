"""Mesh files of the twin folder: OBJ with a colour on every vertex."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from part2gs_robotics.errors import ExportError
from part2gs_robotics.model.twin import Part, PartMesh, Twin
from part2gs_robotics.runtime.atomic import write_bytes_atomic

NAME = re.compile(r"[a-z0-9_]+\Z")  # bare names every simulator and package tool accepts


def require_name(name: str) -> str:
    """Return the name if every simulator takes it as part of a file name.

    Raises:
        ExportError: otherwise.
    """
    if not NAME.match(name):
        raise ExportError(
            f"part name {name!r} cannot be a file name. "
            "Needed letters a-z, digits and _; rename the part."
        )
    return name


def visual_name(part: Part) -> str:
    """Return the file name of a part's visual mesh."""
    return f"{require_name(part.name)}_visual.obj"


def piece_name(part: Part, index: int) -> str:
    """Return the file name of a part's convex piece."""
    return f"{require_name(part.name)}_piece_{index:02d}.obj"


def write_meshes(twin: Twin, folder: Path) -> list[Path]:
    """Write every visual mesh and convex piece of a twin; return the files."""
    written = []
    for part in twin.parts:
        written.append(write_obj(part.mesh, folder / visual_name(part)))
        written += [
            write_obj(piece, folder / piece_name(part, i)) for i, piece in enumerate(part.pieces)
        ]
    return written


def write_obj(mesh: PartMesh, path: Path) -> Path:
    """Write one mesh as OBJ, `v x y z r g b` with colours in 0..1; return the path."""
    colors = mesh.colors.astype(float) / 255.0
    lines = [
        f"v {x:.9g} {y:.9g} {z:.9g} {r:.4g} {g:.4g} {b:.4g}"
        for (x, y, z), (r, g, b) in zip(mesh.vertices.tolist(), colors.tolist(), strict=True)
    ]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    write_bytes_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def mean_rgba(mesh: PartMesh) -> tuple[float, float, float, float]:
    """Return the area-weighted mean colour of a mesh in 0..1, opaque."""
    tri = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    face = mesh.colors[mesh.faces].mean(1) / 255.0
    red, green, blue = (area[:, None] * face).sum(0) / max(float(area.sum()), 1e-300)
    return round(float(red), 4), round(float(green), 4), round(float(blue), 4), 1.0
