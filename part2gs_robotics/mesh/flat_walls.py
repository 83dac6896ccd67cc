"""Flat walls: noisy walls of a closed mesh laid flat, and their edges made sharp.

Made things are boards. A grid rounds their edges by a cell and leaves half a cell of noise on their
faces; planes are fitted to all of a wall, so they lie far truer. Vertices move onto the planes of
the faces around them, onto the line of two and the corner of three; the rest of the surface, what
is curved or small, stays as it is. Nothing is cut or joined, so a closed mesh stays closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from part2gs_robotics.mesh.surface import arrays, flaw, vertices_apart
from part2gs_robotics.mesh.walls import Facets, facets, main_directions, weighted_quantile
from part2gs_robotics.model.arrays import F64, I64, Mask

if TYPE_CHECKING:
    from manifold3d import Manifold

CELLS = 0.75  # cells of the grid: half of one is its noise
DEPTH = 0.004  # of the size: noise of fitted depth on walls without texture
ALONG = np.cos(np.deg2rad(25.0))  # smoothed normals of a wall against its direction
TILT = np.cos(np.deg2rad(8.0))  # a fitted wall against its direction: more is a curved surface
BEVEL = np.cos(np.deg2rad(62.0))  # half a right angle and noise: a rounded edge is of its two walls
NEAR = 1.5  # noises from a plane within which a face may be of it
ASKEW = 2.0  # noises that a face turned away by a right angle counts as
WALL = 0.004  # of the surface: smaller planes are details that the grid cannot tell
PATCH = 6.0  # noises across: smaller connected patches of a wall are chance
FARTHEST = 3.0  # noises a vertex may move: a corner of three walls is rounded by so much
LEVEL = np.cos(np.deg2rad(15.0))  # half of a wall looks its way; a ring of a curved surface aslant
MOSTLY = 0.5  # of the area or the rim of a patch: rounded edges are the rest of a wall's
FREE = 0.25  # singular value of a vertex' planes below which they are one: 15 degrees apart
FLAT = 0.05  # cells: what lies so near to a wall is one with it
SMOOTHINGS = 3  # rings of faces over which normals are averaged
Pairs = tuple[NDArray[np.intp], NDArray[np.intp]]  # of faces
NOWHERE = np.zeros((0, 3))  # no points at all


@dataclass(frozen=True)
class Walls:
    """P planes: normals [P, 3] outward, offsets [P], so that normal . x = offset."""

    normals: F64
    offsets: F64

    def __len__(self) -> int:
        """Return the number of planes."""
        return len(self.offsets)


def with_flat_walls(surface: Manifold, voxel: float, size: float, kept: F64 = NOWHERE) -> Manifold:
    """Return a closed surface with flat walls and few faces, itself where that would not close.

    Args:
        surface: noisy, from a grid.
        voxel: size of the grid's cells, scene units.
        size: diagonal of the object, scene units.
        kept: [N, 3] walls at these points stay noisy.
    """
    import manifold3d

    vertices, faces = arrays(surface)
    flat = flattened(vertices, faces, noise_of(voxel, size), kept)
    mesh = manifold3d.Mesh64(np.ascontiguousarray(flat), np.ascontiguousarray(faces, np.uint64))
    found = vertices_apart(manifold3d.Manifold(mesh).simplify(FLAT * voxel), voxel)
    return found if flaw(found) is None else surface


def noise_of(voxel: float, size: float) -> float:
    """Return how far a surface of a grid lies off a wall, scene units."""
    return max(CELLS * voxel, DEPTH * size)


def flattened(vertices: F64, faces: I64, noise: float, kept: F64 = NOWHERE) -> F64:
    """Return the vertices [V, 3] with those of walls on the planes of their walls.

    Args:
        vertices: [V, 3] of a closed mesh.
        faces: [F, 3] outward.
        noise: how far faces of a wall may lie off it, as the vertices.
        kept: [N, 3] walls at these points stay as they are.
    """
    smooth = _smoothed(vertices, faces)
    walls = walls_of(smooth, main_directions(facets(vertices, faces)), noise)
    if not len(walls):
        return vertices
    owner = _owners(smooth, _neighbours(faces), walls, noise)
    if len(kept):
        near = KDTree(kept).query(smooth.centers)[0] < FARTHEST * noise
        owner[np.isin(owner, owner[near])] = -1
    return _moved(vertices, faces, walls, owner, noise)


def walls_of(smooth: Facets, axes: F64, noise: float) -> Walls:
    """Return the planes of a surface's walls.

    Args:
        smooth: faces with smoothed normals.
        axes: [D, 3] directions, either way, that walls may face.
        noise: how far a wall's faces may lie off it.
    """
    found: list[tuple[F64, float]] = []
    least = WALL * float(smooth.areas.sum())
    for direction in np.concatenate([axes, -axes]):
        mine = smooth.normals @ direction > ALONG
        found += _along(direction, smooth.centers[mine], smooth.areas[mine], noise, least)
    return Walls(np.array([n for n, _ in found]).reshape(-1, 3), np.array([d for _, d in found]))


def _along(direction: F64, centers: F64, areas: F64, noise: float, least: float,
           ) -> list[tuple[F64, float]]:
    """Return planes of faces that look along a direction, the largest first."""
    order = np.argsort(centers @ direction, kind="stable")
    centers, areas = centers[order], areas[order].copy()
    offsets, found = centers @ direction, []
    ends = np.searchsorted(offsets, offsets + 2 * noise, side="right")
    while areas.sum() > least:
        total = np.concatenate([[0.0], np.cumsum(areas)])
        held = total[ends] - total[:-1]
        best = int(held.argmax())
        if held[best] < least:
            break
        own = slice(best, int(ends[best]))
        found.append(_fitted(direction, centers[own], areas[own]))
        areas[own] = 0.0
    return found


def _fitted(direction: F64, centers: F64, areas: F64) -> tuple[F64, float]:
    """Return normal and offset of the plane of faces, weighed by area."""
    arms = centers - (areas @ centers) / areas.sum()
    normal = np.linalg.eigh((arms * areas[:, None]).T @ arms)[1][:, 0]
    normal *= np.sign(normal @ direction)
    if normal @ direction < TILT:
        normal = direction
    return normal, weighted_quantile(centers @ normal, areas, 0.5)


def _owners(smooth: Facets, pairs: Pairs, walls: Walls, noise: float) -> I64:
    """Return [F] the wall of every face, -1 where it is of none."""
    faces, normals, areas = len(smooth.areas), smooth.normals, smooth.areas
    best, owner = np.full(faces, np.inf), np.full(faces, -1, np.int64)
    for number in range(len(walls)):
        normal = walls.normals[number]
        gap = np.abs(smooth.centers @ normal - walls.offsets[number]) / noise
        along = normals @ normal
        cost = np.where((gap < NEAR) & (along > BEVEL), gap + ASKEW * (1 - along), np.inf)
        owner[cost < best] = number
        best = np.minimum(best, cost)
    one, two = pairs
    linked = (owner[one] == owner[two]) & (owner[one] >= 0)
    links = coo_matrix((np.ones(linked.sum()), (one[linked], two[linked])), (faces, faces))
    count, patch = connected_components(links, directed=False)
    along = (normals * walls.normals[owner]).sum(1)
    level = np.bincount(patch, areas * (along > LEVEL), count)
    whole = np.bincount(patch, areas, count)
    owner[((whole < (PATCH * noise) ** 2) | (level < MOSTLY * whole))[patch]] = -1
    owner[_going_on(owner, patch, normals, walls, pairs)[patch]] = -1
    return owner


def _going_on(owner: I64, patch: I64, normals: F64, walls: Walls, pairs: Pairs) -> Mask:
    """Return per patch whether the surface around it goes on as it looks: curved, no wall.

    A wall ends at edges or steps; the flat cap of a ball is bounded by more of the ball.
    """
    rim, on = np.zeros(patch.max() + 1), np.zeros(patch.max() + 1)
    for own, beside in (pairs, pairs[::-1]):
        out = (patch[own] != patch[beside]) & (owner[own] >= 0)
        own, beside = own[out], beside[out]
        alike = (normals[beside] * walls.normals[owner[own]]).sum(1) > ALONG
        np.add.at(rim, patch[own], 1.0)
        step = (owner[beside] >= 0) & (
            (walls.normals[owner[own]] * walls.normals[owner[beside]]).sum(1) > TILT)
        np.add.at(on, patch[own], alike & ~step)
    return np.asarray(on > MOSTLY * np.maximum(rim, 1.0))


def _moved(vertices: F64, faces: I64, walls: Walls, owner: I64, noise: float) -> F64:
    """Return the vertices moved the shortest way onto all walls around each."""
    of_wall = np.repeat(owner, 3) >= 0
    pairs = np.unique(np.stack([faces.ravel()[of_wall], np.repeat(owner, 3)[of_wall]], 1), axis=0)
    first = np.searchsorted(pairs[:, 0], np.arange(len(vertices) + 1))
    count, out = np.diff(first), vertices.copy()
    for planes in range(1, int(count.max(initial=0)) + 1):
        own = np.flatnonzero(count == planes)
        index = pairs[first[own][:, None] + np.arange(planes), 1]  # [n, planes]
        normals = walls.normals[index]
        left = walls.offsets[index] - np.einsum("npc,nc->np", normals, vertices[own])
        u, s, vt = np.linalg.svd(normals, full_matrices=False)
        # Planes that are nearly one say nothing across their common direction.
        share = np.where(s > FREE, np.einsum("npk,np->nk", u, left) / np.maximum(s, FREE), 0.0)
        step = np.einsum("nkc,nk->nc", vt, share)
        near = np.linalg.norm(step, axis=1) < FARTHEST * noise
        out[own[near]] += step[near]
    return out


def _smoothed(vertices: F64, faces: I64) -> Facets:
    """Return all faces, normals averaged over the rings around each, weighed by area."""
    tri = vertices[faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    one, two = _neighbours(faces)
    ring = coo_matrix((np.ones(2 * len(one)), (np.r_[one, two], np.r_[two, one])),
                      (len(faces),) * 2).tocsr()
    for _ in range(SMOOTHINGS):
        normals = normals + ring @ normals
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Facets(tri.mean(1), np.asarray(normals / np.maximum(length, 1e-300)), areas)


def _neighbours(faces: I64) -> Pairs:
    """Return the pairs of faces that share an edge of a closed mesh."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T)
    face = np.tile(np.arange(len(faces)), 3)[order]
    same = (np.diff(edges[order], axis=0) == 0).all(1)
    return face[:-1][same], face[1:][same]
