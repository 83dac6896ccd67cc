"""Mass properties against closed forms and invariances."""

from __future__ import annotations

import dataclasses

import manifold3d
import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.dynamics import physics_of
from part2gs_robotics.exporters.inertia import mass_properties, moment_about_axis, triangle_gap
from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import PartMesh


def test_box_is_the_textbook_box() -> None:
    props = mass_properties(to_mesh(box((1, 2, 3), (1.2, 2.4, 3.8))), 1000.0)
    mass = 1000 * 0.2 * 0.4 * 0.8
    assert props.mass == pytest.approx(mass)
    np.testing.assert_allclose(props.center, [1.1, 2.2, 3.4])
    want = mass / 12 * np.array([0.4**2 + 0.8**2, 0.2**2 + 0.8**2, 0.2**2 + 0.4**2])
    np.testing.assert_allclose(props.inertia, np.diag(want), atol=1e-9)


def test_sphere_converges_to_two_fifths() -> None:
    ball = to_mesh(manifold3d.Manifold.sphere(0.5, 256))
    props = mass_properties(ball, 1.0)
    # 256 segments: the polyhedron is within 2e-4 of the ball
    assert props.inertia[0, 0] == pytest.approx(0.4 * props.mass * 0.25, rel=1e-3)


def test_rotation_and_shift_covariance() -> None:
    mesh = toy_cabinet_twin(0).parts[0].mesh
    rot, shift = rotation_from_rotvec(np.array([0.3, -1.0, 0.5])), np.array([100.0, -20.0, 3.0])
    moved = dataclasses.replace(mesh, vertices=mesh.vertices @ rot.T + shift)
    a, b = mass_properties(mesh, 600.0), mass_properties(moved, 600.0)
    np.testing.assert_allclose(b.center, rot @ a.center + shift, atol=1e-10)
    np.testing.assert_allclose(b.inertia, rot @ a.inertia @ rot.T, atol=1e-9)


def test_parallel_axis() -> None:
    props = mass_properties(to_mesh(box((0, 0, 0), (0.6, 0.4, 0.02))), 600.0)
    # a plate about its edge: m w^2 / 3 (+ thickness)
    want = props.mass * (0.6**2 + 0.02**2) / 3
    assert moment_about_axis(props, np.array([0, 1.0, 0]), np.zeros(3)) == pytest.approx(want)


def test_thin_plate_keeps_the_triangle_inequality() -> None:
    props = mass_properties(to_mesh(box((0, 0, 0), (1, 1, 1e-4))), 600.0)
    assert triangle_gap(props.inertia) > 0


def test_inverted_mesh_is_refused() -> None:
    mesh = to_mesh(box((0, 0, 0), (1, 1, 1)))
    with pytest.raises(ExportError, match="outward faces"):
        mass_properties(PartMesh(mesh.vertices, mesh.faces[:, ::-1], mesh.colors), 600.0)


def test_servo_scales_with_the_unit_of_length() -> None:
    """The same cabinet in centimetres has the same frequencies and the same step."""
    metres, centi = toy_cabinet_twin(3), _scaled(100.0)
    a, b = physics_of(metres), physics_of(centi)
    assert a.step == b.step
    for index in (1, 2, 3):
        assert a.joints[index].frequency == pytest.approx(b.joints[index].frequency, rel=1e-6)


def _scaled(factor: float):  # type: ignore[no-untyped-def]
    twin = toy_cabinet_twin(3)
    parts = []
    for part in twin.parts:
        joint, limits = part.joint, part.limits
        if joint is not None:
            joint = dataclasses.replace(joint, origin=joint.origin * factor)
            if joint.kind == "prismatic":
                joint = dataclasses.replace(joint, value=joint.value * factor)
                limits = (limits[0] * factor, limits[1] * factor)
        mesh = dataclasses.replace(part.mesh, vertices=part.mesh.vertices * factor)
        parts.append(dataclasses.replace(part, mesh=mesh, joint=joint, limits=limits))
    return dataclasses.replace(twin, parts=tuple(parts), meters_per_unit=1 / factor)
