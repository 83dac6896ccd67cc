"""Bodies: a moving part in two bodies is two parts that moved alike, by as much and as far.

Who photographs a chest shut and then with every drawer pulled out as far as it goes shows one
motion of many drawers. No photo tells them from one part then. That nothing joins them does, or
where they touch, that their fronts repeat.
"""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from part2gs_robotics.boards.fronts import Units, units_of
from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion, with_part
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.model.solids import sprinkled, to_manifold
from part2gs_robotics.model.twin import Part, PartMesh

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
        bodies = _bodies(part.mesh, motion.joints[k - 1])
        units = None if len(bodies) > 1 else _units(scene, motion, parts, k)
        count = len(units.cuts) + 1 if units and units.alike else len(bodies)
        if count < 2 or len(new.joints) + count - 1 > (most or np.inf):
            continue
        clouds = (*_at_state_0(gaussians, motion, k), _carried(parts, motion, k))
        sorted_ = [units.of(cloud) if units else _nearest(bodies, cloud) for cloud in clouds]
        # What carries a part keeps its number: parents come before children.
        home = np.bincount(sorted_[2], minlength=count).argmax()
        others = [body for body in range(count) if body != home]
        new = replace(new, notes=(*new.notes, _told(k, len(new.joints) + 1, count)))
        for body in others:
            new = with_part(new, k, (sorted_[0] == body, sorted_[1] == body))
        logger.info("part %d is %d bodies that nothing joins: as many parts", k, count)
    return new


def _units(scene: Scene, motion: Motion, parts: tuple[Part, ...], part: int) -> Units | None:
    values = [joint.value for joint in motion.joints]
    there = chain(part, motion.joints, motion.parents, values)
    return units_of(parts[part].mesh, motion.joints[part - 1], scene.states, (np.eye(4), there))


def lined(scene: Scene, motion: Motion, parts: tuple[Part, ...]) -> list[str]:
    """Return a note of every part whose front lines divide from edge to edge."""
    found = [(parts[k].name, units) for k in range(1, len(parts))
             if (units := _units(scene, motion, parts, k))]
    return [f"Lines from edge to edge divide the front of {name} into {len(units.cuts) + 1}. If "
            "these are parts of their own that moved alike, photograph them open by different "
            "amounts: then each is found." for name, units in found]


def _told(part: int, first: int, count: int) -> str:
    names = ", ".join(f"part_{k}" for k in range(first, first + count - 1))
    return (f"part_{part} and {names} moved alike between the states, in one direction by one "
            "amount. Photos cannot tell such parts from one; as nothing joins their bodies, or "
            "their fronts look alike between lines from edge to edge, each is a part.")


def _bodies(mesh: PartMesh, joint: Joint) -> list[F64]:
    """Return points on the surface of every body that is no detail, the largest first.

    What goes the same way as another body, before or behind it, is of one body with that: a
    drawer's back, whose floor no photo shows.
    """
    solids = sorted(to_manifold(mesh).decompose(), key=lambda solid: -float(solid.volume()))
    large = [solid for solid in solids
             if float(solid.volume()) > max(0.0, BODY * float(solids[0].volume()))]
    bodies: list[F64] = []
    for points in map(sprinkled, large):
        behind = [k for k, body in enumerate(bodies) if _one_way(points, body, joint)]
        apart = [body for k, body in enumerate(bodies) if k not in behind]
        bodies = [*apart, np.concatenate([*(bodies[k] for k in behind), points])]
    return sorted(bodies, key=lambda body: -len(body))


def _one_way(one: F64, other: F64, joint: Joint) -> bool:
    """Return whether two bodies would leave traces one over the other if they moved on and on."""
    from manifold3d import CrossSection

    shadows = [CrossSection.hull_points(_across(points, joint)) for points in (one, other)]
    shared = (shadows[0] ^ shadows[1]).area()
    return bool(shared > COVERED * min(shadow.area() for shadow in shadows))


def _across(points: F64, joint: Joint) -> F64:
    """Return [N, 2] places across the way of a joint: off its slide, or off and along its axis."""
    from scipy.linalg import null_space

    off = points - joint.origin
    along = off @ joint.axis
    if joint.turns:
        return np.stack([np.linalg.norm(off - along[:, None] * joint.axis, axis=1), along], 1)
    return np.asarray(off @ null_space(joint.axis[None]))


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
