"""The export door: names every format takes, surfaces that are closed; what changed is told."""

from __future__ import annotations

import re
import unicodedata
from collections import Counter
from dataclasses import replace

import manifold3d
import numpy as np

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.inertia import density_per_unit, mass_properties
from part2gs_robotics.model.arrays import I64
from part2gs_robotics.model.solids import GREY, defect, hull_of, to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin

FLAT = 1e-12  # of its box: a convex piece of less volume has no hull in any engine
LONGEST_NAME = 60  # characters: file names end at 255 bytes, and formats add words of their own


def sound_twin(twin: Twin) -> Twin:
    """Return a twin that can be written, with a note about everything that was repaired.

    Raises:
        ExportError: naming the part that cannot be repaired.
    """
    notes: list[str] = []
    name = plain_name(twin.name, "twin", set())
    _told(notes, "twin", twin.name, name)
    taken, parts = {"world", name}, []
    for index, part in enumerate(twin.parts):
        own = plain_name(part.name, f"part_{index}", taken)
        taken |= {own, f"{own}_turn"}
        _told(notes, "part", part.name, own)
        parts.append(_sound_part(replace(part, name=own), notes))
    found = replace(twin, name=name, parts=tuple(parts), notes=(*twin.notes, *notes))
    for part in found.parts:
        try:
            mass_properties(part.mesh, density_per_unit(found))
        except ExportError as error:
            raise ExportError(f"{part.name}: {error}") from None
    return found


def plain_name(name: str, otherwise: str, taken: set[str]) -> str:
    """Return a name of a-z, 0-9 and _ that is not taken: accents go, other signs become _."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    plain = re.sub(r"[^a-z0-9]+", "_", plain) if re.search(r"[^a-z0-9_]", plain) else plain
    first = plain = (plain.strip("_") or otherwise)[:LONGEST_NAME]
    if plain[0].isdigit():  # USD has no such names
        first = plain = f"n_{plain}"
    number = 2
    while plain in taken or f"{plain}_turn" in taken:  # which is a link of its own under a screw
        plain, number = f"{first}_{number}", number + 1
    return plain


def _told(notes: list[str], kind: str, before: str, after: str) -> None:
    if before != after:
        notes.append(f"name of {kind} {before!r} written as {after!r}")


def _sound_part(part: Part, notes: list[str]) -> Part:
    mesh = sound_mesh(part.mesh, part.name, notes)
    pieces = tuple(piece for piece in part.pieces if _has_hull(piece))
    if lost := len(part.pieces) - len(pieces):
        notes.append(f"part {part.name}: {lost} flat collision piece(s) left out")
        if not pieces:
            pieces = (to_mesh(hull_of(mesh.vertices)),)
            notes.append(f"part {part.name}: collides with its hull, no piece was left")
    return replace(part, mesh=mesh, pieces=pieces)


def _has_hull(piece: PartMesh) -> bool:
    if len(piece.vertices) < 4 or not np.isfinite(piece.vertices).all():
        return False
    box = np.ptp(piece.vertices, axis=0)
    return bool(hull_of(piece.vertices).volume() > FLAT * float(box.max()) ** 3)


def sound_mesh(mesh: PartMesh, name: str, notes: list[str]) -> PartMesh:
    """Return a closed mesh with outward faces.

    Corners in one place are joined, holes are closed by a fan to their middle, inward faces are
    turned, bodies that overlap are united (texture and colours are lost then).

    Args:
        mesh: as it came.
        name: of the part, for texts.
        notes: what was done is appended.

    Raises:
        ExportError: if it has no finite inside to fill.
    """
    used = mesh.vertices[mesh.faces] if len(mesh.faces) else np.zeros((0, 3, 3))
    if not np.isfinite(used).all():
        raise ExportError(f"part {name}: a corner of its mesh is not finite. Needed finite "
                          "places; repair the mesh or build the twin again.")
    if defect(mesh) is not None:
        mesh = _closed(mesh, name, notes)
    solid = to_manifold(mesh)
    bodies = solid.decompose()
    if len(bodies) > 1:
        whole = manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add)
        if solid.volume() - whole.volume() > 1e-9 * solid.volume():  # rounding of sums
            notes.append(f"part {name}: {len(bodies)} bodies that overlapped were united")
            return replace(to_mesh(whole, GREY), synthesised=mesh.synthesised)
    return mesh


def _closed(mesh: PartMesh, name: str, notes: list[str]) -> PartMesh:
    joined = _joined(mesh)
    holes = _loops(joined.faces)
    filled = _filled(joined, holes)
    tri = filled.vertices[filled.faces] - filled.vertices.mean(0)
    if float(np.einsum("ni,ni->", tri[:, 0], np.cross(tri[:, 1], tri[:, 2]))) < 0:
        texture = filled.texture
        if texture is not None:
            texture = replace(texture, uv=texture.uv[:, ::-1])
        filled = replace(filled, faces=filled.faces[:, ::-1], texture=texture)
        notes.append(f"part {name}: faces looked inward, turned")
    if reason := defect(filled):
        raise ExportError(f"part {name}: its mesh is not closed ({reason}), nor do "
                          f"{len(holes)} filled holes close it. Needed a watertight solid; repair "
                          "the mesh or build the twin again.")
    if len(joined.vertices) < len(mesh.vertices):
        notes.append(f"part {name}: corners in the same place joined")
    if holes:
        notes.append(f"part {name}: {len(holes)} hole(s) closed")
    return filled


def _joined(mesh: PartMesh) -> PartMesh:
    """Return the mesh with one vertex per place and no face of fewer than three."""
    _, first, index = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    faces = index.ravel()[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    texture = mesh.texture
    if texture is not None:
        texture = replace(texture, uv=texture.uv[whole])
    return replace(mesh, vertices=mesh.vertices[first], faces=faces[whole],
                   colors=mesh.colors[first], texture=texture)


def _loops(faces: I64) -> list[list[int]]:
    """Return the vertices around every hole, in the order that faces to fill it need."""
    edges = [(int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1),
                                                                strict=True)]
    count = Counter(edges)
    onward = {b: a for (a, b), n in count.items() if n == 1 and (b, a) not in count}
    loops = []
    while onward:
        start, at = next(iter(onward.items()))
        loop = [start]
        del onward[start]
        while at in onward:
            loop.append(at)
            at = onward.pop(at)
        loops.append(loop)
    return loops


def _filled(mesh: PartMesh, loops: list[list[int]]) -> PartMesh:
    """Return the mesh with a fan of grey faces over every loop."""
    if not loops:
        return mesh
    middles, fans = [], []
    for k, loop in enumerate(loops):
        middles.append(mesh.vertices[loop].mean(0))
        fans += [(a, b, len(mesh.vertices) + k)
                 for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    texture = mesh.texture
    if texture is not None:
        blank = np.zeros((len(fans), 3, 2), texture.uv.dtype)
        texture = replace(texture, uv=np.concatenate([texture.uv, blank]))
    grey = np.tile(np.array(GREY, np.uint8), (len(loops), 1))
    return replace(mesh, vertices=np.concatenate([mesh.vertices, middles]),
                   faces=np.concatenate([mesh.faces, fans]), texture=texture,
                   colors=np.concatenate([mesh.colors, grey]))
