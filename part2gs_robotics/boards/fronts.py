"""Fronts: what photos show of the face that a sliding part turns to who pulls it.

Drawers that touch and were pulled out alike are one body of one motion. What tells them apart is
their front: a line from edge to edge, and the same look on both sides of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.model.twin import PartMesh

SIDE = 256  # pixels of a front's picture: as many as the front has in a photo of 400
FACING = 0.97  # cosine of 14 degrees between the slide and a face of the front
LEVEL = 0.01  # of the part's size: faces of one front differ by less
FILLED = 0.5  # of the rectangle around a front: 60 drawers fill 0.71 at least, wires 0.12
BROAD = 0.15  # of a front's length: 60 drawers have 0.17 at least, walls of one an eighth or less
SEEN = 0.45  # cosine between the slide and the way to a camera: 63 degrees
LEAST = 5  # photos whose median is a picture: what hides the front in two of them is outvoted
STEPS = 3, 5  # pixels from a line to what is beside it
FAINT = 1.5  # of 255 by which a line differs from both sides: plain fronts' medians differ by one
WHOLE = 0.9  # of the width: of 87 single fronts' lines the longest had 0.85, lines between had 0.96
BROKEN = 0.4, 0.6, WHOLE  # of it, that further lines have beside a whole one; handles have less
EDGE = 0.12  # of the height: nearer to an edge a line is a rim, of two fronts as of four
UNIT = 64  # pixels that units are compared at
RIM = 6  # of them left out all around: the lines themselves
SHIFT = 4  # of them by which a handle may stand elsewhere
PLAIN = 2.0  # of 255, standard deviation: a unit without more shows nothing that could be alike
ALIKE = 0.5  # correlation: half of what one unit shows is what the other shows


@dataclass(frozen=True)
class Front:
    """The flat face at one end of a sliding part, at state 0.

    Attributes:
        corner: [3] of the rectangle around it.
        sides: [2, 3] from there along both sides, scene units.
        outward: [3] unit.
        area: of the face itself, scene units^2.
    """

    corner: F64
    sides: F64
    outward: F64
    area: float

    def along(self, points: F64, side: int) -> F64:
        """Return [N] where points are along a side, 0..1 within the rectangle."""
        way = self.sides[side]
        return np.asarray((points - self.corner) @ way / (way @ way))


@dataclass(frozen=True)
class Units:
    """Units of a front, one after the other.

    Attributes:
        front: that they are of.  side: along which they follow.
        cuts: [n - 1] where one ends, 0..1 along that side.
        alike: whether all look alike, and not as plain as anything does.
    """

    front: Front
    side: int
    cuts: F64
    alike: bool

    def of(self, points: F64) -> I64:
        """Return [N] the unit that points at state 0 belong to."""
        return np.digitize(self.front.along(points, self.side), self.cuts)


def units_of(mesh: PartMesh, joint: Joint, states: Sequence[StateViews], moves: Sequence[F64],
             ) -> Units | None:
    """Return the units that lines from edge to edge divide a sliding part's front into.

    Args:
        mesh: of the part at state 0.
        joint: of it.
        states: photos of both.
        moves: per state, [4, 4] where the part is in it.
    """
    if joint.kind != "prismatic":  # a door's front tells nothing of where it ends
        return None
    for way in (joint.axis, -joint.axis):
        front = _front(mesh, way)
        picture = None if front is None else _picture(front, states, moves)
        if front is None or picture is None:
            continue
        for side in (0, 1):
            turned = picture if side else picture.T
            if len(_lines(turned, WHOLE)):
                return _most_alike(front, side, turned)
    return None


def _most_alike(front: Front, side: int, picture: F32) -> Units:
    """Return the most units that all look alike, else those between whole lines.

    Drawers of one kind have one kind of gap, which some photos hardly show here and there.
    """
    for least in BROKEN:
        cuts = _lines(picture, least)
        if _alike(picture, cuts):
            return Units(front, side, cuts / SIDE, alike=True)
    return Units(front, side, cuts / SIDE, alike=False)


def broad_front(mesh: PartMesh, joint: Joint) -> bool:
    """Return whether what slides has a front of its own: a drawer's wall, or half a tray, has none.

    Args:
        mesh: one body of it at state 0.
        joint: of it.
    """
    fronts = [front for way in (joint.axis, -joint.axis) if (front := _front(mesh, way))]
    lengths = [np.sort(np.linalg.norm(front.sides, axis=1)) for front in fronts]
    return any(front.area > FILLED * short * long and short > BROAD * long
               for front, (short, long) in zip(fronts, lengths, strict=True))


def _front(mesh: PartMesh, outward: F64) -> Front | None:
    """Return the largest flat face that looks one way; None without one."""
    from scipy.linalg import null_space

    corners = mesh.vertices.astype(float)[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(cross, axis=1)
    looks = cross @ outward > FACING * np.maximum(areas, 1e-300)
    if not looks.any():
        return None
    levels = corners.mean(1) @ outward
    step = LEVEL * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    steps = np.round((levels - levels.min()) / step).astype(int)
    main = np.bincount(steps[looks], areas[looks]).argmax()
    face = looks & (np.abs(steps - main) <= 1)
    level = corners[face].reshape(-1, 3)
    plane = null_space(outward[None])
    box = cv2.boxPoints(cv2.minAreaRect((level @ plane).astype(np.float32))).astype(float)
    sides = np.stack([box[1] - box[0], box[3] - box[0]])
    if np.linalg.norm(sides, axis=1).min() < step:
        return None
    return Front(box[0] @ plane.T + (level @ outward).mean() * outward, sides @ plane.T, outward,
                 0.5 * float(areas[face].sum()))


def _picture(front: Front, states: Sequence[StateViews], moves: Sequence[F64]) -> F32 | None:
    """Return [SIDE, SIDE] the front as most photos show it: rows along its second side."""
    one, two = front.sides
    corners = front.corner + np.array([np.zeros(3), one, one + two, two])
    square = np.array([[0, 0], [SIDE, 0], [SIDE, SIDE], [0, SIDE]], np.float32)
    seen = []
    for state, move in zip(states, moves, strict=True):
        for v in np.flatnonzero(~state.held_out):
            at = apply(state.viewmats[v] @ move, corners)
            eye = -(state.viewmats[v] @ move)[:3, :3].T @ (state.viewmats[v] @ move)[:3, 3]
            way = eye - corners.mean(0)
            if way @ front.outward < SEEN * np.linalg.norm(way) or at[:, 2].min() <= 0.0:
                continue
            pixels = at @ state.Ks[v].T
            warp = cv2.getPerspectiveTransform((pixels[:, :2] / pixels[:, 2:]).astype(np.float32),
                                               square)
            gray = cv2.cvtColor(state.images[v], cv2.COLOR_RGB2GRAY)
            seen.append(cv2.warpPerspective(gray, warp, (SIDE, SIDE)))
    if len(seen) < LEAST:
        return None
    return np.median(np.stack(seen), axis=0).astype(np.float32)


def _lines(picture: F32, least: float) -> F64:
    """Return the rows at which a picture shows a line over such a share of its width, in order."""
    whole = np.zeros(SIDE)
    for step in STEPS:
        above, below = picture - np.roll(picture, step, 0), picture - np.roll(picture, -step, 0)
        for sign in (1, -1):
            apart = np.minimum(sign * above, sign * below)
            whole = np.maximum(whole, (apart > FAINT).mean(1))
    edge = round(EDGE * SIDE)
    whole[:edge] = whole[SIDE - edge:] = 0.0
    found: list[int] = []
    for row in np.argsort(-whole):
        if whole[row] < least:
            break
        if all(abs(row - other) >= edge for other in found):
            found.append(int(row))
    return np.array(sorted(found), float)


def _alike(picture: F32, cuts: F64) -> bool:
    """Return whether what is between lines shows something, and looks alike, one and the next."""
    rows = [0, *map(int, cuts), SIDE]
    units = [cv2.resize(picture[a:b], (UNIT, UNIT))[RIM:-RIM, RIM:-RIM]
             for a, b in pairwise(rows)]
    if min(float(unit.std()) for unit in units) < PLAIN:
        return False
    return all(_correlation(one, two) > ALIKE for one, two in pairwise(units))


def _correlation(one: F32, two: F32) -> float:
    """Return the best correlation of two pictures, shifted a little."""
    middle: NDArray[np.float32] = two[SHIFT:-SHIFT, SHIFT:-SHIFT]
    return float(cv2.matchTemplate(one, middle, cv2.TM_CCOEFF_NORMED).max())
