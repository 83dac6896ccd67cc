"""Outlines: planes moved until a part's edges lie on the outlines of the masks.

Fitted surfaces know a wall to a cell; the outline of a mask tells where its edge is to a tenth of a
pixel, in every photo that sees the edge before background. An edge moves with its two planes, so
all outlines together are one small linear system in their offsets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from part2gs_robotics.boards.facets import neighbours
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.model.arrays import F64, I64

REACH = 4.0  # pixels across an edge that are looked at: a cell is one to two
STEP = 0.5  # pixels between them
SPREAD = 0.02  # of a part's size between points of an edge
CLEAR = 1.0  # pixel at which a distance counts a half: other edges lie as near
KNOWN = 0.5  # cells: how well fitted surfaces know an offset
PER_PIXEL = 30.0  # points of one edge that say no more than one: all of them err alike
ROUNDS = 6  # of moving planes and looking again
APART = 0.25  # cells between planes after that: their order must not change
STRAIGHT = 1e-3  # 1 - cosine between a face and its plane
MOST_STEP = 1.5  # cells that a plane may move in all


@dataclass(frozen=True)
class Outlines:
    """Masks of one state, for one part.

    Attributes:
        alphas: [V, H, W] coverage 0..255.
        projections: [V, 3, 4] pixels_from_part, before the division by depth.
    """

    alphas: NDArray[np.uint8]
    projections: F64


@dataclass(frozen=True)
class _Rims:
    """N points on convex edges between two planes.

    Attributes:
        points: [N, 3].  planes: [N, 2] numbers of both planes.  normals: [N, 2, 3] of the planes.
        signs: [N, 2] 1 where the face looks along its plane's normal, else -1.
    """

    points: F64
    planes: I64
    normals: F64
    signs: F64


@dataclass(frozen=True)
class _Gaps:
    """M pixels from edges to outlines, and how they shrink as both planes move [M, 2]."""

    planes: I64
    slopes: F64
    pixels: F64


def drawn_to_outlines(families: Sequence[Family], vertices: F64, faces: I64,
                      states: Sequence[Outlines], voxel: float) -> tuple[Family, ...]:
    """Return the families with planes moved so that edges meet the outlines of masks.

    Args:
        families: planes of a part.
        vertices: [V, 3] of the solid between them.
        faces: [F, 3] outward.
        states: masks of both states, with cameras in the part's frame.
        voxel: size of cells, scene units.
    """
    first = np.cumsum([0, *(len(f.offsets) for f in families)])
    rims, moved = _rims(families, first, vertices, faces), np.zeros(first[-1])
    if not len(rims.points):
        return tuple(families)
    lifts = _lifts(rims.normals)
    for _ in range(ROUNDS):
        steps = np.einsum("nij,nj->ni", lifts, moved[rims.planes])
        now = replace(rims, points=rims.points + steps)
        gaps = [_gaps(now, lifts, state.alphas[v], state.projections[v])
                for state in states for v in range(len(state.alphas))]
        moved = np.clip(moved + _solved(gaps, moved, voxel), -MOST_STEP * voxel, MOST_STEP * voxel)
    return tuple(replace(f, offsets=_in_order(f.offsets, moved[a:b], voxel))
                 for f, a, b in zip(families, first[:-1], first[1:], strict=True))


def _rims(families: Sequence[Family], first: I64, vertices: F64, faces: I64) -> _Rims:
    """Return points on the convex edges between faces of two planes."""
    tri = vertices[faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    plane, own = np.full(len(faces), -1), np.zeros_like(normals)
    for family, start in zip(families, first, strict=False):
        along = np.abs(normals @ family.normal) > 1 - STRAIGHT
        gaps = np.abs((tri[along].mean(1) @ family.normal)[:, None] - family.offsets)
        plane[along], own[along] = start + gaps.argmin(1), family.normal
    one, two = neighbours(faces)
    edge = (plane[one] >= 0) & (plane[two] >= 0)
    edge &= np.abs((own[one] * own[two]).sum(1)) < 1 - STRAIGHT
    edge &= (normals[one] * (tri[two].mean(1) - tri[one].mean(1))).sum(1) < 0  # convex
    one, two = one[edge], two[edge]
    shared = (faces[one][:, :, None] == faces[two][:, None, :]).any(2)
    ends = vertices[faces[one][shared].reshape(-1, 2)]
    spread = SPREAD * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    count = np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / spread).astype(int)
    index = np.repeat(np.arange(len(ends)), count)
    order = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    share = ((order + 0.5) / count[index])[:, None]
    both = np.stack([one, two], 1)[index]
    signs = np.sign((own * normals).sum(1))
    return _Rims(ends[index, 0] * (1 - share) + ends[index, 1] * share, plane[both], own[both],
                 signs[both])


def _lifts(normals: F64) -> F64:
    """Return [N, 3, 2] how points of edges move with the offsets of their two planes."""
    gram = normals @ normals.transpose(0, 2, 1)
    return np.asarray(normals.transpose(0, 2, 1) @ np.linalg.inv(gram))


def _gaps(rims: _Rims, lifts: F64, alpha: NDArray[np.uint8], projection: F64) -> _Gaps:
    """Return how far edges that one view sees as outlines are from the outline of its mask."""
    camera = -np.linalg.solve(projection[:, :3], projection[:, 3])
    to_camera = camera - rims.points
    front = rims.signs * np.einsum("npc,nc->np", rims.normals, to_camera) > 0
    depth = rims.points @ projection[2, :3] + projection[2, 3]
    seen = np.flatnonzero((front[:, 0] != front[:, 1]) & (depth > 0))
    points, normals = rims.points[seen], rims.normals[seen]
    pixels = (points @ projection[:2, :3].T + projection[:2, 3]) / depth[seen, None]
    flow = (projection[:2, :3] - pixels[:, :, None] * projection[2, :3]) / depth[seen, None, None]
    way = np.einsum("nij,nj->ni", flow, np.cross(normals[:, 0], normals[:, 1]))
    across = np.stack([-way[:, 1], way[:, 0]], 1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    back = np.where(front[seen, 0], 1, 0)  # the face that looks away points out of the outline
    rows = np.arange(len(seen))
    outward = rims.signs[seen][rows, back][:, None] * normals[rows, back]
    across *= np.sign((across * np.einsum("nij,nj->ni", flow, outward)).sum(1))[:, None]
    gap = crossings(alpha, pixels, across)
    found = np.isfinite(gap)
    slopes = np.einsum("ni,nij,njk->nk", across, flow, lifts[seen])
    return _Gaps(rims.planes[seen][found], slopes[found], gap[found])


def crossings(alpha: NDArray[np.uint8], pixels: F64, across: F64) -> F64:
    """Return [N] pixels from points, outward, to where coverage falls below a half; inf if not.

    Args:
        alpha: [H, W] coverage 0..255.
        pixels: [N, 2].
        across: [N, 2] unit, outward.
    """
    along = np.arange(-REACH, REACH + STEP / 2, STEP)
    places = pixels[:, None] + along[:, None] * across[:, None] - 0.5  # array indices
    cover = map_coordinates(alpha, places[..., ::-1].reshape(-1, 2).T, np.float64, 1,
                            mode="constant", cval=127.5).reshape(len(pixels), len(along)) - 127.5
    inner, outer = cover[:, :-1], cover[:, 1:]
    falls = (inner > 0) & (outer < 0)
    at = along[:-1] + STEP * inner / np.where(falls, inner - outer, 1.0)
    at = np.where(falls, at, np.inf)
    return np.asarray(np.take_along_axis(at, np.abs(at).argmin(1)[:, None], 1)[:, 0])


def _solved(gaps: Sequence[_Gaps], moved: F64, voxel: float) -> F64:
    """Return [P] how far planes move on: least squares, what lies far counting little."""
    planes, slopes, pixels = (np.concatenate([getattr(g, name) for g in gaps])
                              for name in ("planes", "slopes", "pixels"))
    weight = 1.0 / (1.0 + (pixels / CLEAR) ** 2) ** 2 / PER_PIXEL
    known = 1.0 / (KNOWN * voxel) ** 2
    matrix, right = np.eye(len(moved)) * known, -known * moved
    for i in (0, 1):
        np.add.at(right, planes[:, i], weight * slopes[:, i] * pixels)
        for j in (0, 1):
            np.add.at(matrix, (planes[:, i], planes[:, j]), weight * slopes[:, i] * slopes[:, j])
    return np.asarray(np.linalg.solve(matrix, right))


def _in_order(offsets: F64, moved: F64, voxel: float) -> F64:
    """Return moved offsets of a family, still increasing."""
    out = offsets + moved
    for i in range(1, len(out)):
        out[i] = max(out[i], out[i - 1] + APART * voxel)
    return out
