"""Bodies: a slide that is two bodies, each with a front of its own, is two parts that slid alike.

Who photographs a chest shut and then with every drawer pulled out as far as it goes shows one
motion of many drawers. No photo tells them from one part then. That nothing joins them does, or
where they touch, lines from edge to edge between fronts that look alike.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
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
    """Return the motion with a part for every body of its slides, or notes of what may be several.

    What turns is left as it is: few things turn alike, and a wire's arc often breaks in two.

    Args:
        scene: posed images of both states.
        gaussians: of both states.
        motion: part identities and joints.
        parts: built by it, base first.
        most: moving parts, if their number was given.
    """
    new = motion
    for k, (part, joint) in enumerate(zip(parts[1:], motion.joints, strict=True), 1):
        if joint.kind != "prismatic":
            continue
        bodies, there = _bodies(part.mesh, joint), _at_state_1(motion, k)
        units = (units_of(part.mesh, joint, scene.states, (np.eye(4), there))
                 if len(bodies) == 1 else None)
        count = len(units.cuts) + 1 if units else len(bodies)
        several = (units.alike if units else
                   count > 1 and all(broad_front(to_mesh(body), joint) for body in bodies))
        if several and len(new.joints) + count - 1 <= (most or np.inf):
            sort = units.of if units else partial(_nearest, [sprinkled(one) for one in bodies])
            clouds = (gaussians[0].means.astype(float), _carried(parts, motion, k),
                      apply(inverse(there), gaussians[1].means.astype(float)))
            new = _shared_out(new, k, count, [sort(cloud) for cloud in clouds])
        elif units:
            new = replace(new, notes=(*new.notes, _doubted(part.name, count)))
    return new


def _shared_out(motion: Motion, part: int, count: int, of: Sequence[I64]) -> Motion:
    """Return the motion with as many parts as a part is.

    Args:
        motion: with it as one.
        part: its number.
        count: of what it is.
        of: which of these are the Gaussians of state 0, points of what it carries, and the
            Gaussians of state 1.
    """
    before, carried, after = of
    # What carries a part keeps its number: parents come before children.
    home = np.bincount(carried, minlength=count).argmax()
    # How sure it was as one says nothing of how sure each is.
    rows = tuple({**row, **({"prices_saved": np.nan} if k == part else {})}
                 for k, row in enumerate(motion.diagnostics, 1))
    note = _told(part, len(motion.joints) + 1, count)
    new = replace(motion, diagnostics=rows, notes=(*motion.notes, note))
    for body in set(range(count)) - {home}:
        new = with_part(new, part, (before == body, after == body))
    logger.info("part %d moved as one and is %d: as many parts", part, count)
    return new


def _at_state_1(motion: Motion, part: int) -> F64:
    """Return [4, 4] where a part is in state 1, from where it is in state 0."""
    values = [joint.value for joint in motion.joints]
    return chain(part, motion.joints, motion.parents, values)


def _doubted(name: str, count: int) -> str:
    return (f"Lines from edge to edge divide the front of {name} into {count}. If these are parts "
            "of their own that moved alike, photograph them open by different amounts: then each "
            "is found.")


def _told(part: int, first: int, count: int) -> str:
    names = ", ".join(f"part_{k}" for k in range(first, first + count - 1))
    return (f"part_{part} and {names} moved alike between the states, in one direction by one "
            "amount or nearly. Photos cannot tell such parts from one; as nothing joins their "
            "bodies, or their fronts look alike between lines from edge to edge, each is a part.")


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
