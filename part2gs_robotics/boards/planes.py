"""Planes: where the walls of a made thing may lie, as families of parallel planes.

Their directions are those of straight edges in the photos, known to a hundredth of a degree, and of
flat faces no edge tells of. Their offsets are peaks of the surface's area, and of its area as seen
along the direction, which finds a wall however ragged it is. Too many planes do no harm: the cut
through their cells takes those that the photos ask for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.boards.facets import Facets, half_sphere, middle_of, settled
from part2gs_robotics.boards.tilts import tilts
from part2gs_robotics.model.arrays import F64, Mask

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
TOLD = 0.5  # of a plane's area: most of it
CARRIED = 6.0  # cells: twice the deviation of fitted depth where photos have one colour
RAGGED = 4.0  # cells: rims that masks and labels eat into
SPACING = 1.0  # cells between planes: nearer ones bound cells that no voxel stands for
MOST_PLANES = 30  # per direction and sign


@dataclass(frozen=True)
class Family:
    """Parallel planes: normal [3] unit, offsets [P] increasing, normal . x = offset."""

    normal: F64
    offsets: F64


@dataclass(frozen=True)
class Seen:
    """What photos say about faces: [F] shares 0..1 that they saw, and whose depth they tell."""

    observed: F64
    trusted: F64


def families(surface: Facets, flux: F64, seen: Seen, edges: F64, voxel: float,
             ) -> tuple[Family, ...]:
    """Return families of planes that may bound a part.

    Args:
        surface: all faces with smoothed normals.
        flux: [F, 3] areas times the faces' own normals.
        seen: what photos say about every face.
        edges: [E, 3] unit directions of straight edges.
        voxel: of the grid that the surface came from.
    """
    normals, found = _directions(surface, seen.observed, edges), []
    normals += _tilted(normals, surface, seen.observed, voxel)
    if not normals:
        return ()
    facing = np.abs(surface.normals @ np.array(normals).T)
    own = np.where(facing.max(1) > FACING, facing.argmax(1), -1)
    for k, normal in enumerate(normals):
        rivals = [j for j, other in enumerate(normals) if j != k and abs(normal @ other) > FACING]
        mine = ~np.isin(own, rivals)
        part = Facets(surface.centers[mine], surface.normals[mine], surface.areas[mine])
        least = LEAST * float(surface.areas.sum())
        offsets = _offsets(normal, part, (flux[mine], seen.trusted[mine]), least, voxel)
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


def _tilted(normals: list[F64], surface: Facets, observed: F64, voxel: float) -> list[F64]:
    """Return directions of walls a few degrees off those found."""
    weights, found = surface.areas * np.maximum(observed, 1e-3), list[F64]()
    for normal in normals:
        for tilt in tilts(normal, surface, weights, SHARE * float(weights.sum()), voxel):
            if all(abs(tilt @ other) < APART for other in (*normals, *found)):
                found.append(tilt)
    return found[:MOST_TILTS]


def _directions(surface: Facets, observed: F64, edges: F64) -> list[F64]:
    """Return unit normals of walls, the most observed first."""
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


def _offsets(normal: F64, surface: Facets, weights: tuple[F64, F64], least: float,
             voxel: float) -> F64:
    """Return the offsets of a family's planes, increasing; each holds some area at least.

    Args:
        normal: of the family.
        surface: faces that may lie in its planes.
        weights: [F, 3] flux of the faces, [F] trust in their depth.
        least: area that a plane must hold.
        voxel: scene units.
    """
    levels, (flux, trusted) = surface.centers @ normal, weights
    found: list[tuple[float, float]] = []  # weight, offset
    for sign in (1.0, -1.0):
        facing = sign * (surface.normals @ normal) > FACING
        near = (levels[facing], surface.areas[facing], trusted[facing])
        peaks = _found(levels, facing, surface.areas, sign * (flux @ normal), (least, voxel))
        told = [_told(offset, near, WINDOW * voxel) for _, offset in peaks]
        own = [peak for peak, sure in zip(peaks, told, strict=True) if sure]
        carried = [peak for peak, sure in zip(peaks, told, strict=True) if not sure]
        # What fits only carry over from edges is no second plane near what photos tell.
        own += _thinned(sorted(carried, reverse=True), own, CARRIED * voxel)
        found += own
    kept: list[float] = []
    for _, offset in sorted(found, reverse=True):
        if all(abs(offset - other) > SPACING * voxel for other in kept):
            kept.append(offset)
    return np.sort(np.array(kept))


def _found(levels: F64, facing: Mask, areas: F64, along: F64,
           limits: tuple[float, float]) -> list[tuple[float, float]]:
    """Return weight and offset of planes where smooth faces lie, and of ragged ones beside."""
    least, voxel = limits
    smooth = _peaks(levels[facing], areas[facing], WINDOW * voxel, least)
    ragged = _peaks(levels, along, RAGGED * voxel, least)
    return smooth + [r for r in ragged if all(abs(r[1] - s[1]) > WINDOW * voxel for s in smooth)]


def _told(offset: float, near: tuple[F64, F64, F64], width: float) -> bool:
    """Return whether photos tell of a plane: of most of the area in it, or nothing faces so."""
    levels, areas, trusted = near
    own = np.abs(levels - offset) < 0.5 * width
    return bool(trusted[own] @ areas[own] >= TOLD * areas[own].sum())


def _thinned(peaks: list[tuple[float, float]], others: list[tuple[float, float]],
             apart: float) -> list[tuple[float, float]]:
    """Return the peaks that are so far from others, and from heavier ones among them."""
    kept: list[tuple[float, float]] = []
    for peak in peaks:
        if all(abs(peak[1] - other[1]) > apart for other in (*others, *kept)):
            kept.append(peak)
    return kept


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
