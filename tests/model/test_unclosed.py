"""Meshes that are no solids never end the process: manifold3d is not shown what it breaks on."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from part2gs_robotics.model.solids import defect, to_manifold
from part2gs_robotics.model.twin import PartMesh

CUBE = manifold3d.Manifold.cube((1, 1, 1)).to_mesh64()
FACES = np.array(CUBE.tri_verts, np.int64)
POINTS = np.array(CUBE.vert_properties[:, :3], np.float64)


def mesh(faces: np.ndarray) -> PartMesh:
    return PartMesh(POINTS, faces, np.zeros((len(POINTS), 3), np.uint8))


def test_a_closed_mesh_stays_one() -> None:
    assert defect(mesh(FACES)) is None
    assert to_manifold(mesh(FACES)).volume() == pytest.approx(1.0)


@pytest.mark.parametrize("broken", [
    FACES[:-1], np.vstack([FACES, FACES[:1]]), np.vstack([FACES, FACES[:2]]),
    np.vstack([FACES[1:], FACES[:1, ::-1]])], ids=["hole", "twice", "two twice", "turned"])
def test_an_unclosed_mesh_is_told(broken: np.ndarray) -> None:
    assert to_manifold(mesh(broken)).status() != manifold3d.Error.NoError
    assert "NotManifold" in str(defect(mesh(broken)))
