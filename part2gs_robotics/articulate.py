"""Motion: which Gaussian belongs to which part, and how every part moves."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.joints import Joint


@dataclass(frozen=True)
class Motion:
    """Result of the articulation room.

    Attributes:
        part_probs: per state, [N_s, K+1] float32 part identity of every Gaussian; column 0 = base.
        joints: K joints, of parts 1..K.
        parents: K parent part indices (0 = base).
        diagnostics: per moving part, losses and residuals by name.
        notes: decisions worth reporting.
    """

    part_probs: tuple[NDArray[np.float32], NDArray[np.float32]]
    joints: tuple[Joint, ...]
    parents: tuple[int, ...]
    diagnostics: tuple[dict[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)

    def labels(self, state: int) -> NDArray[np.int64]:
        """Return [N_s] the most likely part of every Gaussian of a state."""
        return np.asarray(self.part_probs[state].argmax(1), np.int64)
