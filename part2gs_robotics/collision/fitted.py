"""Fitted pieces: the faces of a hull moved in to where the part is, rather than round its bumps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import arrays
from part2gs_robotics.runtime.jit import inlined, kernel

if TYPE_CHECKING:
    from manifold3d import Manifold

REAL = 0.8  # empty space that is worth losing a unit of the part: pieces may have 3 % to 5 % of it
WORTH = 2e-3  # of what is real in a piece, that a cut gains: less is hardly seen and costs corners
KEPT = 0.5  # of what is real in a piece, at least: one more cut would leave a crumb
SIDES = 20  # directions that are tried, largest face first; a box has six
ALIKE = np.cos(np.deg2rad(8.0))  # normals of faces that are one side: noise of a wall's hull
LEVELS = 24  # per direction, closer to each other near the face
DEEPEST = 0.6  # of the piece's thickness, of those levels; the other side has its own
STEPS = np.linspace(0.0, 1.0, LEVELS + 1)[1:]  # of the way to the deepest level, squared
CUTS = 16  # of a piece; most end after 3


def fitted(piece: Manifold, part: Manifold) -> Manifold:
    """Return a convex piece without slices that are mostly empty.

    A hull touches the outermost bumps of a noisy or bent wall, and bridges what is beside them. Of
    all slices along its sides the one whose empty space outweighs most what is real in it goes,
    and so on.

    Args:
        piece: convex.
        part: of which the piece is a share; what lies in the piece is real, the rest is empty.

    Source: chosen by benchmarks/pieces.py.
    """
    real = part ^ piece
    most = KEPT * float(real.volume())
    for _ in range(CUTS):
        cut = _best_cut(piece, real)
        if cut is None:
            break
        normal, level = (-cut[0]).tolist(), -cut[1]
        less = real.trim_by_plane(normal, level)
        if less.volume() < most:
            break
        piece, real = piece.trim_by_plane(normal, level), less
    return piece


def _best_cut(piece: Manifold, real: Manifold) -> tuple[F64, float] | None:
    """Return (normal, level) of the plane above which most is gained, None if hardly anything."""
    hull, own = (vertices[faces] for vertices, faces in map(arrays, (piece, real)))
    sides = _sides(hull)
    reach = hull.reshape(-1, 3) @ sides.T
    top, bottom = reach.max(0)[:, None], reach.min(0)[:, None]
    levels = np.hstack([top, top - (top - bottom) * DEEPEST * STEPS**2])
    gains = _gains(hull, own, sides, levels)
    side, near = np.unravel_index(int(gains.argmax()), gains.shape)
    if gains[side, near] <= WORTH * float(real.volume()):
        return None
    around = levels[side, max(near - 1, 0):near + 2]
    finer = np.linspace(around.max(), around.min(), LEVELS)[None]
    best = int(_gains(hull, own, sides[side][None], finer).argmax())
    return sides[side], float(finer[0, best])


def _gains(hull: F64, own: F64, sides: F64, levels: F64) -> F64:
    """Return [S, L] what cutting at levels gains: empty space, less what is lost of a part."""
    return volumes_above(hull, sides, levels) - (1.0 + REAL) * volumes_above(own, sides, levels)


def _sides(tri: F64) -> F64:
    """Return [S, 3] unit normals of a solid's sides, those of almost one direction as one."""
    areas = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(areas, axis=1)
    areas, length = areas[length > 0], length[length > 0]
    out = list[F64]()
    while len(length) and len(out) < SIDES:
        alike = areas @ areas[length.argmax()] >= ALIKE * length * length.max()
        mean = areas[alike].sum(0)
        out.append(mean / np.linalg.norm(mean))
        areas, length = areas[~alike], length[~alike]
    return np.array(out)


def volumes_above(tri: F64, normals: F64, levels: F64) -> F64:
    """Return [S, L] volumes of a closed solid above levels along directions, exact.

    It is the surface integral of the height above the level (divergence theorem).

    Args:
        tri: [F, 3, 3] triangles, outward.
        normals: [S, 3] unit.
        levels: [S, L] normal.x, scene units.
    """
    areas = 0.5 * np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]) @ normals.T
    return np.asarray(_summed(np.sort(tri @ normals.T, axis=1), areas, levels))


@kernel
def _summed(heights: F64, areas: F64, levels: F64) -> F64:
    """Return `volumes_above` from sorted heights [F, 3, S] of corners and areas [F, S]."""
    out = np.zeros(levels.shape)
    for f in range(areas.shape[0]):
        for s in range(areas.shape[1]):
            low, middle, high = heights[f, 0, s], heights[f, 1, s], heights[f, 2, s]
            for k in range(levels.shape[1]):
                level = levels[s, k]
                out[s, k] += areas[f, s] * _mean_above(high - level, middle - level, low - level)
    return out


@inlined
def _mean_above(high: float, middle: float, low: float) -> float:
    """Return the mean over a triangle of max(0, height), from the heights of its sorted corners."""
    if high <= 0.0:
        return 0.0
    whole = (high + middle + low) / 3.0
    if low >= 0.0:
        return whole
    if middle > 0.0:
        return whole + (-low) ** 3 / (3.0 * (high - low) * (middle - low))
    return high**3 / (3.0 * (high - middle) * (high - low))
