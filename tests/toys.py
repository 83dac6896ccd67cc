"""A toy world of textured boxes: shapes, cameras, exact images, Gaussians, straight lines."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np


@dataclass(frozen=True)
class Box:
    """A textured box lo..hi, placed by `move` (world_from_box); seed picks its colours."""

    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    seed: int = 0
    move: np.ndarray = field(default_factory=lambda: np.eye(4))


def angle(a, b):
    """Return rad between two unit directions without sign."""
    return float(np.arccos(min(1.0, abs(a @ b))))


def paint(points, seed):
    """Return [n, 3] colours in 0.1..0.9: smooth waves of a fifth of a unit and longer."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(3, 4, 3)) * 9.0
    phases = rng.uniform(0, 2 * np.pi, (3, 4))
    mixed = np.sin(np.einsum("cwi,ni->ncw", waves, points) + phases).mean(-1)
    return np.clip(rng.uniform(0.35, 0.65, 3) + 0.6 * mixed, 0.1, 0.9)


def cameras(count, side, centre, diag):
    """Return Ks and viewmats of cameras spread over a sphere that see all of the object."""
    k = np.arange(count) + 0.5
    up, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    level = np.sqrt(1 - up**2)
    views = []
    for way in np.stack([level * np.cos(turn), level * np.sin(turn), up], 1):
        z = -way
        x = np.cross(z, [0.0, 0, 1])
        x /= np.linalg.norm(x)
        rot = np.stack([x, np.cross(z, x), z])
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rot, -rot @ (centre + 2.2 * diag * way)
        views.append(view)
    focal = 1.9 * side
    K = np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1.0]])
    return np.repeat(K[None], count, 0), np.stack(views)


def cast(boxes, Ks, viewmats, side, look=paint):
    """Return StateViews of boxes, ray-cast exactly, with depth; look: colours of (points, seed)."""
    from part2gs_robotics.model.scene import StateViews

    rows, cols = np.mgrid[:side, :side] + 0.5
    count = len(Ks)
    depth = np.full((count, side * side), np.inf)
    color = np.zeros((count, side * side, 3))
    for v in range(count):
        local = np.stack([(cols - Ks[v][0, 2]) / Ks[v][0, 0], (rows - Ks[v][1, 2]) / Ks[v][1, 1],
                          np.ones_like(rows)], -1).reshape(-1, 3)
        for box in boxes:
            box_from_camera = np.linalg.inv(viewmats[v] @ box.move)
            ways, eye = local @ box_from_camera[:3, :3].T, box_from_camera[:3, 3]
            near, far = (np.array([box.lo, box.hi])[:, None] - eye) / (ways + 1e-300)
            enter, leave = np.minimum(near, far).max(1), np.maximum(near, far).min(1)
            hit = (enter < leave) & (enter > 0) & (enter < depth[v])
            depth[v, hit] = enter[hit]
            color[v, hit] = look(eye + ways[hit] * enter[hit, None], box.seed)
    shape = (count, side, side)
    solid = np.isfinite(depth).reshape(shape)
    return StateViews(
        np.round(color * 255).astype(np.uint8).reshape(*shape, 3), solid.astype(np.uint8) * 255,
        Ks, viewmats, np.where(solid, depth.reshape(shape), 0).astype(np.float32),
        tuple(f"{v:03d}" for v in range(count)), np.zeros(count, bool))


def gaussians_of(boxes, spacing):
    """Return flat Gaussians on the faces of the boxes, and [N] the box of each."""
    from part2gs_robotics.model import se3
    from part2gs_robotics.model.gaussians import SH_C0, Gaussians

    means, quats, logs, colors, owner = [], [], [], [], []
    for b, box in enumerate(boxes):
        lo, hi = np.array(box.lo), np.array(box.hi)
        for axis in range(3):
            steps = []
            for i in range(3):
                n = max(1, round((hi[i] - lo[i]) / spacing))
                steps.append(lo[i] + (np.arange(n) + 0.5) * (hi[i] - lo[i]) / n)
            steps[axis] = np.array([lo[axis], hi[axis]])
            points = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
            flat = np.full(3, np.log(0.6 * spacing))
            flat[axis] = np.log(0.02 * spacing)
            means.append(se3.apply(box.move, points))
            quats.append(np.tile(se3.quat_from_rotation(box.move[:3, :3]), (len(points), 1)))
            logs.append(np.tile(flat, (len(points), 1)))
            colors.append(paint(points, box.seed))
            owner.append(np.full(len(points), b))
    total = sum(map(len, means))
    return Gaussians(
        np.concatenate(means).astype(np.float32), np.concatenate(quats).astype(np.float32),
        np.concatenate(logs).astype(np.float32), np.full(total, 3.0, np.float32),
        ((np.concatenate(colors) - 0.5) / SH_C0).astype(np.float32),
        np.zeros((total, 0, 3), np.float32)), np.concatenate(owner)


