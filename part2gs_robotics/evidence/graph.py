"""Surfels of both states as one graph of neighbours, and how firmly neighbours hold together.

A part ends at a seam: a gap, a crease, or a line in the photos. Where two neighbours lie on one
smooth face and no photo shows a line between them, hardly any made thing is cut (the contrast term
of GrabCut, Rother et al. 2004, on a surface).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.arrays import F32, F64, Mask
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

SMOOTHNESS = 0.12  # per neighbour: ten neighbours outvote a neutral surfel, not a clear one
GRAIN = 2**14  # whole numbers per unit of cost: a surfel's sum stays far below 2^31
NEIGHBORS = 10  # of the surfel graph: a full ring on a surface sampled by voxels
TOUCH = 1.5  # of the farthest neighbour of most: 0.02 of the diagonal, two surfels of any size
THROUGH = 0.0  # cosine of normals: a way goes round an edge, not through a thin wall
CREASE, FACE = 0.5, 0.9  # cosines between which two neighbours turn from two faces into one
STEP = 0.004  # of the diagonal: twice what nine of ten surfels seen in both states differ by
PHOTOS = 2  # every other photo tells of lines: 32 of 64 see nearly every pair more than once
BLUR = 0.7  # pixels: less than a line is wide, more than the noise of one pixel
ON = 0.01  # of the diagonal: a surfel farther from a photo's depth is not what that photo shows
FACING = 0.35  # cosine: seen more askew, neighbours fall on one pixel
SAMPLES = 5  # of a photo between two neighbours, which lie some four pixels apart


@dataclass(frozen=True)
class Graph:
    """Surfels of both states as one graph: neighbours [N, k] and weights [N, k] within a state."""

    neighbors: NDArray[np.int32]
    weights: NDArray[np.float32]


@dataclass(frozen=True)
class Web:
    """What two labels cost between neighbours, both ways together, as a sparse symmetric matrix.

    Attributes:
        first: [N + 1] first arc of every surfel.
        to: [A] the surfel that an arc leads to.  back: [A] the arc that leads back.
        cost: [A] in `GRAIN`-ths.
    """

    first: NDArray[np.int32]
    to: NDArray[np.int32]
    back: NDArray[np.int32]
    cost: NDArray[np.int32]


def web_of(graph: Graph, bonds: F32) -> Web:
    """Return what neighbours with two labels cost: their nearness, and the bond that is cut."""
    count, ring = graph.neighbors.shape
    rows = np.repeat(np.arange(count, dtype=np.int32), ring)
    weights = SMOOTHNESS * graph.weights.astype(np.float64) + bonds
    weights[graph.neighbors == rows.reshape(count, ring)] = 0.0
    one_way = csr_matrix((weights.ravel(), (rows, graph.neighbors.ravel())), (count, count))
    both = one_way + one_way.T
    both.eliminate_zeros()
    both.sort_indices()
    number = csr_matrix((np.arange(1, both.nnz + 1), both.indices, both.indptr), both.shape)
    back = number.T.tocsr()  # symmetric, so its entries stand in the same order
    back.sort_indices()
    return Web(both.indptr.astype(np.int32), both.indices.astype(np.int32),
               (back.data - 1).astype(np.int32), np.round(GRAIN * both.data).astype(np.int32))


def build_graph(states: tuple[Surfels, Surfels]) -> Graph:
    """Return the normal-aware nearest-neighbour graph of both states, state 1 after state 0."""
    ids, weights, offset = [], [], 0
    for s in states:
        count = min(NEIGHBORS + 1, len(s))
        distance, index = cKDTree(s.points).query(s.points, count)
        distance, index = distance[:, 1:], index[:, 1:]
        cosine = (s.normals[index] * s.normals[:, None]).sum(-1)
        reach = np.median(distance[:, -1]) + 1e-12
        near = np.exp(-((distance / (1.5 * reach)) ** 2))
        weights.append(near * (0.25 + 0.75 * np.clip(cosine, 0, 1)))
        ids.append(index + offset)
        offset += len(s)
    # Half the memory of 64-bit numbers: a sweep waits for the neighbours' lines.
    return Graph(np.concatenate(ids).astype(np.int32), np.concatenate(weights).astype(np.float32))


def touching(states: tuple[Surfels, Surfels], graph: Graph) -> Mask:
    """Return [N, k] whether neighbours are of one body, as near as surfels of a surface are."""
    points = np.concatenate([s.points for s in states])
    gaps = np.linalg.norm(points[graph.neighbors] - points[:, None], axis=-1)
    return np.asarray(gaps < TOUCH * np.median(gaps.max(1)))


def ways_along(states: tuple[Surfels, Surfels], graph: Graph) -> csr_matrix:
    """Return the distances between neighbouring surfels as a symmetric sparse matrix [N, N]."""
    points = np.concatenate([s.points for s in states])
    rows = np.repeat(np.arange(len(points)), graph.neighbors.shape[1])
    cols = graph.neighbors.ravel()
    gaps = np.linalg.norm(points[rows] - points[cols], axis=1)
    normals = np.concatenate([s.normals for s in states])
    same_side = (normals[rows] * normals[cols]).sum(1) > THROUGH
    one_way = csr_matrix((gaps[same_side], (rows[same_side], cols[same_side])),
                         shape=(len(points), len(points)))
    return one_way.maximum(one_way.T)


def ways_from(surface: csr_matrix, starts: Mask, reach: float, lag: float = np.inf) -> F64:
    """Return [N, L] the shortest way along the surface from any start of each label.

    Args:
        surface: [N, N] distances between neighbours, see `ways_along`.
        starts: [N, L] where ways begin.
        reach: farthest, which is also what lies farther or hangs together with no start.
        lag: a way longer than the shortest of all labels by more is as good as `reach`; what lies
            behind it lags as much.
    """
    ways = surface.indptr, surface.indices, surface.data
    out, latest = np.full(starts.shape[::-1], reach), np.full((1, len(starts)), reach)
    if np.isfinite(lag):
        _shortest(*ways, np.asarray(starts.any(1))[None], np.full(len(starts), np.inf), latest)
    _shortest(*ways, np.ascontiguousarray(starts.T), latest[0] + lag, out)
    return np.ascontiguousarray(out.T)


@inlined
def _lift(heap: NDArray[np.int32], keys: F64, size: int, node: int, key: float) -> None:
    """Put a node into a heap of `size`, the nearest first."""
    at = size
    while at > 0 and keys[(at - 1) // 2] > key:
        heap[at], keys[at] = heap[(at - 1) // 2], keys[(at - 1) // 2]
        at = (at - 1) // 2
    heap[at], keys[at] = node, key


@inlined
def _sink(heap: NDArray[np.int32], keys: F64, size: int) -> None:
    """Move the last of `size` + 1 to the place of the first, which was taken."""
    node, key, at = heap[size], keys[size], 0
    while 2 * at + 1 < size:
        child = 2 * at + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        heap[at], keys[at] = heap[child], keys[child]
        at = child
    heap[at], keys[at] = node, key


@kernel
def _shortest(first: NDArray[np.int32], nodes: NDArray[np.int32], gaps: F64, starts: Mask,
              latest: F64, out: F64) -> None:
    """Fill out [L, N], given with the farthest way, by Dijkstra's algorithm from every label.

    latest [N]: no way that comes later is followed.
    """
    for_each(len(starts), _shortest_at, (first, nodes, gaps, starts, latest, out))


@inlined
def _shortest_at(label: int, first: NDArray[np.int32], nodes: NDArray[np.int32], gaps: F64,
                 starts: Mask, latest: F64, out: F64) -> None:
    way, size = out[label], 0
    heap, keys = np.zeros(len(nodes), np.int32), np.zeros(len(nodes))
    for i in range(len(way)):
        if starts[label, i]:
            way[i] = 0.0
    for i in range(len(way)):
        if starts[label, i]:  # before all others, in any order
            for n in range(first[i], first[i + 1]):
                if gaps[n] < min(way[nodes[n]], latest[nodes[n]]):
                    way[nodes[n]] = gaps[n]
                    _lift(heap, keys, size, nodes[n], gaps[n])
                    size += 1
    while size > 0:
        i, key = heap[0], keys[0]
        size -= 1
        _sink(heap, keys, size)
        if key > way[i]:
            continue  # reached on a shorter way since
        for n in range(first[i], first[i + 1]):
            there = key + gaps[n]
            if there < min(way[nodes[n]], latest[nodes[n]]):
                way[nodes[n]] = there
                _lift(heap, keys, size, nodes[n], there)
                size += 1


def bonds(states: tuple[Surfels, Surfels], graph: Graph, maps: tuple[DepthMaps, DepthMaps],
          photos: tuple[StateViews, StateViews], diag: float) -> F32:
    """Return [N, k] 0..1, how firmly every surfel holds together with its neighbours.

    Near 1 on one smooth face without any line in the photos, 0 across a gap, a crease or a line.

    Args:
        states: surfels of both.
        graph: their neighbours, state 1 after state 0.
        maps: depth maps of both states, which tell what every photo sees.
        photos: of both states.
        diag: diagonal of the object, scene units.
    """
    points, normals = (np.concatenate([getattr(s, name) for s in states])
                       for name in ("points", "normals"))
    gaps = points[graph.neighbors] - points[:, None]
    cosine = (normals[graph.neighbors] * normals[:, None]).sum(-1)
    step = np.maximum(np.abs((gaps * normals[:, None]).sum(-1)),
                      np.abs((gaps * normals[graph.neighbors]).sum(-1)))
    far = np.linalg.norm(gaps, axis=-1)
    near = np.exp(-((far / (1.5 * np.median(far[:, -1]) + 1e-12)) ** 2))
    face = np.clip((cosine - CREASE) / (FACE - CREASE), 0, 1)
    face *= np.exp(-((step / (STEP * diag)) ** 2))
    lines, n0 = np.full(far.shape, np.nan, np.float32), len(states[0])
    for rows, first, s in ((slice(0, n0), 0, 0), (slice(n0, None), n0, 1)):
        lines[rows] = _lines(states[s], graph.neighbors[rows] - first, maps[s], photos[s], diag)
    return np.asarray(near * face * _unlined(lines), np.float32)


def _unlined(lines: F32) -> F64:
    """Return [N, k] the share of all neighbours with as clear a line or a clearer one.

    The scene itself tells what is clear; what no photo shows is as lined as most.
    """
    seen = np.sort(lines[~np.isnan(lines)])
    known = np.where(np.isnan(lines), np.median(seen) if len(seen) else 0.0, lines)
    return 1.0 - np.searchsorted(seen, known) / max(len(seen), 1)


def _lines(own: Surfels, neighbors: NDArray[np.int32], maps: DepthMaps, photos: StateViews,
           diag: float) -> F32:
    """Return [n, k] the mean strength of what photos show between neighbours, NaN = not seen."""
    total = np.zeros((2, *neighbors.shape), np.float32)
    for v in np.flatnonzero(~photos.held_out)[::PHOTOS]:
        spots, seen = seen_in(own, maps, int(v), ON * diag)
        _between(spots, seen, neighbors, _strength(photos.images[v]), total[0], total[1])
    return np.where(total[1] > 0, total[0] / np.maximum(total[1], 1), np.nan).astype(np.float32)


def _strength(image: NDArray[np.uint8]) -> F32:
    """Return [H, W] the steepest change of any channel, per pixel."""
    smooth = cv2.GaussianBlur(image.astype(np.float32) / 255, (0, 0), BLUR)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, dx, 1 - dx, ksize=3) / 4 for dx in (1, 0))
    return np.sqrt(across**2 + down**2).max(-1)


def seen_in(own: Surfels, maps: DepthMaps, v: int, on: float,
            ) -> tuple[NDArray[np.int32], Mask]:
    """Return [n, 2] column and row of every surfel in a view, and which of them the view sees.

    Args:
        own: surfels of a state.
        maps: of the same state.
        v: the view.
        on: farthest from the depth that the view has there, scene units.
    """
    height, width = maps.depths[v].shape
    placed = own.points @ maps.projections[v][:, :3].T + maps.projections[v][:, 3]
    depth = placed[:, 2]
    spots = np.rint(placed[:, :2] / np.maximum(depth, 1e-9)[:, None] - 0.5)
    inside = (depth > 0) & (spots >= 0).all(1) & (spots < (width, height)).all(1)
    spots = np.where(inside[:, None], spots, 0).astype(np.int32)
    view = maps.viewmats[v]
    rays = -view[:3, :3].T @ view[:3, 3] - own.points
    facing = (rays * own.normals).sum(1) > FACING * np.linalg.norm(rays, axis=1)
    return spots, inside & facing & (np.abs(maps.depths[v][spots[:, 1], spots[:, 0]] - depth) < on)


@kernel
def _between(spots: NDArray[np.int32], seen: Mask, neighbors: NDArray[np.int32], strength: F32,
             total: F32, count: F32) -> None:
    """Add to total [n, k] the strongest change between neighbours that are both seen."""
    for_each(len(seen), _between_at, (spots, seen, neighbors, strength, total, count))


@inlined
def _between_at(i: int, spots: NDArray[np.int32], seen: Mask, neighbors: NDArray[np.int32],
                strength: F32, total: F32, count: F32) -> None:
    if not seen[i]:
        return
    for k in range(neighbors.shape[1]):
        j = neighbors[i, k]
        if not seen[j]:
            continue
        most = np.float32(0)
        for t in range(SAMPLES):
            share = t / (SAMPLES - 1)
            x = spots[i, 0] + share * (spots[j, 0] - spots[i, 0])
            y = spots[i, 1] + share * (spots[j, 1] - spots[i, 1])
            most = max(most, strength[int(y + 0.5), int(x + 0.5)])
        total[i, k] += most
        count[i, k] += 1
