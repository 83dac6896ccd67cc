"""Shut: doors that stand ajar are free to close until they lie flat on the base.

A door or lid was photographed a little open; what is behind it, nobody saw, and the mesh made up
there stops it at once. But made things shut flush: at the end of its way a door's faces lie along
those of the base. Where they do, and the part runs into the base right beyond, the base yields to
the whole way up to there, if nothing that photos saw has to.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np

from part2gs_robotics.evidence.depth_maps import observe
from part2gs_robotics.mesh.bend import planes_of
from part2gs_robotics.mesh.make_room import base_apart
from part2gs_robotics.model.arrays import F64, Mask
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.solids import arrays, corners_of
from part2gs_robotics.volume.part_maps import PartMaps
from part2gs_robotics.volume.place import Place

if TYPE_CHECKING:
    from manifold3d import Manifold

logger = logging.getLogger(__name__)
AJAR = np.deg2rad(45.0)  # beyond a state: who photographs a shut door opens it less
LEAST = np.deg2rad(0.3)  # nearer it is shut: noise of planes
SAME = np.cos(np.deg2rad(2.0))  # normals of one wall, as vertices moved onto outlines leave them
ACROSS = 0.5  # length across the axis of a normal that an angle can be told of
LEVEL = 0.03  # of a normal along the axis, by which two walls that meet may differ: 2 degrees
WALL = 0.1  # of a part's surface that looks one way; a door's face is 0.2 to 0.5
PLANE = 0.03  # of the base's, likewise; the front edges of a body of boards are 0.05
BEYOND = np.deg2rad(1.5)  # past flush, where a part must run into the base: as sure as planes are
SUNK = 0.01  # of what the part passes there: doors and lids had 0.04 to 0.5, in the air 0.001
STEP = np.deg2rad(1.0)  # between places on the way at which seen points are looked for
NOISE = 1.5  # voxels by which a seen point may stand in the way: depths are as wrong
VOTES = 2  # photos that see a point of the base
CROSSED = 0.01  # of the base's seen points nearby that may lie in the way


@dataclass(frozen=True)
class _End:
    """A part, the last joint value on its way to shut [rad], and the observed one before it."""

    part: int
    value: float
    start: float


def shut(surfaces: Sequence[Manifold], pieces: Sequence[Sequence[Manifold]], place: Place,
         maps: Sequence[PartMaps], voxel: float) -> list[Manifold]:
    """Return surfaces whose base lets doors and lids close until they lie flat on it.

    Args:
        surfaces: closed, apart on the observed ways, base first, world frame at state 0.
        pieces: convex, per part: what it is the union of; a part without any stays as it is.
        place: joints, and the part that carries each.
        maps: what photos of both states saw.
        voxel: size of the grid's cells, scene units.
    """
    out, done = list(surfaces), set[tuple[int, float]]()
    for end in _ends(surfaces, place):
        joint, own = place.joints[end.part - 1], pieces[end.part]
        if (end.part, end.start) in done or not own or not _meets(out, joint, end):
            continue
        if _in_the_way(out[0], own, place, maps, end, voxel):
            continue
        start = joint.transform(end.start)[:3]
        cut = base_apart(out[0], end.part, [piece.transform(start) for piece in own],
                         _to(place, end), voxel)
        if _meets([cut, *out[1:]], joint, end):
            logger.info("part %d shuts flush %.1f degrees beyond a state", end.part,
                        np.rad2deg(abs(end.value - end.start)))
            out[0] = cut
            done.add((end.part, end.start))
    return out


def _ends(surfaces: Sequence[Manifold], place: Place) -> list[_End]:
    """Return where parts that turn on the base come to lie along it, for each the nearest first."""
    found, base = [], _walls(surfaces[0], PLANE)
    for k, (joint, parent) in enumerate(zip(place.joints, place.parents, strict=True), 1):
        if joint.kind != "revolute" or parent != 0:
            continue
        own = _walls(surfaces[k], WALL)
        for start, sign in ((min(0.0, joint.value), -1.0), (max(0.0, joint.value), 1.0)):
            turned = own @ joint.transform(start)[:3, :3].T
            found += [_End(k, start + sign * angle, start)
                      for angle in _flush(turned, base, sign * joint.axis)]
    return found


def _walls(surface: Manifold, least: float) -> F64:
    """Return [N, 3] unit normals of walls that are a share of a surface, largest first."""
    vertices, faces = arrays(surface)
    tri = vertices[faces]
    normals = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(areas, 1e-300)[:, None]
    out, left = [], areas.copy()
    while left.max(initial=0.0) > 0:
        wall = normals[left.argmax()]
        own = (normals @ wall > SAME) & (left > 0)
        if areas[own].sum() >= least * areas.sum():
            mean = areas[own] @ normals[own]
            out.append((areas[own].sum(), mean / np.linalg.norm(mean)))
        left[own] = 0.0
        left[left.argmax()] = 0.0
    return np.array([wall for _, wall in sorted(out, key=lambda one: -one[0])]).reshape(-1, 3)


def _flush(own: F64, base: F64, axis: F64) -> list[float]:
    """Return the angles about an axis, least first, at which walls of both lie along each other."""
    angles = []
    for wall in own:
        for other in (*base, *-base):
            a, b = (n - axis * (axis @ n) for n in (wall, other))
            if min(np.linalg.norm(a), np.linalg.norm(b)) > ACROSS and abs(
                    axis @ (wall - other)) < LEVEL:
                angles.append(float(np.arctan2(axis @ np.cross(a, b), a @ b)))
    near = np.sort([angle for angle in angles if LEAST < angle < AJAR])
    return [float(one.mean()) for one in np.split(near, np.flatnonzero(np.diff(near) > BEYOND) + 1)
            if len(one)]


def _to(place: Place, end: _End) -> Place:
    """Return a place in which one part, at its observed end, goes on until it is shut."""
    joints = tuple(replace(joint, value=end.value - end.start if k == end.part else 0.0)
                   for k, joint in enumerate(place.joints, 1))
    return cast("Place", SimpleNamespace(count=place.count, joints=joints, parents=place.parents))


def _meets(surfaces: Sequence[Manifold], joint: Joint, end: _End) -> bool:
    """Say whether a part runs into the base as soon as it goes on beyond where it is shut."""
    part, sign = surfaces[end.part], np.sign(end.value - end.start)
    at, beyond = (part.transform(joint.transform(q)[:3])
                  for q in (end.value, end.value + sign * BEYOND))
    passed = float((beyond - at).volume())
    return float((beyond ^ surfaces[0]).volume()) > SUNK * passed


def _in_the_way(base: Manifold, pieces: Sequence[Manifold], place: Place,
                maps: Sequence[PartMaps], end: _End, voxel: float) -> bool:
    """Say whether photos saw the base where a part passes on its way to being shut."""
    joint = place.joints[end.part - 1]
    points = _seen(base, maps, voxel)
    lever = np.linalg.norm(np.cross(points - joint.origin, joint.axis), axis=1)
    early = NOISE * voxel / np.maximum(lever, voxel)  # before it is shut, rad
    whole = abs(end.value - end.start)
    passed, own = np.zeros(len(points), bool), [corners_of(piece) for piece in pieces]
    walls = [planes_of(corners) for corners in own]
    for way in np.arange(0.0, whole, STEP):
        q = end.start + np.sign(end.value - end.start) * way
        left = np.flatnonzero(~passed & (way < whole - early))
        back = apply(inverse(joint.transform(q)), points[left])
        passed[left] = _inside(own, walls, back, 0.5 * voxel)
    corners = np.concatenate(own)
    near = np.all((points >= corners.min(0)) & (points <= corners.max(0)), axis=1)
    return bool(passed.sum() > CROSSED * max(near.sum(), 1))


def _inside(pieces: Sequence[F64], walls: Sequence[F64], points: F64, depth: float) -> Mask:
    """Return [N] which points are so deep inside a convex piece, of its corners and planes."""
    inside = np.zeros(len(points), bool)
    for corners, planes in zip(pieces, walls, strict=True):
        near = np.all((points >= corners.min(0)) & (points <= corners.max(0)), axis=1) & ~inside
        if len(planes) and near.any():
            inside[near] = (points[near] @ planes[:, :3].T + planes[:, 3]).max(1) < -depth
    return inside


def _seen(base: Manifold, maps: Sequence[PartMaps], voxel: float) -> F64:
    """Return points of the base's surface that photos of either state saw."""
    points, _ = arrays(base.refine_to_length(2 * voxel))
    own = [replace(one.maps, depths=np.where(one.labels == 0, one.maps.depths, np.float32(0)))
           for one in maps]  # what lies behind a door lies near it as well
    votes = [observe(points, one, NOISE * voxel).surface for one in own]
    return points[np.maximum(*votes) >= VOTES]