def drawn(gaussians, Ks, viewmats, side):
    """Return StateViews of Gaussians, drawn by the product's own renderer."""
    from part2gs_robotics.model.scene import Camera, StateViews
    from part2gs_robotics.render.dispatch import render

    images, alphas = [], []
    for K, view in zip(Ks, viewmats, strict=True):
        out = render(gaussians.splats, Camera(view, K, side, side))
        straight = out.color / np.maximum(out.alpha, 1e-3)[..., None]
        images.append(np.round(np.clip(straight, 0, 1) * 255).astype(np.uint8))
        alphas.append(np.round(out.alpha * 255).astype(np.uint8))
    return StateViews(np.stack(images), np.stack(alphas), Ks, viewmats, None,
                      tuple(str(v) for v in range(len(Ks))), np.zeros(len(Ks), bool))


def scene_of(states):
    """Return the Scene of two StateViews."""
    from part2gs_robotics.model.scene import Scene

    return Scene(Path("toy"), "toy", states)


def depth_maps_of_images(state):
    """Return the depth images of a state as first-surface depth."""
    from part2gs_robotics.evidence.depth_maps import DepthMaps

    return DepthMaps(state.depths, state.alphas, state.Ks, state.viewmats)


def study_of(scene, gaussians, config=None):
    """Return the study of a scene and the Gaussians of both states."""
    from part2gs_robotics.evidence.canonical import canonical
    from part2gs_robotics.evidence.study import gather

    return gather(canonical(scene, tuple(gaussians), config), config)


def seen_surface(boxes, views=24, side=96, voxel=0.02):
    """Return surfels, landing grid (reach 0.1) and depth maps of ray-cast boxes within -1..1.6."""
    from part2gs_robotics.evidence.landing import build_landing
    from part2gs_robotics.evidence.surfels import fuse_surfels

    state = cast(boxes, *cameras(views, side, np.array([0.4, 0.3, 0.3]), 1.7), side)
    maps = depth_maps_of_images(state)
    surfels = fuse_surfels(maps, state.images, voxel, stride=1)
    lo, hi = np.full(3, -0.8), np.full(3, 1.5)
    land = build_landing(surfels, np.zeros(len(surfels)), maps, (lo, hi), voxel, 0.1)
    return SimpleNamespace(surfels=surfels, land=land, maps=maps, state=state)


def pictures(lines, Ks, viewmats, rng, noise=0.05):
    """Return Segments of 3D lines [N, 2, 3] in all cameras, ends off by `noise` pixels."""
    from part2gs_robotics.evidence.segments import Segments
    from part2gs_robotics.model.se3 import apply

    ends, views = [], []
    for v, (K, view) in enumerate(zip(Ks, viewmats, strict=True)):
        local = apply(view, lines.reshape(-1, 3)) @ K.T
        ends.append((local[:, :2] / local[:, 2:]).reshape(-1, 2, 2))
        views.append(np.full(len(lines), v))
    ends = np.concatenate(ends)
    return Segments(ends + noise * rng.normal(size=ends.shape), np.concatenate(views), Ks, viewmats)


def photographed(boxes, Ks, viewmats, side, fine=3):
    """Return StateViews of boxes like `cast`, every pixel the mean of fine x fine rays."""
    from dataclasses import replace

    sharp = Ks.copy()
    sharp[:, :2] *= fine
    state = cast(boxes, sharp, viewmats, fine * side)
    blocks = (len(Ks), side, fine, side, fine)
    alphas = state.alphas.reshape(blocks).mean((2, 4))
    lit = (state.images * (state.alphas[..., None] > 0)).reshape(*blocks, 3).mean((2, 4))
    images = lit / np.maximum(alphas / 255, 1e-3)[..., None]
    return replace(state, images=np.round(images).clip(0, 255).astype(np.uint8),
                   alphas=np.round(alphas).astype(np.uint8), Ks=Ks,
                   depths=state.depths[:, fine // 2::fine, fine // 2::fine])
