"""Shut: doors that stand ajar are free to close until they lie flat on the base.

A door or lid was photographed a little open; what is behind it, nobody saw, and the mesh made up
there stops it at once. But made things shut flush: at the end of its way a door's faces lie along
those of the base. Where they do, and the part runs into the base right beyond, the base yields to
the whole way up to there, unless photos saw what would have to: a surface well before the end, or
anything that the background showed the outline of.
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
from part2gs_robotics.mesh.see_through import torn
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
SUNK = 0.0015  # of what the part passes there: doors and lids had 0.002 to 2, in the air 0.0006
STEP = np.deg2rad(1.0)  # between places on the way at which seen points are looked for
EARLY = 9.0  # voxels before it is shut: rooms without texture stood as far out, of two objects
BESIDE = 1.5  # voxels beside a part's edges: surfaces and depths are as wrong
VOTES = 0.05  # of a state's photos see a point of the base: labels are wrong in fewer
CROSSED = 0.01  # of the base's seen points nearby that may lie in the way


@dataclass(frozen=True)
class End:
    """An end of a way beyond what was observed.

    Attributes:
        part: that goes there.  value: of its joint, rad.  start: the observed one before it.
    """

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
    for end in flush_ends(surfaces, place):
        joint, own = place.joints[end.part - 1], pieces[end.part]
        if (end.part, end.start) in done or not own or not meets(out, joint, end):
            continue
        cut = let_by(out, own, place, maps, end, voxel)
        if cut is not None and meets([cut, *out[1:]], joint, end):
            logger.info("part %d shuts flush %.1f degrees beyond a state", end.part,
                        np.rad2deg(abs(end.value - end.start)))
            out[0] = cut
            done.add((end.part, end.start))
    return out


def flush_ends(surfaces: Sequence[Manifold], place: Place) -> list[End]:
    """Return where parts that turn on the base come to lie along it, for each the nearest first.

    Args:
        surfaces: closed, base first, world frame at state 0.
        place: joints, and the part that carries each.
    """
    found, base = [], _walls(surfaces[0], PLANE)
    for k, (joint, parent) in enumerate(zip(place.joints, place.parents, strict=True), 1):
        if joint.kind != "revolute" or parent != 0:
            continue
        own = _walls(surfaces[k], WALL)
        for start, sign in ((min(0.0, joint.value), -1.0), (max(0.0, joint.value), 1.0)):
            turned = own @ joint.transform(start)[:3, :3].T
            found += [End(k, start + sign * angle, start)
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


def meets(surfaces: Sequence[Manifold], joint: Joint, end: End) -> bool:
    """Say whether a part runs into the base as soon as it goes on beyond where it is shut.

    Args:
        surfaces: closed, base first.
        joint: of the part.
        end: where it lies along the base.
    """
    part, sign = surfaces[end.part], np.sign(end.value - end.start)
    at, beyond = (part.transform(joint.transform(q)[:3])
                  for q in (end.value, end.value + sign * BEYOND))
    passed = float((beyond - at).volume())
    return float((beyond ^ surfaces[0]).volume()) > SUNK * passed


def let_by(surfaces: Sequence[Manifold], pieces: Sequence[Manifold], place: Place,
           maps: Sequence[PartMaps], end: End, voxel: float) -> Manifold | None:
    """Return the base without what a part passes on its way to an end.

    None if photos saw that, or nothing can be taken.

    Args:
        surfaces: closed, base first, world frame at state 0.
        pieces: convex: what the part is the union of.
        place: joints, and the part that carries each.
        maps: what photos of both states saw.
        end: of the way.
        voxel: size of the grid's cells, scene units.
    """
    if _in_the_way(surfaces[0], pieces, place, maps, end, voxel):
        return None
    joint, at = place.joints[end.part - 1], end.start
    joints = tuple(replace(one, value=end.value - at if one is joint else 0.0)
                   for one in place.joints)
    onward = cast("Place", SimpleNamespace(count=place.count, joints=joints,
                                           parents=place.parents))
    cut = base_apart(surfaces[0], end.part,
                     [piece.transform(joint.transform(at)[:3]) for piece in pieces], onward, voxel)
    if cut is surfaces[0] or torn(surfaces, [cut, *surfaces[1:]], place, maps, voxel):
        return None
    return cut


def _in_the_way(base: Manifold, pieces: Sequence[Manifold], place: Place,
                maps: Sequence[PartMaps], end: End, voxel: float) -> bool:
    """Say whether photos saw the base where a part passes on its way to an end.

    What it passes beside its edges by less than the noise of surfaces is not in its way.
    """
    left, corners = _seen(base, maps, voxel), [corners_of(piece) for piece in pieces]
    every = np.concatenate(corners)
    near = np.all((left >= every.min(0)) & (left <= every.max(0)), axis=1)
    body = [(own, planes) for own in corners if len(planes := planes_of(own))]
    joint = place.joints[end.part - 1]
    for along, out in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        arm = left - joint.origin
        arm -= np.outer(arm @ joint.axis, joint.axis)
        arm /= np.maximum(np.linalg.norm(arm, axis=1, keepdims=True), 1e-9 * voxel)
        moved = left + BESIDE * voxel * (along * joint.axis + out * arm)
        left = left[_passed(moved, body, joint, end, voxel)]
    return bool(len(left) > CROSSED * max(near.sum(), 1))


def _passed(points: F64, body: Sequence[tuple[F64, F64]], joint: Joint, end: End,
            voxel: float) -> Mask:
    """Return [N] through which points a body of convex pieces goes before it is nearly shut."""
    heights, levers = _about(points, joint)
    early = EARLY * voxel / np.maximum(levers, voxel)  # before it is shut, rad
    whole, passed = abs(end.value - end.start), np.zeros(len(points), bool)
    ways = np.arange(0.0, whole, STEP)
    back = [inverse(joint.transform(end.start + np.sign(end.value - end.start) * way))
            for way in ways]
    for corners, planes in body:
        own_heights, own_levers = _about(corners, joint)  # a turn changes neither
        left = np.flatnonzero((heights >= own_heights.min()) & (heights <= own_heights.max())
                              & (levers <= own_levers.max()) & ~passed)
        for way, pose in zip(ways, back, strict=True):
            left = left[way < whole - early[left]]
            met = _inside(corners, planes, apply(pose, points[left]), 0.5 * voxel)
            passed[left[met]] = True
            left = left[~met]
    return passed


def _about(points: F64, joint: Joint) -> tuple[F64, F64]:
    """Return [N] heights along an axis and [N] distances from it."""
    arm = points - joint.origin
    return arm @ joint.axis, np.linalg.norm(np.cross(arm, joint.axis), axis=1)


def _inside(corners: F64, planes: F64, points: F64, depth: float) -> Mask:
    """Return [N] which points are so deep inside a convex piece."""
    (x, y, z), low, high = points.T, corners.min(0), corners.max(0)
    inside = ((x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
              & (z >= low[2]) & (z <= high[2]))
    if inside.any():
        inside[inside] = (points[inside] @ planes[:, :3].T + planes[:, 3]).max(1) < -depth
    return np.asarray(inside)


def _seen(base: Manifold, maps: Sequence[PartMaps], voxel: float) -> F64:
    """Return points of the base's surface that photos of either state saw."""
    points, _ = arrays(base.refine_to_length(2 * voxel))
    seen = np.zeros(len(points), bool)
    for one in maps:
        # What lies behind a door lies near it as well.
        own = replace(one.maps, depths=np.where(one.labels == 0, one.maps.depths, np.float32(0)))
        seen |= observe(points, own, BESIDE * voxel).surface >= VOTES * len(one.labels)
    return points[seen]
