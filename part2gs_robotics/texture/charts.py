"""Charts: a part's faces in groups that lie flat on a plane each, without covering each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.texture.chart_kernels import grow, overlapping

TINY = 1e-12  # of the size squared: such a face has no normal that float64 could tell
FLAT = 0.9  # cosine of 25 degrees: faces that tell the direction of a chart
STEP = 32  # texels: sides of an atlas are multiples, so that halved copies stay whole five times
STEEPEST = 0.5  # cosine of 60 degrees: a texel covers twice its area there, not more


@dataclass(frozen=True)
class Charts:
    """Faces laid flat.

    Attributes:
        chart: [F] number of every face's chart.
        flat: [F, 3, 2] corners in texels, from the lower corner of the chart's own rectangle.
        sizes: [C, 2] width and height of every chart's rectangle in texels; width >= height.
    """

    chart: I64
    flat: F64
    sizes: F64


def make_charts(mesh: PartMesh, texel: float) -> Charts:
    """Return charts of all faces of a mesh, of which no two faces of one chart share a texel.

    Args:
        mesh: any triangles.
        texel: side of a texel, scene units.
    """
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    size = float(np.ptp(mesh.vertices, axis=0).max())
    whole = double > TINY * size**2
    normals = np.where(whole[:, None], cross / np.where(whole, double, 1.0)[:, None], 0.0)
    order = np.argsort(-double, kind="stable")
    beside = neighbours(mesh.faces)
    chart, count = np.full(len(mesh.faces), -1, np.int64), 0
    flat, sizes = np.zeros((len(mesh.faces), 3, 2)), list[F64]()
    while (chart < 0).any():
        fresh = np.full(len(chart), -1, np.int64)
        directions = grow(normals, double, beside, order, (chart >= 0), fresh, FLAT, STEEPEST)
        for members, way in zip(_groups(fresh), directions, strict=True):
            laid, extent = _lay(corners[members], way)
            keep = ~overlapping(laid / texel, np.ceil(extent / texel).astype(np.int64) + 1)
            flat[members[keep]] = laid[keep] / texel
            chart[members[keep]] = count
            sizes.append(extent / texel)
            count += 1
    return Charts(chart, flat, np.array(sizes))


def neighbours(faces: I64) -> I64:
    """Return [F, 3] the face beyond every edge (corner i to i + 1), -1 where there is none."""
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2), axis=1)
    keys = ends[:, 0] * (int(faces.max()) + 1) + ends[:, 1]
    order = np.argsort(keys, kind="stable")
    out = np.full(len(keys), -1, np.int64)
    first = np.flatnonzero(keys[order][:-1] == keys[order][1:])
    one, two = order[first], order[first + 1]
    out[one], out[two] = two // 3, one // 3
    return out.reshape(-1, 3)


def _groups(chart: I64) -> list[I64]:
    """Return the faces of every chart, in the order of the charts."""
    order = np.argsort(chart, kind="stable")
    order = order[chart[order] >= 0]
    return np.split(order, np.flatnonzero(np.diff(chart[order])) + 1) if len(order) else []


def _lay(corners: F64, way: F64) -> tuple[F64, F64]:
    """Return [n, 3, 2] corners on the plane across `way`, in the least rectangle from 0, and it."""
    import cv2

    side = np.eye(3)[int(np.argmin(np.abs(way)))]
    u = np.cross(side, way)
    u /= np.linalg.norm(u)
    axes = np.stack([u, np.cross(way, u)])
    flat = (corners - corners[0, 0]) @ axes.T
    scale = max(float(np.abs(flat).max()), 1e-300)
    angle = np.deg2rad(cv2.minAreaRect((flat.reshape(-1, 2) / scale).astype(np.float32))[2])
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    flat = flat @ turn.T
    width, height = np.ptp(flat.reshape(-1, 2), axis=0)
    if height > width:  # lying: shelves are filled by height
        flat = flat[..., ::-1] * np.array([1.0, -1.0])
    flat = flat - flat.reshape(-1, 2).min(0)
    return flat, np.asarray(flat.reshape(-1, 2).max(0))


def pack(sizes: F64, gutter: int, widest: int) -> tuple[NDArray[np.int64], tuple[int, int]] | None:
    """Return the place of every rectangle on shelves and the atlas (width, height).

    Args:
        sizes: [C, 2] in texels.
        gutter: texels kept free round every rectangle.
        widest: longest side of the atlas in texels.

    Returns:
        [C, 2] lower corners, inside the gutter; None where they do not fit.
    """
    outer = np.ceil(sizes).astype(np.int64) + 2 * gutter
    area = float(outer.prod(1).sum())
    least = max(int(np.sqrt(area)), int(outer[:, 0].max()))
    for width in range(min(whole_steps(least), widest), widest + 1, STEP):
        places, height = _shelves(outer, width)
        if height <= min(width, widest) or (width == widest and height <= widest):
            return places + gutter, (width, min(whole_steps(height), widest))
    return None


def whole_steps(length: int) -> int:
    """Return the least side of an atlas that is not below a length in texels."""
    return -(-length // STEP) * STEP


def _shelves(outer: I64, width: int) -> tuple[I64, int]:
    """Return [C, 2] places, highest rectangles first, and the height used."""
    places, x, y, shelf = np.zeros_like(outer), 0, 0, 0
    for one in np.lexsort((np.arange(len(outer)), -outer[:, 0], -outer[:, 1])):
        w, h = outer[one]
        if w > width:
            return places, 1 << 30
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        places[one] = x, y
        x, shelf = x + w, max(shelf, h)
    return places, int(y + shelf)
