"""Silhouettes: edges of posed meshes that photos see before background, and the masks beside them.

What a photo knows best about a shape is where it ends: the outline of a mask is good to a fraction
of a pixel, a fitted depth to a cell. Every edge of a mesh between a face that looks at the camera
and one that looks away, with nothing of the object behind it, ought to lie on that outline.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.boards.facets import paired
from part2gs_robotics.boards.outlines import crossings
from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.model.se3 import apply

BETWEEN = 2.0  # pixels between points of an edge; with 4 masks are met as well
WITHIN = 1.0  # pixels from an edge into the object, where it must be the first surface
BESIDE = 1.5  # pixels from an edge outward, where nothing of the object may be
HIDDEN = 0.01  # of the size behind what is seen a pixel in: hidden; 0.05 bends more faces


@dataclass(frozen=True)
class Shape:
    """A closed mesh, with the edges [E, 2] between faces [E, 2].

    Attributes:
        vertices: [V, 3] in the part's frame.
        faces: [F, 3] outward.
        edges: [E, 2] vertices of every edge.
        sides: [E, 2] its two faces.
    """

    vertices: F64
    faces: I64
    edges: I64
    sides: I64


@dataclass(frozen=True)
class Gaps:
    """N points of silhouettes.

    Attributes:
        ends: [N, 2] vertices of the edge that a point is on.
        shares: [N, 2] how much of each the point is; they sum to 1.
        slopes: [N, 3] pixels that the point moves outward per unit of each coordinate of the part.
        pixels: [N] from the point outward to the outline of the mask.
        lengths: [N] pixels of edge that the point stands for.
    """

    ends: I64
    shares: F64
    slopes: F64
    pixels: F64
    lengths: F64


def shape_of(vertices: F64, faces: I64) -> Shape:
    """Return a closed mesh with its edges."""
    edges, sides = paired(faces)
    return Shape(vertices, faces, edges, sides)


def gaps(shape: Shape, camera_from_part: F64, K: F64, alpha: NDArray[np.uint8], first: F32,
         size: float) -> Gaps:
    """Return how far the silhouette of a part in one photo is from the outline of its mask.

    Args:
        shape: of the part.
        camera_from_part: [4, 4].
        K: [3, 3] pixels.
        alpha: [H, W] coverage 0..255.
        first: [H, W] depth of all posed parts, infinite beside them.
        size: of the object, scene units.
    """
    corners = apply(camera_from_part, shape.vertices)
    tri = corners[shape.faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    facing = (normals * tri[:, 0]).sum(1) < 0
    rim = facing[shape.sides[:, 0]] != facing[shape.sides[:, 1]]
    rim &= (corners[shape.edges][:, :, 2] > 0).all(1)
    ends, sides = shape.edges[rim], shape.sides[rim]
    front = np.where(facing[sides[:, 0]], sides[:, 0], sides[:, 1])
    edge, share, length = _spread(_pixels(corners[ends], K))
    points = np.einsum("nk,nki->ni", share, corners[ends][edge])
    pixels = _pixels(points, K)
    outward = _outward(_pixels(corners[ends], K)[edge], pixels,
                       _pixels(tri[front].mean(1), K)[edge])
    found = np.flatnonzero(_free(pixels, outward, points[:, 2], first, size))
    gap = crossings(alpha, pixels[found], outward[found])
    found, gap = found[np.isfinite(gap)], gap[np.isfinite(gap)]
    slopes = _slopes(points[found], outward[found], K) @ camera_from_part[:3, :3]
    return Gaps(ends[edge[found]], share[found], slopes, gap, length[found])


def together(found: Sequence[Gaps]) -> Gaps:
    """Return the points of several photos as one."""
    return Gaps(*(np.concatenate([getattr(one, name) for one in found])
                  for name in ("ends", "shares", "slopes", "pixels", "lengths")))


def _pixels(points: F64, K: F64) -> F64:
    """Return [..., 2] where points [..., 3] before a camera are seen."""
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = points[..., :2] / points[..., 2:]
    return np.asarray(flat * K[[0, 1], [0, 1]] + K[:2, 2])


def _spread(ends: F64) -> tuple[I64, F64, F64]:
    """Return points along edges [E, 2, 2] in pixels: edge, both shares, and length of each."""
    whole = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    count = np.maximum(np.ceil(whole / BETWEEN), 1).astype(int)
    edge = np.repeat(np.arange(len(ends)), count)
    order = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (order + 0.5) / count[edge]
    return edge, np.stack([1 - share, share], 1), (whole / count)[edge]


def _outward(ends: F64, pixels: F64, inner: F64) -> F64:
    """Return [N, 2] unit, across edges [N, 2, 2], away from the face that is seen."""
    way = ends[:, 1] - ends[:, 0]
    across = np.stack([-way[:, 1], way[:, 0]], 1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    return np.asarray(-np.sign(((inner - pixels) * across).sum(1))[:, None] * across)


def _free(pixels: F64, outward: F64, depth: F64, first: F32, size: float) -> Mask:
    """Return [N] whether points are seen, with nothing of the object right beside them."""
    inner = np.floor(pixels - WITHIN * outward).astype(int)
    outer = np.floor(pixels + BESIDE * outward).astype(int)
    limit = first.shape[::-1]
    out = np.asarray(((inner >= 0) & (outer >= 0) & (inner < limit) & (outer < limit)).all(1))
    seen, beside = (first[at[out, 1], at[out, 0]] for at in (inner, outer))
    out[out] = np.isinf(beside) & (depth[out] < seen + HIDDEN * size)
    return out


def _slopes(points: F64, outward: F64, K: F64) -> F64:
    """Return [N, 3] pixels outward per unit of each coordinate of the camera."""
    x, y, z = points.T
    along_x = K[0, 0] / z[:, None] * np.stack([np.ones_like(x), np.zeros_like(x), -x / z], 1)
    along_y = K[1, 1] / z[:, None] * np.stack([np.zeros_like(x), np.ones_like(x), -y / z], 1)
    return np.asarray(outward[:, :1] * along_x + outward[:, 1:] * along_y)
