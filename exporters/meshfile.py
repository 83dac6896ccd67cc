"""Mesh files of the twin folder: OBJ with a colour on every vertex, normals and textures."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.xmlio import add
from part2gs_robotics.model.solids import corner_normals
from part2gs_robotics.model.twin import Part, PartMesh, Twin
from part2gs_robotics.runtime.atomic import write_bytes_atomic

NAME = re.compile(r"[a-z0-9_]+\Z")  # bare names every simulator and package tool accepts
CREASE = np.cos(np.deg2rad(30.0))  # faces farther apart form an edge; Blender's default as well
NORMAL_DIGITS = 3  # 0.06 degrees: no eye sees it, and a flat wall has one normal


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


def texture_name(part: Part) -> str:
    """Return the file name of a part's texture."""
    return f"{require_name(part.name)}_texture.png"


def write_meshes(twin: Twin, folder: Path) -> list[Path]:
    """Write every visual mesh and convex piece of a twin; return the files."""
    written = []
    for part in twin.parts:
        written.append(write_obj(part.mesh, folder / visual_name(part), shaded=True))
        written += _write_texture(part, folder)
        written += [
            write_obj(piece, folder / piece_name(part, i)) for i, piece in enumerate(part.pieces)
        ]
    return written


def write_obj(mesh: PartMesh, path: Path, *, shaded: bool = False) -> Path:
    """Write one mesh as OBJ, `v x y z r g b` with colours in 0..1; return the path.

    Corners of faces have their own `vt` and `vn` while they share `v`: the surface stays closed
    for every reader that looks at vertices.

    Args:
        mesh: of a part or of a piece of one.
        path: ending in .obj; a textured mesh names the .mtl beside it.
        shaded: with normals, which nothing but a viewer needs.
    """
    colors = mesh.colors.astype(float) / 255.0
    lines = [
        f"v {x:.9g} {y:.9g} {z:.9g} {r:.4g} {g:.4g} {b:.4g}"
        for (x, y, z), (r, g, b) in zip(mesh.vertices.tolist(), colors.tolist(), strict=True)
    ]
    corners = [[str(v) for v in (mesh.faces + 1).ravel().tolist()]]
    if mesh.texture is not None:
        values, index = _distinct(mesh.texture.uv)
        lines = [f"mtllib {path.stem}.mtl", *lines, *(f"vt {u:.6f} {v:.6f}" for u, v in values)]
        corners.append([str(i) for i in index])
    if shaded:
        normals = corner_normals(mesh.vertices, mesh.faces, CREASE)
        values, index = _distinct(normals.round(NORMAL_DIGITS) + 0.0)  # + 0: no -0
        lines += [f"vn {x:g} {y:g} {z:g}" for x, y, z in values]
        corners += [[""] * len(index)] * (mesh.texture is None) + [[str(i) for i in index]]
    if mesh.texture is not None:
        lines.append(f"usemtl {path.stem}")
    words = ["/".join(corner) for corner in zip(*corners, strict=True)]
    lines += [f"f {a} {b} {c}" for a, b, c in zip(words[::3], words[1::3], words[2::3],
                                                  strict=True)]
    write_bytes_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def _distinct(corners: NDArray[np.floating]) -> tuple[list[list[float]], list[int]]:
    """Return the different rows of [F, 3, n] values and, counted from 1, the row of each corner."""
    rows = np.ascontiguousarray(corners, np.float32).reshape(-1, corners.shape[-1])
    # rows as one value of raw bytes: sorting rows takes ten times as long
    raw = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    _, first, index = np.unique(raw, return_index=True, return_inverse=True)
    return rows[first].tolist(), (index.ravel() + 1).tolist()


def _write_texture(part: Part, folder: Path) -> list[Path]:
    """Write the picture of a textured part and the material that names it; return the files."""
    import cv2

    texture = part.mesh.texture
    if texture is None:
        return []
    picture = folder / texture_name(part)
    write_bytes_atomic(picture, cv2.imencode(".png", texture.image[..., ::-1])[1].tobytes())
    material = (folder / visual_name(part)).with_suffix(".mtl")
    lines = f"newmtl {material.stem}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {picture.name}\n"
    write_bytes_atomic(material, lines.encode())
    return [picture, material]


def mean_rgba(mesh: PartMesh) -> tuple[float, float, float, float]:
    """Return the area-weighted mean colour of a mesh in 0..1, opaque."""
    tri = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    face = mesh.colors[mesh.faces].mean(1) / 255.0
    red, green, blue = (area[:, None] * face).sum(0) / max(float(area.sum()), 1e-300)
    return round(float(red), 4), round(float(green), 4), round(float(blue), 4), 1.0


def add_material(asset: ET.Element, part: Part) -> None:
    """Add the MJCF material of a part: its texture, or the mean colour of its surface."""
    name = f"{part.name}_color"
    if part.mesh.texture is None:
        add(asset, "material", name=name, rgba=mean_rgba(part.mesh))
        return
    picture = f"{part.name}_texture"
    add(asset, "texture", name=picture, type="2d", file=texture_name(part))
    add(asset, "material", name=name, texture=picture, rgba=(1, 1, 1, 1))
