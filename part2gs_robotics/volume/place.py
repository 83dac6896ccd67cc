"""Place: where every part is in either state, for meshing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.kinematics import chain
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.se3 import apply, inverse, rotation_from_quats

SOLID_OPACITY = 0.3  # fainter Gaussians are haze, no surface
LONG = 1.5  # standard deviations: where a Gaussian of full opacity is a third as opaque


class Place:
    """Where every part is in either state, and the Gaussians carried back to state 0.

    Attributes:
        points: of every part, [N, 3] means.  ends: [N, 2, 3] of the lines that they lie
            along, where longer than wide.
        colors: [N, 3].
    """

    def __init__(self, gaussians: tuple[Gaussians, Gaussians], motion: Motion) -> None:
        self.joints, self.parents = motion.joints, motion.parents
        self.count = len(motion.joints) + 1
        values = [j.value for j in motion.joints]
        self.state1_from_0 = [chain(k, self.joints, self.parents, values)
                              for k in range(self.count)]
        self.points: list[F64] = []
        self.ends: list[F64] = []
        self.colors: list[NDArray[np.float64]] = []
        self.num_gaussians: list[int] = []
        for k in range(self.count):
            mine = [g.select((motion.labels(s) == k) & (g.opacities > SOLID_OPACITY))
                    for s, g in enumerate(gaussians)]
            to_0 = inverse(self.state1_from_0[k])
            back = apply(to_0, mine[1].means.astype(float))
            self.points.append(np.concatenate([mine[0].means.astype(float), back]))
            way = np.concatenate([_half(mine[0]), _half(mine[1]) @ to_0[:3, :3].T])
            self.ends.append(np.stack([self.points[k] - way, self.points[k] + way], 1))
            self.colors.append(np.concatenate([g.colors for g in mine]).astype(float))
            self.num_gaussians.append(sum(int((motion.labels(s) == k).sum()) for s in (0, 1)))

    def box(self, part: int) -> tuple[F64, F64]:
        """Return the box of a part's Gaussians at state 0."""
        return self.points[part].min(0), self.points[part].max(0)

    def keep(self, part: int, which: NDArray[np.bool_]) -> None:
        """Leave out a part's other Gaussians."""
        for each in (self.points, self.ends, self.colors):
            each[part] = each[part][which]


def _half(gaussians: Gaussians) -> F64:
    """Return [N, 3] from a mean to an end of what is longer of it than wide: discs have none."""
    axes, rows = rotation_from_quats(gaussians.quats.astype(float)), np.arange(len(gaussians))
    _, wide, long = np.sort(gaussians.scales, 1).astype(float).T
    longest = gaussians.scales.argmax(1)
    return np.asarray(LONG * (long - wide)[:, None] * axes[rows, :, longest])
