"""What a build found, on its way from the corridor to the files of the twin folder."""

from __future__ import annotations

from dataclasses import dataclass

from part2gs_robotics.config import Config
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.scene_frame import SceneFrame
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.plan import Plan
from part2gs_robotics.stages import Fitted


@dataclass(frozen=True)
class BuildResult:
    """All that a build found, for those who write it down.

    Attributes:
        scene: what was read, in internal units like the fits.
        frame: scene_from_internal.
        fits: Gaussians and curve of both states.
        motion: part identities of these Gaussians.
        left: what it does not explain.
        twin: what was built, in the scene's frame.
        plan: settled decisions.
        config: resolved settings.
        seconds: wall time per stage.
    """

    scene: Scene
    frame: SceneFrame
    fits: tuple[Fitted, Fitted]
    motion: Motion
    left: LeftOver
    twin: Twin
    plan: Plan
    config: Config
    seconds: dict[str, float]


@dataclass(frozen=True)
class Told:
    """What is settled before the twin is written; `left` by the motion, key = of the meshes."""

    plan: Plan
    fits: tuple[Fitted, Fitted]
    motion: Motion
    left: LeftOver
    key: str
