"""Real parts: a motion that leaves no solid fails for its part, not for the whole twin."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import MeshConfig
from part2gs_robotics.errors import EmptyPartError
from part2gs_robotics.mesh.bodies import parted, two_bodies
from part2gs_robotics.mesh.build_parts import build_parts
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.motion import FAILED, Motion, without_part
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.twin import Part

logger = logging.getLogger(__name__)
TOLD = 5e-4  # of a part's volume: rounds to 0.1 %
CRUMB = 0.25  # of its Gaussians' extent: 96 solids have 0.54 at least, a reflection's had 0.03


def build_existing(scene: Scene, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                   config: MeshConfig, asked: int | None = None,
                   aligned: Callable[[Motion], Motion] | None = None,
                   ) -> tuple[Motion, tuple[Part, ...]]:
    """Build the parts that have a solid; see `build_parts`. A part in two bodies becomes two.

    A part without a solid fails, and with it what it carries: a note says so, its joint is kept in
    `Motion.unbuilt`, and the build ends with exit code 1.

    Args:
        scene: as of `build_parts`.
        gaussians: as of `build_parts`.
        motion: as of `build_parts`.
        config: as of `build_parts`.
        asked: number of moving parts, if it was given.
        aligned: returns a motion some of whose parts share a joint with one for each of them.

    Returns:
        The motion without parts that failed, and its parts.

    Raises:
        MeshError: the base has no solid.
    """
    found, parts = _with_solids(scene, gaussians, motion, config)
    alike = parted(scene, gaussians, found, parts, asked)
    if len(alike.joints) > len(found.joints):
        alike = aligned(alike) if aligned else alike
        alike, parts = _with_solids(scene, gaussians, alike, config)
    notes = *alike.notes, *_yielded(parts), *two_bodies(parts)
    return replace(alike, notes=notes), parts


def _with_solids(scene: Scene, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                 config: MeshConfig) -> tuple[Motion, tuple[Part, ...]]:
    """Return the motion of those parts that have a solid, and them."""
    while True:
        try:
            parts = build_parts(scene, gaussians, motion, config)
            require_bodies(parts, gaussians, motion)
            return motion, parts
        except EmptyPartError as err:
            if err.part == 0:
                raise
            motion = _without(motion, err.part, str(err))


def _yielded(parts: tuple[Part, ...]) -> list[str]:
    """Return a note of what was cut away for parts to move as they were observed to."""
    told = [f"{100 * share:.1f} % of {part.name}" for part in parts
            if (share := part.diagnostics["yielded"]) >= TOLD]
    return [f"In the way of motion that was observed, and cut away: {', '.join(told)}, by volume."
            ] if told else []


def _without(motion: Motion, part: int, why: str) -> Motion:
    """Return the motion without a part, and first without what it carries."""
    joint = motion.joints[part - 1]
    while part in motion.parents:
        k = motion.parents.index(part) + 1
        motion = _without(motion, k, f"part_{k}: part_{part}, which carries it, is not built.")
        part = next(n for n, other in enumerate(motion.joints, 1) if other is joint)
    note = f"{FAILED} {why} {_told(motion, part)}"
    logger.warning("%s", note)
    return without_part(motion, part, note)


def _told(motion: Motion, part: int) -> str:
    """Return the joint of a part, which the twin has not, as a sentence; in internal units."""
    joint = motion.joints[part - 1]
    axis, origin = (", ".join(f"{x:.6g}" for x in v) for v in (joint.axis, joint.origin))
    return (f"Its joint, in internal units: {joint.kind}, axis [{axis}], origin [{origin}], "
            f"{joint.value:.6g} between the states; in the scene's: report.json, unbuilt.")


def require_bodies(parts: tuple[Part, ...], gaussians: tuple[Gaussians, Gaussians],
                   motion: Motion) -> None:
    """Raise unless every moving part's solid is about as large as what its Gaussians cover.

    What shines through glass can move as a part does, and leaves a crumb of a solid or none.

    Args:
        parts: built, base first.
        gaussians: of both states.
        motion: part identities and joints.

    Raises:
        EmptyPartError: a solid is a crumb.
    """
    for k, part in enumerate(parts[1:], 1):
        clouds = [g.means[motion.labels(s) == k] for s, g in enumerate(gaussians)]
        covered = max(_extent(cloud) for cloud in clouds)
        solid = _extent(part.mesh.vertices)
        if solid < CRUMB * covered:
            raise EmptyPartError(
                f"{part.name}: its solid extends by {solid:.3g} scene units, its Gaussians by "
                f"{covered:.3g}. Needed a quarter of that at least; raise --resolution, give more "
                "views, or lower --parts if the part does not exist.", k)


def _extent(points: NDArray[np.floating]) -> float:
    """Return the root mean square distance of points from their mean, 0 without any."""
    return float(np.sqrt(points.astype(float).var(0).sum())) if len(points) else 0.0
