"""Kernels of flat faces: what other photos say of a photo's pixels at given depths."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

STEP = 0.3  # of the colour range: a clearer edge than this needs no closer match
NOTHING = 2.0  # colour of what is no object: farther from any colour than colours are


@inlined
def _at(images: F32, v: int, u: float, w: float, out: F64) -> bool:
    """Fill the colour of image v at a place (pixel centres at whole numbers); False: outside."""
    if not (u >= 0.0 and w >= 0.0 and u < images.shape[2] - 1 and w < images.shape[1] - 1):
        return False
    i, j = int(w), int(u)
    fw, fu = w - i, u - j
    w00, w01, w10, w11 = (1 - fw) * (1 - fu), (1 - fw) * fu, fw * (1 - fu), fw * fu
    for c in range(3):
        out[c] = (w00 * images[v, i, j, c] + w01 * images[v, i, j + 1, c]
                  + w10 * images[v, i + 1, j, c] + w11 * images[v, i + 1, j + 1, c])
    return True


@inlined
def _off(one: F64, other: F64, p: int) -> float:
    """Return the greatest difference of a colour from the p-th of others."""
    most = 0.0
    for c in range(3):
        most = max(most, abs(one[c] - other[p, c]))
    return most


@inlined
def _inside(hull: F32, lo: F64, voxel: float, slack: float, x: float, y: float, z: float) -> bool:
    i, j, k = (int((x - lo[0]) / voxel + 0.5), int((y - lo[1]) / voxel + 0.5),
               int((z - lo[2]) / voxel + 0.5))
    if x < lo[0] or y < lo[1] or z < lo[2]:
        return False
    if i >= hull.shape[0] or j >= hull.shape[1] or k >= hull.shape[2]:
        return False
    return bool(hull[i, j, k] > -slack)


@kernel
def rims(eye: F64, rays: F64, colors: F64, depths: F64, facing: Mask, near: I64, cams: F64,
         images: F32, hull: F32, lo: F64, voxel: float, slack: float, out: F64) -> None:
    """Fill how well other photos see the rim of a region where depths put it.

    Args:
        eye: [3] of the photo's camera.
        rays: [2, P, 3] per unit of depth, of places inside the rim and beside them outside it.
        colors: [2, P, 3] there; NOTHING outside the object.
        depths: [O, 2, P] tried, 0 = none.
        facing: [O, N] which other photos look at that side of it.
        near: [N] which other photos.
        cams: [V, 3, 4] pixels (whole numbers at their centres) from world, of all photos.
        images: [V, H, W, 3] of all, NOTHING outside the object.
        hull: [X, Y, Z] above -slack where the object may be.
        lo: [3] centre of its first voxel.
        voxel: its edge.
        slack: scene units.
        out: [O] sums over places and photos of 0..1, the match of both sides.
    """
    for_each(len(depths), _rims_at, (eye, rays, colors, depths, facing, near, cams, images, hull,
                                     lo, voxel, slack, out))


@inlined
def _rims_at(o: int, eye: F64, rays: F64, colors: F64, depths: F64, facing: Mask, near: I64,
             cams: F64, images: F32, hull: F32, lo: F64, voxel: float, slack: float,
             out: F64) -> None:
    here, there = np.zeros(3), np.zeros(3)
    for p in range(rays.shape[1]):
        s, t = depths[o, 0, p], depths[o, 1, p]
        x, y, z = (eye[0] + s * rays[0, p, 0], eye[1] + s * rays[0, p, 1],
                   eye[2] + s * rays[0, p, 2])
        if s <= 0.0 or t <= 0.0 or not _inside(hull, lo, voxel, slack, x, y, z):
            continue
        a, b, c = (eye[0] + t * rays[1, p, 0], eye[1] + t * rays[1, p, 1],
                   eye[2] + t * rays[1, p, 2])
        step = 0.0
        for k in range(3):
            step = max(step, abs(colors[0, p, k] - colors[1, p, k]))
        step = step if step < STEP else STEP
        ends = colors[1, p, 0] >= NOTHING
        for n in range(len(near)):
            if not facing[o, n]:
                continue
            m = cams[near[n]]
            d = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            e = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c + m[2, 3]
            if not _at(images, near[n], (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / d,
                       (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / d, here):
                continue
            if not _at(images, near[n], (m[0, 0] * a + m[0, 1] * b + m[0, 2] * c + m[0, 3]) / e,
                       (m[1, 0] * a + m[1, 1] * b + m[1, 2] * c + m[1, 3]) / e, there):
                continue
            mine = _off(here, colors[0], p) / step
            if ends:
                match = min(1.0, _off(there, colors[0], p) / step) - 2.0 * mine
            else:
                match = 1.0 - mine - _off(there, colors[1], p) / step
            out[o] += max(match, 0.0)


@kernel
def looked_past(eye: F64, rays: F64, colors: F64, depths: F64, facing: Mask, near: I64, cams: F64,
                images: F32, maps: F32, behind: float, alike: float, hull: F32, lo: F64,
                voxel: float, slack: float, out: F64) -> None:
    """Fill how often other photos look past a region where depths put it.

    Args:
        eye: [3] of the photo's camera.
        rays: [P, 3] per unit of depth, of places within the region.
        colors: [P, 3] there.
        depths: [O, P] tried, 0 = none.
        facing: [O, N] which other photos look at that side of it.
        near: [N] which other photos.
        cams: [V, 3, 4] pixels (whole numbers at their centres) from world, of all photos.
        images: [V, H, W, 3] of all, NOTHING outside the object.
        maps: [V, H, W] depth of what they see, 0 = unknown: nearer than a place, it may hide it.
        behind: so much nearer.
        alike: colours that differ by less are one.
        hull: [X, Y, Z] above -slack where the object may be.
        lo: [3] centre of its first voxel.
        voxel: its edge.
        slack: scene units.
        out: [O] sums over places and photos; a place outside the hull counts for all.
    """
    for_each(len(depths), _looked_past_at, (eye, rays, colors, depths, facing, near, cams, images,
                                            maps, behind, alike, hull, lo, voxel, slack, out))


@inlined
def _looked_past_at(o: int, eye: F64, rays: F64, colors: F64, depths: F64, facing: Mask,
                    near: I64, cams: F64, images: F32, maps: F32, behind: float, alike: float,
                    hull: F32, lo: F64, voxel: float, slack: float, out: F64) -> None:
    height, width = images.shape[1], images.shape[2]
    for p in range(len(rays)):
        t = depths[o, p]
        x, y, z = eye[0] + t * rays[p, 0], eye[1] + t * rays[p, 1], eye[2] + t * rays[p, 2]
        if t <= 0.0 or not _inside(hull, lo, voxel, slack, x, y, z):
            out[o] += facing[o].sum()
            continue
        for n in range(len(near)):
            if not facing[o, n]:
                continue
            m = cams[near[n]]
            d = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
            u = (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]) / d + 0.5
            w = (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]) / d + 0.5
            if not (u >= 0.0 and w >= 0.0 and u < width and w < height):
                continue
            i, j = int(w), int(u)
            most = 0.0
            for c in range(3):
                most = max(most, abs(images[near[n], i, j, c] - colors[p, c]))
            if most < alike or (maps[near[n], i, j] > 0.0 and maps[near[n], i, j] < d - behind):
                continue
            out[o] += 1.0
