"""Mass, centre and inertia of closed surfaces, by exact integrals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.errors import ExportError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.materials import DEFAULT, MATERIALS, density_of
from part2gs_robotics.model.twin import Part, PartMesh, Twin

GRAVITY = 9.81  # m/s2
MIN_MASS = 1e-9  # kg; MuJoCo refuses 1e-15 and its solver loses digits long before


@dataclass(frozen=True)
class MassProperties:
    """Rigid-body numbers of one part, in the frame of the mesh.

    Attributes:
        mass: kg.  center: [3] scene units.  inertia: [3, 3] about the centre, kg units^2.
        volume: units^3.
    """

    mass: float
    center: F64
    inertia: F64
    volume: float


def density(twin: Twin) -> float:
    """Return kg/m3 of the twin's material.

    Raises:
        ExportError: if it is neither a known name nor a number that can mean anything.
    """
    material = twin.material or DEFAULT
    found = density_of(material)
    if found is None:
        raise ExportError(
            f"material {material!r} of the twin is unknown. "
            f"Needed kg/m3 or one of {', '.join(MATERIALS)}; choose another --material."
        )
    return found


def density_per_unit(twin: Twin) -> float:
    """Return kg per cubed scene unit."""
    return density(twin) * twin.meters**3


def gravity_vector(twin: Twin) -> F64:
    """Return [3] gravity in scene units/s2, down = -up, +z up when unknown."""
    up = np.array([0.0, 0.0, 1.0]) if twin.up is None else np.asarray(twin.up, float)
    return np.asarray(-GRAVITY / twin.meters * up / np.linalg.norm(up)) + 0.0


def mass_properties(mesh: PartMesh, density: float) -> MassProperties:
    """Return mass, centre and inertia of the solid inside a closed mesh.

    Sums signed tetrahedra from one reference point; the second moment of a tetrahedron with
    apex 0 is det/120 (sum_i v_i v_i^T + s s^T), s = v_1 + v_2 + v_3.

    Args:
        mesh: closed, outward faces.
        density: kg per units^3.

    Raises:
        ExportError: if the volume is not positive or the tensor breaks A + B >= C.
    """
    reference = mesh.vertices.mean(0)  # near the solid: no cancellation far from the origin
    tri = (mesh.vertices - reference)[mesh.faces]
    det = np.einsum("ni,ni->n", tri[:, 0], np.cross(tri[:, 1], tri[:, 2]))
    volume = float(det.sum() / 6)
    if not volume > 0:
        raise ExportError(
            f"a part has volume {volume:.3g}. "
            "Needed a closed mesh with outward faces; rebuild the part."
        )
    total = tri.sum(1)
    first = np.einsum("n,ni->i", det, total) / 24
    second = (
        np.einsum("n,nki,nkj->ij", det, tri, tri) + np.einsum("n,ni,nj->ij", det, total, total)
    ) / 120
    center = first / volume
    second -= volume * np.outer(center, center)
    inertia = density * (np.trace(second) * np.eye(3) - second)
    _require_physical(inertia, density * volume)
    return MassProperties(density * volume, center + reference, inertia, volume)


def triangle_gap(inertia: F64) -> float:
    """Return (A + B - C) / C of the principal moments A <= B <= C; >= 0 for a body."""
    a, b, c = np.linalg.eigvalsh(inertia)
    return float((a + b - c) / c)


def _require_physical(inertia: F64, mass: float) -> None:
    moments = np.linalg.eigvalsh(inertia)
    rounding = 1e-9  # of the sums
    if mass < MIN_MASS or moments[0] <= 0 or triangle_gap(inertia) < -rounding:
        raise ExportError(
            f"a part has mass {mass:.3g} kg and principal inertia {moments}. "
            "Needed positive numbers with A + B >= C; check --scale and the mesh."
        )


def moment_about_axis(props: MassProperties, axis: F64, origin: F64) -> float:
    """Return the inertia about the line (origin, axis), kg units^2."""
    arm = props.center - origin
    arm = arm - axis * float(axis @ arm)
    return float(axis @ props.inertia @ axis + props.mass * (arm @ arm))


def upright(twin: Twin, goal: tuple[float, float, float]) -> F64:
    """Return the [3, 3] rotation that turns the scene's up direction, +z if unknown, to a goal."""
    up = -gravity_vector(twin)
    up, to = up / np.linalg.norm(up), np.asarray(goal, float)
    middle = up + to
    if np.linalg.norm(middle) < 1e-6:  # opposite: half a turn about any line across
        middle = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    middle = middle / np.linalg.norm(middle)
    half = 2 * np.outer(middle, middle) - np.eye(3)  # half a turn about the line between both
    return np.asarray(half @ (2 * np.outer(up, up) - np.eye(3))) if up @ to > -1 + 1e-9 else half


def link_origin(part: Part) -> F64:
    """Return [3] where a link's frame stands: on its joint's axis, the base in the world's."""
    return np.zeros(3) if part.joint is None else np.asarray(part.joint.origin, float)
