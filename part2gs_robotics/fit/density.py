"""Where Gaussians are added and removed during a fit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.fit.hull import Hull
from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.se3 import rotation_from_quats
from part2gs_robotics.runtime.adam import Adam

Params = dict[str, F32]

FAINT = 0.03  # opacity: below, a Gaussian changes no pixel by more than a few grey levels
OUTSIDE = 1.5  # voxels: a centre this far outside the silhouettes is a floater
SPLIT_SHARE = 0.25  # at most this share of all Gaussians is split at one time
SHRINK = 1.0 / 1.6  # 3DGS: each half of a split Gaussian is this much smaller along the split
SPREAD = 0.7  # of sigma: distance of the halves from the old centre; keeps the old outline


@dataclass
class Density:
    """Screen-space gradients since the last change, and the rules that use them."""

    hull: Hull | None
    max_gaussians: int
    total: F32 = field(default_factory=lambda: np.zeros(0, np.float32))
    seen: F32 = field(default_factory=lambda: np.zeros(0, np.float32))

    def add(self, gradients: F32, visible: NDArray[np.bool_]) -> None:
        """Remember one step's mean absolute screen gradients [N]."""
        if len(self.total) != len(gradients):
            self.total = np.zeros(len(gradients), np.float32)
            self.seen = np.zeros(len(gradients), np.float32)
        self.total += np.where(visible, gradients, 0)
        self.seen += visible

    def change(self, params: Params, adam: Adam, target: int) -> Params:
        """Prune, then split the Gaussians with the largest gradients up to `target` in all."""
        need = self.total / np.maximum(self.seen, 1)
        keep = ~self._useless(params)
        if not keep.any():
            return params  # the caller's loss will tell; an empty fit tells nothing
        params = {name: np.ascontiguousarray(value[keep]) for name, value in params.items()}
        adam.select(keep)
        need = need[keep]
        room = min(target, self.max_gaussians) - len(need)
        count = max(0, min(room, int(SPLIT_SHARE * len(need))))
        if count:
            pick = np.sort(np.argpartition(-need, count - 1)[:count])
            params = _split(params, adam, pick[need[pick] > 0])
        self.total = np.zeros(0, np.float32)
        return params

    def _useless(self, params: Params) -> NDArray[np.bool_]:
        """Return which Gaussians are faint, unseen for long, or outside the silhouettes."""
        faint = params["logit_opacities"] < np.log(FAINT / (1 - FAINT))
        if self.hull is None:
            return np.asarray(faint)
        return np.asarray(faint | (self.hull.sample(params["means"]) < -OUTSIDE * self.hull.voxel))


def _split(params: Params, adam: Adam, pick: NDArray[np.int64]) -> Params:
    """Replace each picked Gaussian by two along its longest axis."""
    scales = np.exp(params["log_scales"][pick])
    axis = scales.argmax(1)
    rows = np.arange(len(pick))
    turn = rotation_from_quats(params["quats"][pick])
    offset = (turn[rows, :, axis] * (SPREAD * scales[rows, axis])[:, None]).astype(np.float32)
    children = {name: value[pick].copy() for name, value in params.items()}
    children["log_scales"][rows, axis] += np.float32(np.log(SHRINK))
    old = {name: value.copy() for name, value in params.items()}
    old["log_scales"][pick, axis] = children["log_scales"][rows, axis]
    old["means"][pick] -= offset
    children["means"] += offset
    adam.append(len(pick))
    return {name: np.concatenate([old[name], children[name]]) for name in params}
