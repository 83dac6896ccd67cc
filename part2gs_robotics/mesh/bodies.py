"""Bodies: a slide that is two bodies, each with a front of its own, is two parts that slid alike.

Who photographs a chest shut and then with every drawer pulled out as far as it goes shows one
motion of many drawers. No photo tells them from one part then. That nothing joins them does, or
where they touch, lines from edge to edge between fronts that look alike.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.boards.fronts import broad_front, units_of
from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion, with_part
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.solids import arrays, sprinkled, to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh

if TYPE_CHECKING:
    from manifold3d import Manifold

BODY = 0.25  # of the largest, by volume: less is a detail
COVERED = 0.5  # of the smaller trace: a drawer's back has all, another drawer next to nothing
logger = logging.getLogger(__name__)


def parted(scene: Scene, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
           parts: tuple[Part, ...], most: int | None = None) -> Motion:
    """Return the motion with a part for every body of its moving parts.

    Args:
        scene: posed images of both states.
        gaussians: of both states.
        motion: part identities and joints.
        parts: built by it, base first.
        most: moving parts, if their number was given.
    """
    new = motion
    for k, part in enumerate(parts[1:], 1):
        clouds = (*_at_state_0(gaussians, motion, k), _carried(parts, motion, k))
        found = _shared_out(scene, motion, part, k, clouds)
        if found is None or len(new.joints) + found[0] - 1 > (most or np.inf):
            continue
        count, (before, after, carried) = found
        # What carries a part keeps its number: parents come before children.
        home = np.bincount(carried, minlength=count).argmax()
        new = replace(new, notes=(*new.notes, _told(k, len(new.joints) + 1, count)))
        for body in set(range(count)) - {home}:
            new = with_part(new, k, (before == body, after == body))
        logger.info("part %d moved as one and is %d: as many parts", k, count)
    return new


def _shared_out(scene: Scene, motion: Motion, part: Part, number: int, clouds: Sequence[F64],
            ) -> tuple[int, list[I64]] | None:
    """Return how many parts a part is, and which of them every point is of; None = it is one."""
    joint, moves = motion.joints[number - 1], _moves(motion, number)
    if joint.kind != "prismatic":  # few things turn alike, and a wire's arc often breaks in two
        return None
    bodies = _bodies(part.mesh, joint)
    if len(bodies) > 1:
        if not all(broad_front(to_mesh(body), joint) for body in bodies):
            return None
        surfaces = [sprinkled(body) for body in bodies]
        return len(bodies), [_nearest(surfaces, cloud) for cloud in clouds]
    units = units_of(part.mesh, joint, scene.states, moves)
    if units is None or not units.alike:
        return None
    return len(units.cuts) + 1, [units.of(cloud) for cloud in clouds]


def _moves(motion: Motion, part: int) -> tuple[F64, F64]:
    """Return [4, 4] where a part is in both states."""
    values = [joint.value for joint in motion.joints]
    return np.eye(4), chain(part, motion.joints, motion.parents, values)


def lined(scene: Scene, motion: Motion, parts: tuple[Part, ...]) -> list[str]:
    """Return a note of every part whose front lines divide from edge to edge."""
    found = [(parts[k].name, units) for k, joint in enumerate(motion.joints, 1)
             if (units := units_of(parts[k].mesh, joint, scene.states, _moves(motion, k)))]
    return [f"Lines from edge to edge divide the front of {name} into {len(units.cuts) + 1}. If "
            "these are parts of their own that moved alike, photograph them open by different "
            "amounts: then each is found." for name, units in found]


def _told(part: int, first: int, count: int) -> str:
    names = ", ".join(f"part_{k}" for k in range(first, first + count - 1))
    return (f"part_{part} and {names} moved alike between the states, in one direction by one "
            "amount. Photos cannot tell such parts from one; as nothing joins their bodies, or "
            "their fronts look alike between lines from edge to edge, each is a part.")


def _bodies(mesh: PartMesh, joint: Joint) -> list[Manifold]:
    """Return the bodies of a mesh that are no detail, the largest first.

    What goes the same way as another body, before or behind it, is of one body with that: a
    drawer's back, whose floor no photo shows.
    """
    from manifold3d import Manifold

    solids = sorted(to_manifold(mesh).decompose(), key=_volume, reverse=True)
    bodies: list[Manifold] = []
    for solid in solids:
        if _volume(solid) <= max(0.0, BODY * _volume(solids[0])):
            break
        behind = [k for k, body in enumerate(bodies) if _one_way(solid, body, joint)]
        apart = [body for k, body in enumerate(bodies) if k not in behind]
        bodies = [*apart, Manifold.compose([*(bodies[k] for k in behind), solid])]
    return sorted(bodies, key=_volume, reverse=True)


def _volume(solid: Manifold) -> float:
    return float(solid.volume())


def _one_way(one: Manifold, other: Manifold, joint: Joint) -> bool:
    """Return whether two bodies would leave traces one over the other if they moved on and on."""
    from manifold3d import CrossSection

    shadows = [CrossSection.hull_points(_across(arrays(body)[0], joint)) for body in (one, other)]
    shared = (shadows[0] ^ shadows[1]).area()
    return bool(shared > COVERED * min(shadow.area() for shadow in shadows))


def _across(points: F64, joint: Joint) -> F64:
    """Return [N, 2] places across the way of a slide."""
    from scipy.linalg import null_space

    return np.asarray(points @ null_space(joint.axis[None]))


def _carried(parts: tuple[Part, ...], motion: Motion, part: int) -> F64:
    """Return [N, 3] vertices of what a part carries, none where it carries nothing."""
    own = [parts[k].mesh.vertices for k, parent in enumerate(motion.parents, 1) if parent == part]
    return np.concatenate([np.zeros((0, 3)), *own])


def _nearest(bodies: list[F64], points: F64) -> I64:
    """Return [N] the number of the body that a point is nearest to."""
    from scipy.spatial import cKDTree

    return np.asarray(np.argmin([cKDTree(body).query(points)[0] for body in bodies], axis=0))


def _at_state_0(gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                part: int) -> tuple[F64, F64]:
    """Return [N_s, 3] where all Gaussians were if they moved with a part."""
    values = [joint.value for joint in motion.joints]
    back = inverse(chain(part, motion.joints, motion.parents, values))
    return (gaussians[0].means.astype(float), apply(back, gaussians[1].means.astype(float)))


def two_bodies(parts: tuple[Part, ...]) -> list[str]:
    """Return a note of every moving part in two bodies; nothing that photos show makes it one.

    Two parts that look alike and move nearly alike explain the photos nearly as well as one.
    """
    notes = []
    for part in parts[1:]:
        sizes = np.array([float(body.volume()) for body in to_manifold(part.mesh).decompose()])
        shares = np.sort(sizes[sizes > 0])[::-1] / max(sizes.sum(), 1e-300)
        if len(shares) > 1 and shares[1] > BODY * shares[0]:
            notes.append(f"{part.name} is two bodies or more, the largest with {shares[0]:.0%} and "
                         f"{shares[1]:.0%} of its volume, and no photo shows what holds them "
                         "together: it may be two parts that look alike and move nearly alike. "
                         "Look at it; --parts with one more parts them if photos can.")
    return notes
