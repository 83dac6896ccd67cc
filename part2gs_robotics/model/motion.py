"""What the articulation finds: the part of every Gaussian, and the joints."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import Mask
from part2gs_robotics.model.joint import Joint

FAILED = "Failed for a part:"  # begins the note of a part that was decided on but not built


@dataclass(frozen=True)
class Motion:
    """Result of the articulation room.

    Attributes:
        part_probs: per state, [N_s, K+1] float32 part identity of every Gaussian; column 0 = base.
        joints: K joints, of parts 1..K.
        parents: K parent part indices (0 = base).
        diagnostics: per moving part, losses and residuals by name.
        notes: decisions worth reporting.
        unbuilt: joints of parts that were decided on, but of which nothing could be built; `failed`
            says why, in the same order.
        shades: [8] of the light that it was found in, see `evidence.light.Light`; all 0 = even.
    """

    part_probs: tuple[NDArray[np.float32], NDArray[np.float32]]
    joints: tuple[Joint, ...]
    parents: tuple[int, ...]
    diagnostics: tuple[dict[str, float], ...] = ()
    notes: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    unbuilt: tuple[Joint, ...] = ()
    shades: tuple[float, ...] = (0.0,) * 8

    @property
    def failed(self) -> tuple[str, ...]:
        """What is said of parts that were decided on, but of which nothing could be built."""
        return tuple(note for note in self.notes if note.startswith(FAILED))

    def labels(self, state: int) -> NDArray[np.int64]:
        """Return [N_s] the most likely part of every Gaussian of a state."""
        return np.asarray(self.part_probs[state].argmax(1), np.int64)


@dataclass(frozen=True)
class LeftOver:
    """What of the moved surface no part explains.

    Attributes:
        share: of the moved surface of both states, by area, 0..1.
        bound: the most that noise of the same scene makes of it.
        views: per state, the photo that shows most of it; -1 = there is none.
        marks: per state, [H, W] where that photo shows it.
    """

    share: float
    bound: float
    views: tuple[int, int]
    marks: tuple[Mask, Mask]

    @property
    def complete(self) -> bool:
        """Whether the parts explain all that moved but for noise."""
        return self.share <= self.bound


def without_part(motion: Motion, part: int, note: str) -> Motion:
    """Return the motion without a part that carries none; what it had goes to its carrier.

    Args:
        motion: with the part.
        part: 1..K.
        note: why, worth reporting.
    """
    keep = [k for k in range(len(motion.joints)) if k != part - 1]
    probs = []
    for old in motion.part_probs:
        new = np.delete(old, part, axis=1)
        parent = motion.parents[part - 1]
        new[:, parent - (parent > part)] += old[:, part]
        probs.append(new)
    return replace(
        motion, part_probs=(probs[0], probs[1]), joints=tuple(motion.joints[k] for k in keep),
        parents=tuple(p - (p > part) for p in (motion.parents[k] for k in keep)),
        diagnostics=tuple(d for k, d in enumerate(motion.diagnostics) if k != part - 1),
        notes=(*motion.notes, note), unbuilt=(*motion.unbuilt, motion.joints[part - 1]))


def with_part(motion: Motion, part: int, own: tuple[Mask, Mask]) -> Motion:
    """Return the motion with one more part, the last, which moves as another does.

    Args:
        motion: with the other part.
        part: that one, 1..K.
        own: per state, [N_s] which Gaussians the new part takes of what the other has.
    """
    probs = []
    for old, mine in zip(motion.part_probs, own, strict=True):
        new = np.where(mine, old[:, part], 0.0)[:, None].astype(old.dtype)
        probs.append(np.concatenate([old, new], axis=1))
        probs[-1][mine, part] = 0.0
    return replace(
        motion, part_probs=(probs[0], probs[1]), joints=(*motion.joints, motion.joints[part - 1]),
        parents=(*motion.parents, motion.parents[part - 1]),
        diagnostics=(*motion.diagnostics, *motion.diagnostics[part - 1:part]))
