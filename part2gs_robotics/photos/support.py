"""What the object stands on, from sparse points of both states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.posed import Posed, eyes, focus

TRIALS = 1500  # triples: a plane of 15 % of the points is drawn with probability 0.99
FLAT = 0.012  # of the cameras' distance: three sigma of points on a plane
NEARBY = 0.9  # of the cameras' distance: what the ring of cameras encloses
UNDER = 0.35  # of the cameras' distance: below this far around the middle nothing lies under it
FEWEST_ON_PLANE = 40  # points: fewer fit some plane in any cloud


@dataclass(frozen=True)
class Support:
    """The plane below the object, as a frame that stands on it.

    Attributes:
        stand_from_world: [4, 4]: the plane becomes z = 0, up is +z, the middle is the origin.
        radius: the cameras' distance from the middle.
    """

    stand_from_world: F64
    radius: float


def find_support(posed: Posed) -> Support:
    """Return the plane that the object stands on.

    Raises:
        SceneError: no plane lies under what the cameras look at.
    """
    middle, radius = focus(posed.all_viewmats)
    at = eyes(posed.all_viewmats)
    near = posed.points[np.linalg.norm(posed.points - middle, axis=1) < NEARBY * radius]
    plane = _plane(near, at, middle, radius)
    if plane is None:
        raise SceneError(f"masks: no plane found under the object ({len(near)} points near it). "
                         "Expected a table or floor with texture that the cameras see from "
                         "above; put a textured mat or the sheet of part2gs-robot marker under "
                         "it, or give masks (alpha or masks/).")
    up, height = plane
    return Support(_standing(up, height, middle, at), radius)


def _plane(points: F64, at: F64, middle: F64, radius: float) -> tuple[F64, float] | None:
    """Return up [3] and height of the plane that most points lie on and few lie under."""
    if len(points) < FEWEST_ON_PLANE:
        return None
    rng, best, most = np.random.default_rng(0), None, float(FEWEST_ON_PLANE)
    flat = FLAT * radius
    for _ in range(TRIALS):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        up = np.cross(b - a, c - a)
        size = float(np.linalg.norm(up))
        if size < 1e-12 * radius**2:
            continue
        up = up / size * np.sign((at.mean(0) - a) @ up / size)
        score = _score(points, at, middle, radius, (up, float(up @ a)))
        if score > most:
            best, most = (up, float(up @ a)), score
    if best is None:
        return None
    on = points[np.abs(points @ best[0] - best[1]) < flat]
    up = np.linalg.svd(on - on.mean(0))[2][2]
    up = up * np.sign(up @ best[0])
    return up, float(np.median(on @ up))


def _score(points: F64, at: F64, middle: F64, radius: float, plane: tuple[F64, float]) -> float:
    """Return the points on a plane less those under it; -1 where cameras are under it too."""
    up, height = plane
    if (at @ up - height).min() < 0.05 * radius or abs(middle @ up - height) > 0.5 * radius:
        return -1.0
    level = points @ up - height
    off = points - middle
    aside = np.linalg.norm(off - np.outer(off @ up, up), axis=1)
    under = (level < -3 * FLAT * radius) & (aside < UNDER * radius)
    return float((np.abs(level) < FLAT * radius).sum() - 2 * under.sum())


def _standing(up: F64, height: float, middle: F64, at: F64) -> F64:
    """Return the frame on the plane below the middle; x points to the first camera."""
    foot = middle - (middle @ up - height) * up
    ahead = at[0] - foot
    x = ahead - (ahead @ up) * up
    x = x / np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([x, np.cross(up, x), up])
    frame[:3, 3] = -frame[:3, :3] @ foot
    return frame
