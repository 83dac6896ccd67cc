"""Evidence: which points a state's depth maps saw free, on a surface, or never."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

BACKGROUND_ALPHA = 0.1  # below: nothing there; 0.1..0.5 are mixed edge pixels that vote for nothing
SOLID_ALPHA = 0.5  # a pixel at least half covered has a first surface, less is an edge
ROUGH = 3.0  # times the median of a state: a rough fit is that deep everywhere, a pane is not
PANE = 5  # pixels: rims of outlines, mixed of near and far, are narrower
MIN_VIEWS = 3  # that must agree about a place: one or two may share an error, or see a floater
CHUNK = 2048  # points per task: one view's depth map stays in the core's cache meanwhile


@dataclass(frozen=True)
class DepthMaps:
    """First-surface depth of every view of one state.

    Attributes:
        depths: [V, H, W] float32 z-depth in scene units, 0 = background or unknown.
        alphas: [V, H, W] coverage, uint8 0..255 or float32 0..1; tells background from unknown.
        Ks: [V, 3, 3] pixels, centres at (i + 0.5, j + 0.5).
        viewmats: [V, 4, 4] camera_from_world, OpenCV axes.
        images: [V, H, W, 3] uint8, what the photos show; None = unknown.
    """

    depths: NDArray[np.float32]
    alphas: NDArray[np.uint8] | NDArray[np.float32]
    Ks: NDArray[np.float64]
    viewmats: NDArray[np.float64]
    images: NDArray[np.uint8] | None = None

    @cached_property
    def coded_depths(self) -> NDArray[np.float32]:
        """[V, H, W] depth with +inf where a view sees background and NaN where it knows nothing."""
        limit = BACKGROUND_ALPHA * (255.0 if self.alphas.dtype == np.uint8 else 1.0)
        empty = np.where(self.alphas < limit, np.float32(np.inf), np.float32(np.nan))
        return np.where(self.depths > 0, self.depths, empty).astype(np.float32)

    @cached_property
    def projections(self) -> NDArray[np.float64]:
        """[V, 3, 4] pixels_from_world, before the division by depth."""
        return np.ascontiguousarray(self.Ks @ self.viewmats[:, :3])

    def __len__(self) -> int:
        """Number of views."""
        return len(self.depths)


@dataclass(frozen=True)
class Observation:
    """How many views said what about every point, each [N] int32.

    A view votes only if all four pixels around the projection agree, so a point beside a
    silhouette is not called free by a pixel that looks past the edge.

    Attributes:
        free: views that see past the point (to the background, or depth > z + tolerance).
        surface: views whose first surface is within the tolerance of the point.
        hidden: views whose first surface is in front of the point by more than the tolerance.
        outside: views in which the point falls on background; these count in `free` too.
    """

    free: NDArray[np.int32]
    surface: NDArray[np.int32]
    hidden: NDArray[np.int32]
    outside: NDArray[np.int32]


@kernel
def _vote(depth: NDArray[np.floating], row: int, col: int, near: float, far: float) -> int:
    """Return 0 free, 1 surface, 2 hidden, 3 background, 4 no vote, from 2 x 2 pixels.

    Background pixels hold +inf, unknown ones NaN, which fails every comparison.
    """
    a, b = depth[row, col], depth[row, col + 1]
    c, d = depth[row + 1, col], depth[row + 1, col + 1]
    if a == np.inf and b == np.inf and c == np.inf and d == np.inf:
        return 3
    if a > far and b > far and c > far and d > far:
        return 0
    if a < near and b < near and c < near and d < near:
        return 2
    if (near <= a <= far) or (near <= b <= far) or (near <= c <= far) or (near <= d <= far):
        return 1
    return 4


@kernel
def _observe(points: NDArray[np.floating], depths: NDArray[np.floating],
             projections: NDArray[np.floating], images: NDArray[np.uint8], tolerance: float,
             counts: NDArray[np.integer], colors: NDArray[np.floating]) -> None:
    num, height, width = points.shape[0], depths.shape[1], depths.shape[2]
    for_each((num + CHUNK - 1) // CHUNK, _observe_at, (points, depths, projections, images,
                                                       tolerance, counts, colors, num, height,
                                                       width))


@inlined
def _observe_at(chunk: int, points: NDArray[np.floating], depths: NDArray[np.floating],
                projections: NDArray[np.floating], images: NDArray[np.uint8], tolerance: float,
                counts: NDArray[np.integer], colors: NDArray[np.floating], num: int, height: int,
                width: int) -> None:
    for v in range(depths.shape[0]):
        depth, m = depths[v], projections[v]
        for n in range(chunk * CHUNK, min(num, (chunk + 1) * CHUNK)):
            px, py, pz = points[n, 0], points[n, 1], points[n, 2]
            z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
            if not z > 0.0:
                continue
            u = (m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]) / z - 0.5
            w = (m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]) / z - 0.5
            if not (u >= 0.0 and w >= 0.0 and u < width - 1 and w < height - 1):
                continue
            vote = _vote(depth, int(w), int(u), z - tolerance, z + tolerance)
            if vote == 3:
                counts[n, 0] += 1
                counts[n, 3] += 1
            elif vote < 3:
                counts[n, vote] += 1
                if vote == 0 and len(images):
                    for c in range(3):
                        colors[n, c] += images[v, int(w), int(u), c]


def observe(points: NDArray[np.floating], maps: DepthMaps, tolerance: float) -> Observation:
    """Count the views that saw every point free, on a surface, or hidden.

    Args:
        points: [N, 3] world, scene units.
        maps: depth maps of one state.
        tolerance: depth difference, scene units, within which a point is on the surface.

    Returns:
        Counts over the views that have the point inside the image and in front of the camera.
    """
    return _seen(points, maps, tolerance, np.zeros((0, 1, 1, 3), np.uint8))[0]


def look_past(points: NDArray[np.floating], maps: DepthMaps, tolerance: float,
              ) -> tuple[Observation, NDArray[np.float32]]:
    """Return what `observe` does, and what views that see past every point show behind it.

    Args:
        points: [N, 3] world, scene units.
        maps: depth maps of one state, with images.
        tolerance: see `observe`.

    Returns:
        The counts, and [N, 4]: the mean colour 0..1 of the surfaces behind, and which share of
        those views shows background there; 1 where no view sees past, or no image is known.
    """
    images = np.zeros((0, 1, 1, 3), np.uint8) if maps.images is None else maps.images
    seen, colors = _seen(points, maps, tolerance, images)
    surfaces = seen.free - seen.outside if len(images) else np.zeros_like(seen.free)
    behind = np.ones((len(points), 4), np.float32)
    behind[:, :3] = colors / (255.0 * np.maximum(surfaces, 1)[:, None])
    behind[:, 3] -= surfaces / np.maximum(seen.free, 1)
    return seen, behind


def _seen(points: NDArray[np.floating], maps: DepthMaps, tolerance: float,
          images: NDArray[np.uint8]) -> tuple[Observation, NDArray[np.float32]]:
    """Return the counts, and [N, 3] the sum of colours of the surfaces behind every point."""
    points = np.ascontiguousarray(points, np.float64)
    counts, colors = np.zeros((len(points), 4), np.int32), np.zeros((len(points), 3), np.float32)
    _observe(points, maps.coded_depths, maps.projections, images, float(tolerance), counts, colors)
    free, surface, hidden, outside = np.ascontiguousarray(counts.T)
    return Observation(free, surface, hidden, outside), colors


def render_depth_maps(gaussians: Gaussians, state: StateViews, deep: float) -> DepthMaps:
    """Return the first-surface depth of Gaussians in every view of a state.

    Depth is the median depth where at least half of the light is stopped and the image's own mask
    agrees; masks come from the images, so background stays exactly what the photos say. Where light
    is stopped in places far apart, as by a pane and by what it shows, no surface is the first.

    Args:
        gaussians: of the state.
        state: its photos.
        deep: from the median to the mean depth, scene units: further apart, and by more than most
            of a rough fit is, nothing is known.
    """
    from part2gs_robotics.render.dispatch import render

    depths, apart = (np.zeros(state.alphas.shape, np.float32) for _ in range(2))
    splats = gaussians.splats
    for v in range(len(state)):
        seen = render(splats, state.camera(v))
        solid = (seen.alpha > SOLID_ALPHA) & (state.alphas[v] > SOLID_ALPHA * 255)
        mean = seen.depth / np.maximum(seen.alpha, SOLID_ALPHA)
        depths[v] = np.where(solid, seen.median_depth, 0.0)
        apart[v] = np.where(solid, np.abs(mean - seen.median_depth), 0.0)
    if (depths > 0).any():
        deep = max(deep, ROUGH * float(np.median(apart[depths > 0])))
    for v, depth in enumerate(depths):
        depth[_areas(apart[v] > deep)] = 0.0
    return DepthMaps(depths, state.alphas, state.Ks, state.viewmats, state.images)


def _areas(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return what of a mask [H, W] is wider than a rim."""
    import cv2

    square = np.ones((PANE, PANE), np.uint8)
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, square) > 0)
