"""Planes: where the walls of a made thing may lie, as families of parallel planes.

Their directions are those of straight edges in the photos, known to a hundredth of a degree, and of
flat faces no edge tells of. Their offsets are peaks of the surface's area, and of its area as seen
along the direction, which finds a wall however ragged it is. Too many planes do no harm: the cut
through their cells takes those that the photos ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from part2gs_robotics.boards.facets import Facets, half_sphere, middle_of, settled
from part2gs_robotics.boards.tilts import tilts
from part2gs_robotics.model.arrays import F64

FACING = np.cos(np.deg2rad(25.0))  # smoothed normals of a wall against its direction
CLUSTER = np.cos(np.deg2rad(15.0))  # normals that speak for one direction
SNAP = np.cos(np.deg2rad(8.0))  # a bent fitted wall against the edges that bound it
SAME = np.cos(np.deg2rad(6.0))  # nearer directions are one
SQUARE = np.sin(np.deg2rad(3.0))  # two directions nearer to a right angle belong to one box
SHARE, LONE = 0.02, 0.1  # of the observed surface: a direction with and without straight edges
FLAT = 0.6  # of a lone direction's area in its four best offsets: else the surface is curved
MOST_FAMILIES, TRIED = 6, 12  # of directions: twice those of a box
APART = np.cos(np.deg2rad(2.0))  # a tilt that is none: the error of a wall's normal
MOST_TILTS = 8  # two for each side of a hopper
LEAST = 7e-4  # of the surface: the side of a board is a hundredth of its front
WINDOW = 2.0  # cells: noise of a wall seen from one side, both ways
RAGGED = 4.0  # cells: rims that masks and labels eat into
SPACING = 1.0  # cells between planes: nearer ones bound cells that no voxel stands for
MOST_PLANES = 30  # per direction and sign


@dataclass(frozen=True)
class Family:
    """Parallel planes: normal [3] unit, offsets [P] increasing, normal . x = offset."""

    normal: F64
    offsets: F64


def families(normals: Sequence[F64], surface: Facets, flux: F64, voxel: float,
             ) -> tuple[Family, ...]:
    """Return families of planes that may bound a part.

    Args:
        normals: [3] unit directions of walls.
        surface: all faces with smoothed normals.
        flux: [F, 3] areas times the faces' own normals.
        voxel: of the grid that the surface came from.
    """
    found: list[Family] = []
    if not normals:
        return ()
    facing = np.abs(surface.normals @ np.array(normals).T)
    own = np.where(facing.max(1) > FACING, facing.argmax(1), -1)
    for k, normal in enumerate(normals):
        rivals = [j for j, other in enumerate(normals) if j != k and abs(normal @ other) > FACING]
        mine = ~np.isin(own, rivals)
        part = Facets(surface.centers[mine], surface.normals[mine], surface.areas[mine])
        least = LEAST * float(surface.areas.sum())
        offsets = _offsets(normal, part, flux[mine], least, voxel)
        if len(offsets):
            found.append(Family(normal, offsets))
    return tuple(found)


def flat_share(surface: Facets, found: tuple[Family, ...], observed: F64, voxel: float) -> float:
    """Return the share of the observed surface that lies in planes and faces as they do.

    Args:
        surface: all faces with smoothed normals.
        found: families of planes.
        observed: [F] share 0..1 of every face that photos saw.
        voxel: of the grid that the surface came from.
    """
    weights, flat = surface.areas * np.maximum(observed, 1e-3), np.zeros(len(observed), bool)
    for family in found:
        levels = surface.centers @ family.normal
        gaps = np.abs(levels[:, None] - family.offsets).min(1)
        flat |= (np.abs(surface.normals @ family.normal) > CLUSTER) & (gaps < WINDOW * voxel)
    return float(weights @ flat / max(weights.sum(), 1e-300))


def tilted(normals: Sequence[F64], surface: Facets, observed: F64, voxel: float) -> list[F64]:
    """Return directions of walls that may lie a few degrees off those found.

    Args:
        normals: [3] unit directions found.
        surface: all faces with smoothed normals.
        observed: [F] share 0..1 of every face that photos saw.
        voxel: of the grid that the surface came from.
    """
    weights, found = surface.areas * np.maximum(observed, 1e-3), list[F64]()
    for normal in normals:
        for tilt in tilts(normal, surface, weights, SHARE * float(weights.sum()), voxel):
            if all(abs(tilt @ other) < APART for other in (*normals, *found)):
                found.append(tilt)
    return found[:MOST_TILTS]


def directions(surface: Facets, observed: F64, edges: F64) -> list[F64]:
    """Return [3] unit normals of walls, the most observed first.

    Args:
        surface: all faces with smoothed normals.
        observed: [F] share 0..1 of every face that photos saw.
        edges: [E, 3] unit directions of straight edges.
    """
    normals, weights = surface.normals, surface.areas * np.maximum(observed, 1e-3)
    total, seeds, made = weights.sum(), half_sphere(), _made(edges)
    found: list[F64] = []
    for _ in range(TRIED):
        held = (np.abs(seeds @ normals.T) > CLUSTER) @ weights
        best = int(held.argmax())
        if held[best] < SHARE * total or len(found) == MOST_FAMILIES:
            break
        direction = settled(seeds[best], normals, weights, FACING)
        near = np.abs(made @ direction) if len(made) else np.zeros(1)
        if near.max() > SNAP:
            direction = made[near.argmax()]
        enough = near.max() > SNAP or (held[best] > LONE * total and _flat(direction, surface))
        if enough and all(abs(direction @ other) < SAME for other in found):
            found.append(direction)
        away = np.abs(normals @ direction) <= FACING
        normals, weights = normals[away], weights[away]
    return _squared(found, edges)[:MOST_FAMILIES]


def _made(edges: F64) -> F64:
    """Return [M, 3] normals that walls between straight edges may have."""
    found = list(edges)
    for i, one in enumerate(edges):
        for other in edges[:i]:
            cross = np.cross(one, other)
            length = float(np.linalg.norm(cross))
            if length > np.sin(np.deg2rad(15.0)):  # nearer to parallel, the errors of both grow
                found.append(cross / length)
    return np.array(found).reshape(-1, 3)


def _squared(found: list[F64], edges: F64) -> list[F64]:
    """Return the directions with those that make boxes of them: a board's sides are hardly seen."""
    out = list(found)
    for direction in found[:1]:  # the strongest edge across it: rims are thin
        across = [edge for edge in edges if abs(edge @ direction) < SQUARE][:1]
        out += [edge for edge in across if all(abs(edge @ other) < FACING for other in out)]
    for i in range(len(out)):
        for j in range(i):
            cross = np.cross(out[i], out[j])
            if abs(out[i] @ out[j]) < SQUARE and all(abs(cross @ d) < FACING for d in out):
                out.append(cross / np.linalg.norm(cross))
    return out


