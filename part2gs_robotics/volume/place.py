"""Place: where every part is in either state, for meshing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.se3 import apply, inverse

SOLID_OPACITY = 0.3  # fainter Gaussians are haze, no surface


class Place:
    """Where every part is in either state, and the Gaussians carried back to state 0."""

    def __init__(self, gaussians: tuple[Gaussians, Gaussians], motion: Motion) -> None:
        self.joints, self.parents = motion.joints, motion.parents
        self.count = len(motion.joints) + 1
        values = [j.value for j in motion.joints]
        self.state1_from_0 = [chain(k, self.joints, self.parents, values)
                              for k in range(self.count)]
        self.points: list[F64] = []
        self.colors: list[NDArray[np.float64]] = []
        self.num_gaussians: list[int] = []
        for k in range(self.count):
            mine = [g.select((motion.labels(s) == k) & (g.opacities > SOLID_OPACITY))
                    for s, g in enumerate(gaussians)]
            back = apply(inverse(self.state1_from_0[k]), mine[1].means.astype(float))
            self.points.append(np.concatenate([mine[0].means.astype(float), back]))
            self.colors.append(np.concatenate([g.colors for g in mine]).astype(float))
            self.num_gaussians.append(sum(int((motion.labels(s) == k).sum()) for s in (0, 1)))

    def box(self, part: int) -> tuple[F64, F64]:
        """Return the box of a part's Gaussians at state 0."""
        return self.points[part].min(0), self.points[part].max(0)
