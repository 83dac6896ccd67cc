"""Which photos to match: neighbours on the walk, and those that share their largest features."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32

LARGEST = 300  # features per photo that are compared with all others: 80 photos in 3 s
ALIKE = 0.85  # cosine of two descriptors: COLMAP's limit of 0.7 rad is 0.76; stricter here
FOLLOWING = 3  # next photos on the walk: steps of 9 degrees make 27, the most SIFT follows
BEST_SAME = 8  # further photos of the same state: closes the circle and links the two rounds
BEST_OTHER = 8  # photos of the other state: 64 photos shared 1290 points; not swept


def largest_features(keypoints: F32, descriptors: NDArray[np.uint8]) -> F32:
    """Return the unit descriptors [<= LARGEST, 128] of the features with the largest scale.

    Args:
        keypoints: [N, 4] x, y, scale, angle or [N, 6] x, y and an affine shape.
        descriptors: [N, 128].
    """
    if keypoints.shape[1] == 6:
        scale = np.abs(keypoints[:, 2] * keypoints[:, 5] - keypoints[:, 3] * keypoints[:, 4])
    else:
        scale = keypoints[:, 2]
    chosen = descriptors[np.argsort(-scale, kind="stable")[:LARGEST]].astype(np.float32)
    return np.asarray(chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1e-9))


def shared_features(large: Sequence[F32]) -> NDArray[np.int64]:
    """Return [V, V] how many large features every two photos share, as nearest of each other."""
    votes = np.zeros((len(large), len(large)), np.int64)
    for a, one in enumerate(large):
        for b in range(a):
            if not (len(one) and len(large[b])):
                continue
            like = one @ large[b].T
            there, back = like.argmax(1), like.argmax(0)
            own = np.arange(len(one))
            votes[a, b] = votes[b, a] = ((back[there] == own) & (like[own, there] > ALIKE)).sum()
    return votes


def choose_pairs(votes: NDArray[np.int64], state: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Return pairs (a < b) of photos to match, neighbours in their order among them.

    Args:
        votes: [V, V] features shared.
        state: [V] 0 or 1; photos of a state are in the order they were taken.
    """
    pairs = set()
    for a in range(len(state)):
        follow = range(a + 1, min(len(state), a + 1 + FOLLOWING))
        pairs |= {(a, b) for b in follow if state[a] == state[b]}
        for same, count in ((True, BEST_SAME), (False, BEST_OTHER)):
            score = np.where((state == state[a]) == same, votes[a], -1)
            score[a] = -1
            pairs |= {(min(a, b), max(a, b)) for b in map(int, np.argsort(-score)[:count])
                      if score[b] >= 0}
    return sorted(pairs)
