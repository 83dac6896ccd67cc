"""First Gaussians of a fit: flat discs on the visual hull."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.gaussians import SH_C0, Gaussians
from part2gs_robotics.hollows import find_lids, hollow_points
from part2gs_robotics.hull import Hull
from part2gs_robotics.hull_points import point_colors, surface_points
from part2gs_robotics.scene import StateViews

F64 = NDArray[np.float64]

OVERLAP = 0.7  # disc standard deviation / spacing: neighbours cover each other, edges stay sharp
FLATNESS = 0.15  # thickness / radius of a disc: thin, yet seen when a camera looks along it
START_OPACITY = 0.7  # high enough to hide the far side, low enough to fade where wrong
LID_OPACITY = 0.03  # a probable lid must let the light of the hollow behind it through
HOLLOW_OPACITY = 0.4  # several candidates share a sight line; the images decide which one grows
HOLLOW_SHARE = 0.5  # candidates inside hollows per surface disc, at most


def hull_gaussians(hull: Hull, state: StateViews, count: int, seed: int) -> Gaussians:
    """Return about `count` discs on the hull, coloured by the views that see them.

    The disc's third axis is the surface normal and is FLATNESS times as thick as the others.
    """
    points, normals = surface_points(hull, count, seed)
    colors, spread = point_colors(hull, state, points, normals)
    lids = find_lids(spread)
    surface = discs(points, normals, colors, _spacing(points), np.where(lids, LID_OPACITY,
                                                                        START_OPACITY))
    inner, inner_colors = hollow_points(hull, state, points, lids, int(HOLLOW_SHARE * count), seed)
    if len(inner) < 2:
        return surface
    ball = discs(inner, np.tile([0.0, 0.0, 1.0], (len(inner), 1)), inner_colors, _spacing(inner),
                 np.full(len(inner), HOLLOW_OPACITY), flatness=1.0)
    return joined(surface, ball)


def joined(a: Gaussians, b: Gaussians) -> Gaussians:
    """Return the Gaussians of both."""
    return Gaussians(*(np.concatenate([getattr(a, f.name), getattr(b, f.name)])
                       for f in fields(Gaussians)))


def discs(points: F64, normals: F64, colors: NDArray[np.float32], spacing: F64, opacities: F64,
          flatness: float = FLATNESS) -> Gaussians:
    """Return flat Gaussians of radius OVERLAP * spacing [N], normal to `normals` [N, 3]."""
    radius = OVERLAP * np.asarray(spacing, float)
    log_scales = np.log(np.stack([radius, radius, flatness * radius], 1))
    logits = np.log(opacities / (1 - opacities))
    f32 = np.float32
    return Gaussians(
        means=points.astype(f32), quats=quats_from_normals(normals).astype(f32),
        log_scales=log_scales.astype(f32), logit_opacities=logits.astype(f32),
        sh0=((colors - 0.5) / SH_C0).astype(f32), shN=np.zeros((len(points), 0, 3), f32))


def quats_from_normals(normals: F64) -> F64:
    """Return [N, 4] wxyz: the shortest turns that carry z onto unit normals [N, 3]."""
    x, y, z = normals.T
    quats = np.stack([1 + z, -y, x, np.zeros_like(x)], 1)  # half-way quaternion of z and the normal
    flip = z < -1 + 1e-9  # opposite to z: any half turn about a horizontal axis
    quats[flip] = [0, 1, 0, 0]
    return np.asarray(quats / np.linalg.norm(quats, axis=1, keepdims=True))


def _spacing(points: F64) -> F64:
    """Return [N] mean distance to the three nearest neighbours (3DGS's start scale)."""
    from scipy.spatial import cKDTree

    near = cKDTree(points).query(points, k=min(4, len(points)))[0][:, 1:]
    return np.asarray(np.clip(near.mean(1), np.median(near) * 0.3, np.median(near) * 2))
