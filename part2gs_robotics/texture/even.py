"""Even: one colour of a moving part, whose two states had the light from two sides.

A lamp stands still while a lid turns: what state 0 shows bright is dark in state 1. Half of each is
nearest to both; where only one state shows a texel, half of the difference nearby is added, so that
no border of light and dark runs over the part. Differences of light are smooth; where they are not,
something shone through glass or is misplaced, and the colour that most photos show is taken.
"""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import F32, Mask
from part2gs_robotics.texture.atlas import Atlas
from part2gs_robotics.texture.fill import from_nearest, sparse, spread

NEAREST = 24  # texels seen in both states whose differences are averaged: light, no pattern
TOLD = 3000  # of these that are asked: 24 of them are a hundredth of the surface
FEWEST = 50  # texels seen in both; fewer tell of an edge, not of the light
SURE = 0.1  # of the better state's weight that both must have for a difference to be told
NOISE = 3.0  # of 255, of a mean difference: less is none


def evened(atlas: Atlas, colors: tuple[F32, F32], weights: tuple[F32, F32], most: F32) -> F32:
    """Return [T, 3] colours between those of both states.

    Args:
        atlas: of the part.
        colors: per state, [T, 3] 0..255.
        weights: per state, [T] of the best sample; 0 = the state does not show the texel.
        most: [T, 3] colours that most photos of both states show.
    """
    one, two = weights
    both = np.minimum(one, two) > SURE * np.maximum(one, two)
    if int(both.sum()) < FEWEST:
        return most
    total = one + two
    share = np.divide(one, total, out=np.zeros_like(one), where=total > 0)[:, None]
    light, smooth = _light(atlas, colors[0] - colors[1], both)
    between = share * colors[0] + (1 - share) * colors[1] + (0.5 - share) * light
    return np.asarray(np.clip(smooth * between + (1 - smooth) * most, 0, 255), np.float32)


def _light(atlas: Atlas, difference: F32, both: Mask) -> tuple[F32, F32]:
    """Return [T, 3] the mean difference of the two states' light nearby, [T, 1] its share of all.

    The share is that of the mean in the mean square: 1 for light alone, 0 for anything else.
    """
    import cv2

    asking = sparse(atlas, np.ones(len(both), bool))
    told = np.zeros(len(both), bool)
    told[np.flatnonzero(both)[::-(-int(both.sum()) // TOLD)]] = True
    squared = (difference**2).sum(1, keepdims=True)
    found = from_nearest(atlas, np.concatenate([difference, squared], 1), told, asking, NEAREST)
    picture = spread(atlas, atlas.pixels[asking], found, found.mean(0))
    near = cv2.blur(picture, (5, 5)).reshape(-1, 4)[atlas.pixels]
    light, whole = near[:, :3], near[:, 3:] + NOISE**2
    return light, np.minimum((light**2).sum(1, keepdims=True) / whole, 1.0)
