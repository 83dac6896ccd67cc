"""Real parts: a motion that leaves no solid is no part of a twin."""

from __future__ import annotations

import logging

from part2gs_robotics.articulate import Motion, without_part
from part2gs_robotics.config import MeshConfig
from part2gs_robotics.errors import EmptyPartError
from part2gs_robotics.gaussians import Gaussians
from part2gs_robotics.meshing import build_parts
from part2gs_robotics.scene import Scene
from part2gs_robotics.twin import Part

logger = logging.getLogger(__name__)


def build_existing(scene: Scene, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                   config: MeshConfig) -> tuple[Motion, tuple[Part, ...]]:
    """Build the parts that have a solid; see `build_parts`.

    A part without one is left out with a note: a motion that explains a few surfels by chance is no
    part of a twin.

    Returns:
        The motion without parts that were left out, and its parts.

    Raises:
        MeshError: the base, the last moving part, or a part that carries another has no solid.
    """
    while True:
        try:
            return motion, build_parts(scene, gaussians, motion, config)
        except EmptyPartError as err:
            alone = len(motion.joints) == 1 or err.part == 0 or err.part in motion.parents
            if alone:
                raise
            logger.warning("left out: %s", err)
            motion = without_part(motion, err.part, f"A motion was left out as no part. {err}")
