"""What benchmarks/raster.py draws: a box of flat Gaussians, cameras around it, photos of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from toy_scenes import viewmats_around

from part2gs_robotics.model.gaussians import SH_C0, Gaussians, Splats
from part2gs_robotics.model.scene import Camera, StateViews
from part2gs_robotics.render.cpu import render

F64 = NDArray[np.float64]

DISTANCE = 2.0  # of the camera from a box of about 1 unit: it fills half of the image's width
FOCAL = 1.2  # image sides
PHOTOS = 4  # views of the timed training iteration; one is drawn per step


def box_surface(count: int) -> Splats:
    """Return flat Gaussians on a box, float32."""
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (count, 3))
    face = rng.integers(0, 3, count)
    means[np.arange(count), face] = np.sign(means[np.arange(count), face])
    # Neighbours on the surface are 1 / sqrt(count) apart; a fitted scene overlaps about this much.
    scales = np.exp(rng.normal(np.log(1.6 / np.sqrt(count)), 0.4, (count, 3))) * [0.3, 1, 1]
    arrays = (means * [0.5, 0.35, 0.4], rng.normal(size=(count, 4)), scales,
              rng.uniform(0.2, 1, count), rng.uniform(0, 1, (count, 3)))
    return Splats(*(a.astype(np.float32) for a in arrays))


def intrinsics(side: int) -> F64:
    """Return K of a square image."""
    return np.array([[FOCAL * side, 0, side / 2], [0, FOCAL * side, side / 2], [0, 0, 1]])


def corner_view() -> F64:
    """Return camera_from_world of a camera that looks down at a corner of the box."""
    a, b = 0.5, 0.4
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[2, 3] = pitch @ yaw, DISTANCE
    return viewmat


def camera(viewmat: F64, side: int) -> Camera:
    """Return a camera of square images from its [4, 4] camera_from_world."""
    return Camera(viewmat, intrinsics(side), side, side)


def gaussians_of(cloud: Splats, seed: int = 0) -> Gaussians:
    """Return a cloud as a fit starts from it: opacities within reach, colours a little wrong."""
    rng = np.random.default_rng(seed)
    solid = np.clip(cloud.opacities, 0.01, 0.99)  # logits stay finite
    wrong = cloud.colors + rng.normal(0, 0.1, cloud.colors.shape)
    return Gaussians(cloud.means, cloud.quats, np.log(cloud.scales), np.log(solid / (1 - solid)),
                     ((wrong - 0.5) / SH_C0).astype(np.float32),
                     np.zeros((len(cloud), 0, 3), np.float32))


def photos(cloud: Splats, side: int, count: int = PHOTOS) -> StateViews:
    """Return photos of a cloud from all around, straight colours with alpha."""
    viewmats = viewmats_around(count, DISTANCE)
    images = np.zeros((count, side, side, 3), np.uint8)
    alphas = np.zeros((count, side, side), np.uint8)
    for image, alpha, viewmat in zip(images, alphas, viewmats, strict=True):
        drawn = render(cloud, camera(viewmat, side))
        straight = drawn.color / np.maximum(drawn.alpha, 1e-3)[..., None]  # 1e-3: below one level
        image[:], alpha[:] = np.rint(255 * np.clip(straight, 0, 1)), np.rint(255 * drawn.alpha)
    return StateViews(images, alphas, np.repeat(intrinsics(side)[None], count, 0), viewmats, None,
                      tuple(f"{k:04d}.png" for k in range(count)), np.zeros(count, np.bool_))
