"""Atlas: the charts of a part in one picture, and the point of the surface under every texel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, I64
from part2gs_robotics.model.twin import PartMesh, corner_normals
from part2gs_robotics.texture.chart_kernels import cover
from part2gs_robotics.texture.charts import (
    STEEPEST,
    Charts,
    make_charts,
    pack,
    whole_steps,
)

GUTTER = 4  # texels round a chart: two halvings of the picture do not mix neighbours
COARSER = 1.08  # step in which texels grow until a part fits


@dataclass(frozen=True)
class Atlas:
    """Where the faces of a part are in its picture.

    Attributes:
        uv: [F, 3, 2] float32, 0..1 from the lower left corner.
        shape: height and width in texels.
        pixels: [T] flat index of the texels that a face covers.
        points: [T, 3] float32 their points on the surface, world frame at state 0.
        normals: [T, 3] float32 unit, of the calmed surface.
        charts: [T] chart of every such texel.
    """

    uv: F32
    shape: tuple[int, int]
    pixels: I64
    points: F32
    normals: F32
    charts: I64


def make_atlas(mesh: PartMesh, texel: float, widest: int) -> Atlas:
    """Return the atlas of a mesh; texels grow where they would not fit.

    Args:
        mesh: any triangles.
        texel: wanted side of a texel, scene units.
        widest: longest side of the picture, texels; more only if not even a texel of each chart
            would fit.
    """
    charts = make_charts(mesh, texel)
    least = (2 * GUTTER + 1) * math.ceil(math.sqrt(len(charts.sizes)))
    widest = max(widest, whole_steps(least))
    area = float((charts.sizes + 2 * GUTTER).prod(1).sum())
    scale = max(1.0, math.sqrt(area) / widest / COARSER)
    packed = pack(charts.sizes / scale, GUTTER, widest)
    while packed is None:
        scale *= COARSER
        packed = pack(charts.sizes / scale, GUTTER, widest)
    places, (width, height) = packed
    placed = charts.flat / scale + places[charts.chart][:, None]
    return _filled(mesh, charts, placed, (height, width))


def _filled(mesh: PartMesh, charts: Charts, placed: NDArray[np.float64],
            shape: tuple[int, int]) -> Atlas:
    owner = np.full(shape, -1, np.int32)
    weights = np.zeros((*shape, 3), np.float32)
    cover(placed, owner, weights)
    pixels = np.flatnonzero(owner.ravel() >= 0)
    faces, bary = owner.ravel()[pixels], weights.reshape(-1, 3)[pixels]
    corners = mesh.vertices[mesh.faces].astype(np.float32)
    points = np.einsum("tc,tci->ti", bary, corners[faces])
    # A reconstructed wall may be crumpled; the real one, whose colour is asked for, is not.
    calm = corner_normals(mesh.vertices, mesh.faces, STEEPEST).astype(np.float32)
    normals = np.einsum("tc,tci->ti", bary, calm[faces])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    uv = placed / np.array([shape[1], shape[0]])
    uv[..., 1] = 1.0 - uv[..., 1]  # pictures count rows from the top
    return Atlas(uv.astype(np.float32), shape, pixels, points, normals, charts.chart[faces])