def _flat(direction: F64, surface: Facets) -> bool:
    """Return whether most of what faces a direction lies in few planes: the rest is curved."""
    along = np.abs(surface.normals @ direction) > FACING
    areas, levels = surface.areas[along], surface.centers[along] @ direction
    width = 0.02 * float(np.ptp(surface.centers @ direction))  # windows of a fiftieth
    bins = np.histogram(levels, np.arange(levels.min(), levels.max() + 2 * width, width),
                        weights=areas)[0]
    return bool(np.sort(bins)[-4:].sum() > FLAT * areas.sum())


def _offsets(normal: F64, surface: Facets, flux: F64, least: float, voxel: float) -> F64:
    """Return the offsets of a family's planes, increasing; each holds some area at least."""
    levels = surface.centers @ normal
    found: list[tuple[float, float]] = []  # weight, offset
    for sign in (1.0, -1.0):
        facing = sign * (surface.normals @ normal) > FACING
        smooth = _peaks(levels[facing], surface.areas[facing], WINDOW * voxel, least)
        ragged = _peaks(levels, sign * (flux @ normal), RAGGED * voxel, least)
        found += smooth + [r for r in ragged
                           if all(abs(r[1] - s[1]) > WINDOW * voxel for s in smooth)]
    kept: list[float] = []
    for _, offset in sorted(found, reverse=True):
        if all(abs(offset - other) > SPACING * voxel for other in kept):
            kept.append(offset)
    return np.sort(np.array(kept))


def _peaks(levels: F64, areas: F64, width: float, least: float) -> list[tuple[float, float]]:
    """Return weight and offset of the windows that hold most area, the largest first."""
    if not len(levels):
        return []
    step = width / 16  # of the offset's error
    bins = np.arange(levels.min() - width, levels.max() + 2 * width, step)
    held = np.histogram(levels, bins, weights=areas)[0]
    size, found = 16, list[tuple[float, float]]()
    while len(found) < MOST_PLANES:
        sums = np.convolve(held, np.ones(size), "valid")
        best = int(sums.argmax())
        if sums[best] < least:
            break
        own = slice(best, best + size)
        weights = np.maximum(held[own], 0.0)
        middle = middle_of(bins[:-1][own] + 0.5 * step, weights)
        found.append((float(sums[best]), middle))
        held[own] = 0.0
    return found
