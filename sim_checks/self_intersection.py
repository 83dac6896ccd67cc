"""How many faces of a part's own surface cut each other."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.sim_checks.result import CheckResult
from part2gs_robotics.sim_checks.subject import Subject

NAME = "self-intersection"


def check_self_intersections(subject: Subject) -> list[CheckResult]:
    """Return one row per body: faces of its true surface that cut each other.

    A warning, never a failure: the exact booleans all other rows rest on (manifold3d) tolerate such
    faces, and so does the engine, which collides with convex pieces; slicers and renderers do not
    always. Every surface is looked at alone: bodies of several closed shapes may overlap.
    """
    try:
        import pymeshlab  # noqa: F401  # opens libGL, which not every machine has
    except (ImportError, OSError) as error:
        why = f"not looked for: pymeshlab cannot be loaded ({' '.join(str(error).split())})"
        return [CheckResult(NAME, subject.body(b), "skipped", detail=why) for b in subject.meshes]
    return [_row(subject.body(body), meshes) for body, meshes in subject.meshes.items()]


def _row(name: str, meshes: list[PartMesh]) -> CheckResult:
    count = sum(cutting_faces(mesh) for mesh in meshes)
    total = sum(len(mesh.faces) for mesh in meshes)
    detail = (
        f"warning: {count} of {total} faces cut each other" if count else "no face cuts another"
    )
    return CheckResult(NAME, name, "pass", float(count), unit="faces", detail=detail)


def cutting_faces(mesh: PartMesh) -> int:
    """Return the number of faces that cut another one.

    Raises:
        ImportError: if a system library that pymeshlab opens is missing.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    meshes.add_mesh(pymeshlab.Mesh(vertices, np.ascontiguousarray(mesh.faces, np.int32)))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def warnings_of(rows: list[CheckResult]) -> tuple[str, ...]:
    """Return one note that names all bodies whose faces cut each other."""
    found = [f"{r.subject} {r.value:.0f}" for r in rows if r.name == NAME and r.value]
    return (f"warning: faces of one surface cut each other: {', '.join(found)}",) if found else ()
