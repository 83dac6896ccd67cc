"""Surface: a sampled solid -> one closed, simplified triangle mesh."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.errors import MeshError
from part2gs_robotics.model.solids import arrays
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.fuse import TRUNCATION

if TYPE_CHECKING:
    from manifold3d import Manifold


MOST_FACES = 20_000  # per part: what a simulator and a browser page still take
FIRST_TOLERANCE = 0.25  # voxels: below the noise of the surface, which is about half a voxel
APART = 0.02  # voxels between vertices that would merge: visible to float32, invisible to the eye
SAME = 1e-4  # voxels: vertices so near are one in float32, and to readers that merge within 1e-8
LEVELS = (0.0, 0.013, -0.013, 0.037, -0.037)  # voxels: another level parts edges that just touch


def closed_surface(solid: Solid, name: str, clearance: float) -> Manifold:
    """Return the closed surface of a solid, watertight by every test.

    Args:
        solid: signed distances.
        name: the part, for messages.
        clearance: voxels between parts; simplification may use half of it.

    Raises:
        MeshError: no level gives a closed surface.
    """
    reasons = []
    for level in LEVELS:
        surface = _simplify(_march(solid, level), solid.grid.voxel, clearance)
        reason = flaw(surface)
        if reason is None:
            return surface
        reasons.append(reason)
    raise MeshError(f"{name}: marching cubes gave no closed surface at {len(LEVELS)} levels "
                    f"({reasons[0]}). Needed a watertight solid; change --resolution a little.")


def _march(solid: Solid, level: float) -> Manifold:
    """Return the level set of a padded grid, outward."""
    import manifold3d
    from skimage.measure import marching_cubes

    padded = np.pad(solid.values, 1, constant_values=np.float32(-TRUNCATION))
    vertices, faces, _, _ = marching_cubes(padded, level, gradient_direction="ascent")
    world = solid.grid.lo + solid.grid.voxel * (vertices.astype(np.float64) - 1.0)
    a, b, c = (world[faces[:, i]] for i in range(3))
    if np.einsum("ij,ij->", a, np.cross(b, c)) < 0:
        faces = faces[:, ::-1]
    return manifold3d.Manifold(manifold3d.Mesh64(
        np.ascontiguousarray(world), np.ascontiguousarray(faces, np.uint64)))


def flaw(surface: Manifold) -> str | None:
    """Return why a surface would not be watertight in a float32 file, None if it is."""
    import manifold3d
    import trimesh

    if surface.status() != manifold3d.Error.NoError:
        return f"manifold3d says {surface.status().name}"
    if surface.volume() <= 0:
        return f"volume {surface.volume():.3g} is not positive"
    raw = surface.to_mesh64()
    points = np.asarray(raw.vert_properties)[:, :3].astype(np.float32)
    mesh = trimesh.Trimesh(points, np.asarray(raw.tri_verts, np.int64), process=True)
    return None if mesh.is_watertight else "trimesh finds an edge without exactly two faces"


def _simplify(surface: Manifold, voxel: float, clearance: float) -> Manifold:
    """Return the surface with fewer faces, the last one that is still watertight.

    The tolerance stays below half the clearance, so that simplified neighbours cannot touch.
    """
    best, most = surface, max(0.5 * clearance, 0.05)
    tolerances = [t for t in (FIRST_TOLERANCE, 0.35, 0.5) if t <= most] or [most]
    for tolerance in tolerances:
        fewer = vertices_apart(surface.simplify(tolerance * voxel), voxel)
        if flaw(fewer) is not None:
            continue
        best = fewer
        if best.num_tri() <= MOST_FACES:
            break
    return best


def vertices_apart(surface: Manifold, voxel: float) -> Manifold:
    """Return the surface with vertices that a float32 file would merge moved apart.

    Two sheets may touch in a point: a valid manifold, but not once equal vertices are merged.
    """
    import manifold3d
    from scipy.spatial import cKDTree

    points, faces = arrays(surface)
    scatter = np.random.default_rng(0)  # tells twins apart whose neighbours are the same
    for _ in range(8):
        # The two nearest, for where thousands lie within a point all pairs would fill gigabytes.
        near = cKDTree(points).query(points, 2, distance_upper_bound=SAME * voxel)[0]
        twins = np.flatnonzero(np.isfinite(near[:, 1]))
        if not len(twins):
            break
        ring = np.zeros_like(points)
        number = np.zeros(len(points))
        for i in range(3):  # mean of the neighbours: into each sheet's own side
            np.add.at(ring, faces[:, i], points[faces[:, (i + 1) % 3]])
            np.add.at(number, faces[:, i], 1.0)
        inward = ring[twins] / number[twins, None] - points[twins]
        inward += 0.1 * voxel * scatter.standard_normal(inward.shape)
        length = np.linalg.norm(inward, axis=1, keepdims=True)
        points[twins] += APART * voxel * inward / np.maximum(length, 1e-12 * voxel)
    else:
        return surface
    return manifold3d.Manifold(manifold3d.Mesh64(points, np.ascontiguousarray(faces, np.uint64)))
