"""Numbers against the meshes they come from: masses, loose bits, pieces that files name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from manifold3d import Manifold

from part2gs_robotics.agree.described import Described
from part2gs_robotics.agree.finding import CheckResult, fails, measured, passes
from part2gs_robotics.agree.of_yaml import array, number
from part2gs_robotics.agree.vote import apart, relative
from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.inertia import mass_properties
from part2gs_robotics.exporters.meshfile import piece_name
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import defect, to_manifold, watertight
from part2gs_robotics.model.twin import PartMesh, Twin
from part2gs_robotics.runtime.hashing import digest_of_text_or_picture

DIGITS = 1e-5  # relative: meshes have nine digits, and their integrals lose at most four
DIGESTED = re.compile(r"assets/[\w-][\w.-]*")  # files of a twin, and nothing outside of it
TOLD = 4  # rows: of a twin whose files were all written again
LOOSE = 0.05  # of the size between a bit and the rest; bits of thirty finished twins keep 0.036


def masses(described: Described, twin: Twin, document: dict[str, object]) -> list[CheckResult]:
    """Return where a part's mass, centre or inertia is not that of its mesh and density.

    A mass that somebody measured stands for itself; its inertia must still be the mesh's share.

    Args:
        described: twin.yaml.
        twin: with its meshes.
        document: the whole of twin.yaml.
    """
    entries = document.get("parts")
    out, worst, count = list[CheckResult](), 0.0, 0
    for part, entry in zip(twin.parts, entries if isinstance(entries, list) else [], strict=False):
        if defect(part.mesh) is not None:
            continue  # the row `mesh` says so
        try:
            true = mass_properties(part.mesh, 1.0)
        except ExportError:
            continue
        body, said = described.bodies[part.name], entry if isinstance(entry, dict) else {}
        weighed = isinstance(said.get("mass"), dict) and said["mass"].get("source") == "measured"
        wanted = body.mass if weighed else number(said, "density") * true.volume
        gaps = {"volume": relative(array(said, "volume", ()), np.array(true.volume)),
                "mass": relative(np.array(body.mass), np.array(wanted)),
                "center": apart(body.center, true.center) / _size((part.mesh,)),
                "inertia": relative(body.inertia, true.inertia * wanted / true.volume)}
        worst, count = max(worst, *gaps.values()), count + 1
        key = next((k for k, gap in gaps.items() if not gap <= DIGITS), "")
        if key:
            out.append(CheckResult(
                "mass of mesh", f"twin.yaml: {part.name}", "fail", gaps[key], DIGITS, "",
                f"{key} is not that of the mesh, whose volume is {true.volume:.6g} units^3, centre "
                f"{true.center.round(6).tolist()}, and which weighs {wanted:.6g} kg",
                f"assets/{part.name}_visual.obj is another shape than the one described, or "
                f"twin.yaml has a wrong {key} of {part.name}: restore it, or build the twin again"))
    return out or [measured("mass of mesh", "", (worst, DIGITS, ""), f"{count} meshes times their "
                            "density have the masses, centres and inertias of twin.yaml", "")]


def _size(meshes: tuple[PartMesh, ...]) -> float:
    points = np.concatenate([m.vertices for m in meshes])
    return float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0


def loose_bits(twin: Twin) -> list[CheckResult]:
    """Return the part of whose mesh a bit floats furthest from the rest of it and of all others.

    Args:
        twin: with meshes at state 0; open ones are passed over.
    """
    closed = {p.name: to_manifold(p.mesh) for p in twin.parts if defect(p.mesh) is None}
    size = _size(tuple(p.mesh for p in twin.parts))
    worst, where, far = 0.0, "", np.zeros(3)
    for name, solid in closed.items():
        bits = sorted(solid.decompose(), key=lambda b: -float(b.volume()))
        for k, bit in enumerate(bits[1:], 1):
            rest = [b for i, b in enumerate(bits) if i != k]
            rest += [s for n, s in closed.items() if n != name]
            gap = _gap(bit, rest, size, worst)
            if gap > worst:
                worst, where, far = gap, name, _middle(bit)
    text = f"a bit at {far.round(4).tolist()} touches nothing" if where else "all hang together"
    return [measured("loose bits", where, (worst, LOOSE, "of size"), text,
                     f"assets/{where}_visual.obj: remove the bit at {far.round(4).tolist()}")]


def _gap(bit: Manifold, rest: list[Manifold], size: float, worst: float) -> float:
    """Return the smallest gap to others, of the size; the first one no larger than the worst."""
    gap = np.inf
    for other in rest:  # beyond three times the limit it is loose, however far
        gap = min(gap, float(bit.min_gap(other, 3 * LOOSE * size)) / size)
        if gap <= worst:
            break
    return gap


def _middle(solid: Manifold) -> F64:
    box = np.array(solid.bounding_box(), np.float64)
    return np.asarray((box[:3] + box[3:]) / 2)


def pieces(twin: Twin) -> list[CheckResult]:
    """Return collision pieces that are inside out, or are there twice, so that one is missing."""
    out = []
    for part in twin.parts:
        seen = dict[bytes, int]()
        for i, piece in enumerate(part.pieces):
            file, tri = piece_name(part, i), np.asarray(piece.vertices, np.float64)[piece.faces]
            volume = float((tri[:, 0] * np.cross(tri[:, 1], tri[:, 2])).sum()) / 6
            twice = seen.setdefault(np.unique(piece.vertices, axis=0).tobytes(), i)
            fault = ("is inside out" if volume < 0 else
                     f"is the same solid as {piece_name(part, twice)}" if twice != i else "")
            if fault:
                out.append(fails("assets", file, fault, f"{file}: restore it, or build the twin "
                                 "again"))
    return out


def changed(folder: Path, document: dict[str, object]) -> list[CheckResult]:
    """Return files that are not what twin.yaml was written with; none where it has no digests.

    What pictures show, how meshes are lit and where single pieces lie, no other file says.
    """
    told, out = document.get("files"), list[CheckResult]()
    for name, digest in told.items() if isinstance(told, dict) else ():
        path = folder / str(name)
        if not DIGESTED.fullmatch(str(name)) or not path.is_file() or (
                found := digest_of_text_or_picture(path)) == digest:
            continue  # of files that are not there the row below tells
        out.append(fails("assets", str(name), "is not the file that twin.yaml was written with",
                         f"{name}: restore it, or build the twin again; where the change is "
                         f"meant, write {found} for it into `files` of twin.yaml, or remove its "
                         "line there"))
    return out[:TOLD]


def textures(twin: Twin, folder: Path, document: dict[str, object]) -> list[CheckResult]:
    """Return parts whose material file is not there or names another picture, or that are open."""
    out = []
    entries = document.get("parts")
    for part, entry in zip(twin.parts, entries if isinstance(entries, list) else [], strict=False):
        said = entry.get("watertight") if isinstance(entry, dict) else None
        if said is True and (reason := defect(part.mesh)):
            out.append(fails("mesh", f"assets/{part.name}_visual.obj", f"{reason}; twin.yaml says "
                             "it is closed", f"assets/{part.name}_visual.obj: restore it, or build "
                             "the twin again"))
        elif said is not watertight(part.mesh):
            out.append(fails("own numbers", f"twin.yaml: {part.name}", f"watertight is {said}, the "
                             f"mesh says {not said}", f"twin.yaml: correct watertight of "
                             f"{part.name}, or assets/{part.name}_visual.obj"))
        material = folder / f"assets/{part.name}_visual.mtl"
        text = material.read_text("ascii", "replace") if material.is_file() else ""
        if part.mesh.texture is None:
            if f"map_Kd {part.name}_texture.png" in text:
                out.append(fails("assets", f"twin.yaml: {part.name}", "names no texture, though "
                                 f"{material.name} does", f"twin.yaml: name the texture of "
                                 f"{part.name}, or build the twin again"))
        elif f"map_Kd {part.name}_texture.png" not in text:
            out.append(fails("assets", f"{material.name}", f"names no {part.name}_texture.png",
                             f"assets/{material.name}: restore it, or build the twin again"))
    return out or [passes("assets", "", "meshes, pieces, materials and pictures "
                           "that twin.yaml names are there")]


