"""Convex collision pieces under the knife: cut back to planes, or cut up around what passes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.collision.few_corners import corners_and_normals
from part2gs_robotics.collision.walls import Facets, facets
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import arrays, corners_of, hull_of

if TYPE_CHECKING:
    from manifold3d import Manifold

MOST_SIDES = 8  # of a passage: a drawer has four, noise doubles them
MOSTLY_EMPTY = 0.25  # of what is cut out of a piece may be real: noise at an opening's rim
LEAST_SIDE = 1e-3  # of what is real in a piece: less is noise at a corner


@dataclass
class Piece:
    """A convex body under the knife, in the state-0 frame of the world.

    Attributes:
        part: index.  solid: convex.  real: what of the part lies in it.  spare: real volume that
            may be lost in one cut.  vertices, normals: of `solid`.  faces: of `real`.
    """

    part: int
    solid: Manifold
    real: Manifold
    spare: float
    vertices: F64
    normals: F64
    faces: Facets

    def trim(self, planes: list[tuple[F64, float]]) -> None:
        """Keep what lies on the positive side of planes (normal, level)."""
        for normal, level in planes:
            self.solid = self.solid.trim_by_plane(normal.tolist(), level)
            self.real = self.real.trim_by_plane(normal.tolist(), level)
        self.vertices, self.normals = corners_and_normals(self.solid)
        self.faces = _faces(self.real)

    def loss(self, planes: list[tuple[F64, float]]) -> float:
        """Return about the real volume that `trim` would cost."""
        return max([0.0, *(_beyond(self.faces, -normal, -level) for normal, level in planes)])

    def around(self, passing: F64, gap: float) -> list[Piece]:
        """Return convex shares of the piece, each on its own side of what passes; empty if none do.

        A wall with a window is four boards about it. Of the real part at most `spare` is lost, and
        what is cut out must be mostly empty: bodies that cross are left to be seen.

        Args:
            passing: [n, 3] points whose hull passes, in the piece's frame.
            gap: that is kept from it, scene units.
        """
        hull = hull_of(passing)
        sides = corners_and_normals(hull)[1]
        levels = (sides @ passing.T).max(1) + gap if len(sides) else np.zeros(0)
        rest, faces, shares = self.real, self.faces, list[Piece]()
        while len(sides) and len(shares) < MOST_SIDES and rest.volume() > 0:
            volumes = [_beyond(faces, n, level) for n, level in zip(sides, levels, strict=True)]
            best = int(np.argmax(volumes))
            if volumes[best] < LEAST_SIDE * self.real.volume():
                break
            normal, level = sides[best].tolist(), float(levels[best])
            share = rest.trim_by_plane(normal, level)
            shares.append(piece_of(self.part, hull_of(corners_of(share)), share, self.spare))
            rest = rest.trim_by_plane((-sides[best]).tolist(), -level)
            faces = _faces(rest)
        lost = min(self.spare, MOSTLY_EMPTY * float((hull ^ self.solid).volume()))
        return shares if rest.volume() <= lost else []


def piece_of(part: int, solid: Manifold, real: Manifold, spare: float) -> Piece:
    """Return a convex solid of a part as a piece, see Piece."""
    return Piece(part, solid, real, spare, *corners_and_normals(solid), _faces(real))


def _beyond(faces: Facets, normal: F64, level: float) -> float:
    """Return about the volume of a solid that lies above a level along a direction.

    It is the surface integral of the height above the plane, taken along its normal (divergence
    theorem; faces the plane cuts count by their centre).
    """
    height = np.maximum(faces.centers @ normal - level, 0.0)
    return float((height * (faces.normals @ normal)) @ faces.areas)


def _faces(solid: Manifold) -> Facets:
    return facets(*arrays(solid))
