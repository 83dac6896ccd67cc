"""First Gaussians of a fit: flat discs on the visual hull and on the surface inside its hollows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.config import FitConfig, StereoConfig
from part2gs_robotics.evidence.depth_maps import MIN_VIEWS, DepthMaps, observe
from part2gs_robotics.evidence.surfels import Surfels, fuse_surfels, sampling
from part2gs_robotics.fit.hull import Hull
from part2gs_robotics.fit.hull_points import point_colors, surface_points
from part2gs_robotics.fit.stereo import mapped, stereo_depths
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.plain.plain_faces import with_plain_faces
from part2gs_robotics.plain.planes import Bounds

OVERLAP = 0.7  # disc standard deviation / spacing: neighbours cover each other, edges stay sharp
FLATNESS = 0.15  # thickness / radius of a disc: thin, yet seen when a camera looks along it
START_OPACITY = 0.7  # high enough to hide the far side, low enough to fade where wrong
HOLLOW_SHARE = 0.7  # discs in hollows per disc on the hull, at most: what stands open needs as many
NEAR = 0.012  # of the diagonal: above the stereo's error in three pixels out of four
FACES = 215  # pixels of the object in photos whose even regions are looked at
SPACING = 0.008  # of the diagonal: about as dense as 14,000 discs on the hull of a box


def first_gaussians(hull: Hull, state: StateViews, config: FitConfig,
                    stereo: StereoConfig | None = None) -> Gaussians:
    """Return discs on the hull where it is the surface, and on the surface inside its hollows.

    Depth images say where the surface is, else stereo does: hull points that several views look
    past are lids over hollows and are left out, surface points far from the rest are put in.

    Args:
        hull: of this state.
        state: photos, with or without depth images.
        config: number of discs on the whole hull, most Gaussians in all, seed of their places.
        stereo: None = the standard preset; without stereo and depth images the hull is all.
    """
    stereo = stereo or StereoConfig()
    points, normals = surface_points(hull, config.start_gaussians, config.seed)
    if state.depths is None and not stereo.stereo:
        colors, _ = point_colors(hull, state, points, normals)
        return discs(points, normals, colors, _spacing(points))
    maps, photos = _depths(hull, state, stereo)
    voxel, _ = sampling(maps, SPACING * hull.diagonal)
    near = max(NEAR * hull.diagonal, 1.2 * voxel)
    seen = observe(points, maps, near)
    lid = (seen.free >= MIN_VIEWS) & (seen.free > 2 * seen.surface)
    if lid.all():  # contradictory depth: the hull alone is a safer start
        lid[:] = False
    points, normals = points[~lid], normals[~lid]
    colors, _ = point_colors(hull, state, points, normals)
    inner = _hollows(maps, photos, points, hull, near)
    room = min(config.max_gaussians - len(points), int(HOLLOW_SHARE * config.start_gaussians))
    pick = np.random.default_rng(config.seed).permutation(len(inner))[:max(room, 0)]
    inner = inner.select(np.sort(pick))
    points = np.concatenate([points, inner.points])
    normals = np.concatenate([normals, inner.normals])
    colors = np.concatenate([colors, inner.colors.astype(np.float32)])
    return discs(points, normals, colors, _spacing(points))


def _depths(hull: Hull, state: StateViews, stereo: StereoConfig,
            ) -> tuple[DepthMaps, NDArray[np.uint8]]:
    """Return depth maps of the training views and their photos, from depth images or stereo."""
    used = np.flatnonzero(~state.held_out)
    if state.depths is not None:
        maps = DepthMaps(state.depths[used], state.alphas[used], state.Ks[used],
                         state.viewmats[used])
        return maps, state.images[used]
    maps, views = stereo_depths(state, hull, stereo)
    if stereo.plain_faces:
        larger = mapped(state, stereo.stereo_views, FACES)
        bounds = Bounds(hull.values, hull.lo, hull.voxel, hull.diagonal)
        maps = with_plain_faces(state, bounds, maps, larger)
    straight = views.colors / np.maximum(views.alphas, 1e-3)[..., None]  # 1e-3: below one level
    return maps, np.rint(255 * np.clip(straight, 0, 1)).astype(np.uint8)


def _hollows(maps: DepthMaps, photos: NDArray[np.uint8], known: F64, hull: Hull,
             near: float) -> Surfels:
    """Return surface points farther than `near` from known ones, on which depth maps agree."""
    voxel, stride = sampling(maps, SPACING * hull.diagonal)
    surfels = fuse_surfels(maps, photos, voxel, min_views=MIN_VIEWS, stride=stride)
    seen = observe(surfels.points, maps, near)
    fine = (seen.surface >= MIN_VIEWS) & (seen.free < 0.5 * seen.surface)
    far = cKDTree(known).query(surfels.points)[0] > near
    return surfels.select(np.asarray(fine & far))


def discs(points: F64, normals: F64, colors: NDArray[np.float32], spacing: F64) -> Gaussians:
    """Return flat Gaussians of radius OVERLAP * spacing [N], normal to `normals` [N, 3]."""
    radius = OVERLAP * np.asarray(spacing, float)
    log_scales = np.log(np.stack([radius, radius, FLATNESS * radius], 1))
    logits = np.full(len(points), np.log(START_OPACITY / (1 - START_OPACITY)))
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
    near = cKDTree(points).query(points, k=min(4, len(points)))[0][:, 1:]
    return np.asarray(np.clip(near.mean(1), np.median(near) * 0.3, np.median(near) * 2))
