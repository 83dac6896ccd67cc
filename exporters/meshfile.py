"""Mesh files of the twin folder: OBJ with a colour on every vertex, and textures."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.xmlio import add
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin
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


def texture_name(part: Part) -> str:
    """Return the file name of a part's texture."""
    return f"{require_name(part.name)}_texture.png"


def write_meshes(twin: Twin, folder: Path) -> list[Path]:
    """Write every visual mesh and convex piece of a twin; return the files."""
    written = []
    for part in twin.parts:
        written.append(write_obj(part.mesh, folder / visual_name(part)))
        written += _write_texture(part, folder)
        written += [
            write_obj(piece, folder / piece_name(part, i)) for i, piece in enumerate(part.pieces)
        ]
    return written


def write_obj(mesh: PartMesh, path: Path) -> Path:
    """Write one mesh as OBJ, `v x y z r g b` with colours in 0..1; return the path.

    With a texture, corners of faces have their own `vt` while they share `v`: the surface stays
    closed for every reader that looks at vertices.
    """
    colors = mesh.colors.astype(float) / 255.0
    lines = [
        f"v {x:.9g} {y:.9g} {z:.9g} {r:.4g} {g:.4g} {b:.4g}"
        for (x, y, z), (r, g, b) in zip(mesh.vertices.tolist(), colors.tolist(), strict=True)
    ]
    faces = (mesh.faces + 1).tolist()
    if mesh.texture is None:
        lines += [f"f {a} {b} {c}" for a, b, c in faces]
    else:
        lines = [f"mtllib {path.stem}.mtl", *lines, *_textured(mesh.texture, path.stem, faces)]
    write_bytes_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def _textured(texture: Texture, material: str, faces: list[list[int]]) -> Iterator[str]:
    """Yield the lines of texture coordinates, equal ones once, and of faces that name them."""
    # pairs of float32 as one number: sorting rows takes ten times as long
    pairs = np.ascontiguousarray(texture.uv, np.float32).reshape(-1, 2).view(np.int64).ravel()
    places, corners = np.unique(pairs, return_inverse=True)
    yield from (f"vt {u:.6f} {v:.6f}" for u, v in places.view(np.float32).reshape(-1, 2).tolist())
    yield f"usemtl {material}"
    for (a, b, c), (i, j, k) in zip(faces, (corners.reshape(-1, 3) + 1).tolist(), strict=True):
        yield f"f {a}/{i} {b}/{j} {c}/{k}"


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
