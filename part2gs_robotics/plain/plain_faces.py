"""Plain faces: depth maps with flat faces where photos see their rims.

A lid over an open drawer looks, from every side, much as its floor does: stereo cannot tell them
apart. But made things are flat between their edges, and where a floor ends photos see it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.segments import segments_of
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.small_views import SmallViews, neighbors
from part2gs_robotics.plain.agreed import Spoken, on_agreed
from part2gs_robotics.plain.kernels import NOTHING
from part2gs_robotics.plain.planes import Asked, Bounds, Views, spoken_for
from part2gs_robotics.plain.regions import regions_of
from part2gs_robotics.runtime.side_by_side import side_by_side

SOLID = 0.9  # of a pixel: less is mixed with what is behind
CROSSED = np.sin(np.deg2rad(20.0))  # of edges: flatter ones hardly span a plane
SAME = np.cos(np.deg2rad(2.0))  # of normals
MOST = 6  # normals: a box has three
FINE = 0.2  # score of the map's own depths: outer walls have it, lids do not


def with_plain_faces(state: StateViews, bounds: Bounds, maps: DepthMaps,
                     views: SmallViews) -> DepthMaps:
    """Return depth maps with flat faces without texture where several photos put them.

    Args:
        state: photos, whose straight edges say which way faces look.
        bounds: of every depth.
        maps: of stereo, one per view.
        views: the same photos, larger.
    """
    normals = face_normals(state)
    if not len(normals) or not len(maps):
        return maps
    seen = _views(bounds, maps, views)
    regions = side_by_side([partial(_spoken, seen, v, normals) for v in range(len(views))])
    found = [one for of_view in regions for one in of_view]
    return replace(maps, depths=_resized(on_agreed(seen, found, normals), maps.depths.shape))


def face_normals(state: StateViews) -> F64:
    """Return [M, 3] unit normals of the planes that two families of straight edges span."""
    edges = edge_families(bundled([segments_of(state)]), np.random.default_rng(0))
    found: list[F64] = []
    for (one, _), (other, _) in combinations(edges, 2):
        normal = np.cross(one, other)
        size = float(np.linalg.norm(normal))
        if size > CROSSED and all(abs(normal @ old) < SAME * size for old in found):
            found.append(normal / size)
    return np.array(found[:MOST]).reshape(-1, 3)


def _spoken(views: Views, view: int, normals: F64) -> list[Spoken]:
    """Return the regions of a photo, with planes for those whose depth other photos doubt."""
    asked = [Asked(views, view, region)
             for region in regions_of(views.images[view], np.random.default_rng(view))]
    return [Spoken(one, spoken_for(one, normals) if one.own() <= FINE else []) for one in asked]


def _views(bounds: Bounds, maps: DepthMaps, views: SmallViews) -> Views:
    """Return what is known of photos, nothing where they do not show the object."""
    images = np.ascontiguousarray(views.colors / np.maximum(views.alphas, 1e-3)[..., None],
                                  np.float32)  # 1e-3: below one level
    images[views.alphas < SOLID] = NOTHING
    return Views(images, _resized(maps.depths, views.alphas.shape), views.Ks, views.viewmats,
                 neighbors(views.viewmats, bounds.middle), bounds)


def _resized(maps: F32, shape: tuple[int, ...]) -> F32:
    """Return maps [V, H, W] of another size, by the nearest pixel centre."""
    import cv2

    size = shape[2], shape[1]
    return np.stack([cv2.resize(one, size, interpolation=cv2.INTER_NEAREST_EXACT) for one in maps])
