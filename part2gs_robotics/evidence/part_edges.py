"""Straight edges of every part in both states, and what joints are drawn to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.edges import Bundle, bundled
from part2gs_robotics.evidence.guides import Guides
from part2gs_robotics.evidence.segments import Segments
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians

BESIDE = 2.0  # pixels from an edge to the surface it belongs to
PLACES = np.array([0.15, 0.5, 0.85])  # along a segment: all three must be one part's


@dataclass(frozen=True)
class Clues:
    """What made things keep to: directions of faces and edges, and every part's own edges."""

    guides: Guides
    edges: list[PartEdges]


@dataclass(frozen=True)
class PartEdges:
    """Straight edges of one part in both states.

    Attributes:
        bundles: of both states.  ways: per state [N, 3] rough unit directions.
    """

    bundles: tuple[Bundle, Bundle]
    ways: tuple[F64, F64]


def part_edges(segments: Sequence[Segments], maps: Sequence[DepthMaps],
               gaussians: Sequence[Gaussians], labels: Sequence[NDArray[np.int64]], count: int,
               ) -> list[PartEdges]:
    """Return the edges of parts 1..count.

    Args:
        segments: of both states.
        maps: first surfaces of both states.
        gaussians: of both states.
        labels: [N_s] part of every Gaussian.
        count: number of moving parts.
    """
    ways, owners = zip(*(_placed(*state) for state in
                         zip(segments, maps, gaussians, labels, strict=True)), strict=True)
    edges = []
    for part in range(1, count + 1):
        one, two = (owner == part for owner in owners)
        edges.append(PartEdges((bundled([segments[0].select(one)]),
                                bundled([segments[1].select(two)])),
                               (ways[0][one], ways[1][two])))
    return edges


def _placed(segments: Segments, maps: DepthMaps, gaussians: Gaussians, labels: NDArray[np.int64],
            ) -> tuple[F64, NDArray[np.int64]]:
    """Return [N, 3] rough directions of a state's segments and [N] their parts, -1 = not clear."""
    ends, views = segments.ends, segments.views
    way = ends[:, 1] - ends[:, 0]
    across = np.stack([-way[:, 1], way[:, 0]], 1) / np.linalg.norm(way, axis=1)[:, None]
    at = ends[:, :1] + PLACES[:, None] * way[:, None]
    sides = [at + s * BESIDE * across[:, None] for s in (-1, 1)]
    depths = [_depths(maps, views, pixels) for pixels in sides]
    # The edge belongs to what is nearer.
    middle = [np.where(d[:, 1] > 0, d[:, 1], np.inf) for d in depths]
    first = (middle[0] <= middle[1])[:, None]
    depth, pixels = np.where(first, *depths), np.where(first[..., None], *sides)
    world_from_camera = np.linalg.inv(segments.viewmats)[views]
    rays = np.einsum("nij,npj->npi", np.linalg.inv(segments.Ks)[views],
                     np.concatenate([pixels, np.ones((*depth.shape, 1))], -1))
    points = np.einsum("nij,npj->npi", world_from_camera[:, :3, :3], rays * depth[..., None])
    points += world_from_camera[:, None, :3, 3]
    direction = points[:, -1] - points[:, 0]
    direction /= np.maximum(np.linalg.norm(direction, axis=1), 1e-12)[:, None]
    solid = gaussians.opacities > 0.5
    owner = labels[solid][cKDTree(gaussians.means[solid]).query(points)[1]]
    clear = (depth > 0).all(1) & (owner == owner[:, :1]).all(1)
    return direction, np.where(clear, owner[:, 0], -1)


def _depths(maps: DepthMaps, views: NDArray[np.int64], pixels: F64) -> F64:
    """Return [N, P] first-surface depth of pixels [N, P, 2], 0 outside."""
    height, width = maps.depths.shape[1:]
    cols, rows = (np.floor(pixels[..., i]).astype(int) for i in (0, 1))
    inside = (cols >= 0) & (cols < width) & (rows >= 0) & (rows < height)
    found = maps.depths[views[:, None], rows.clip(0, height - 1), cols.clip(0, width - 1)]
    return np.where(inside, found, 0.0).astype(np.float64)
