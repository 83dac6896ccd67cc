"""Twin: the neutral description every exporter, check and report reads."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.model.joint import Joint

SEEN_GROUP, COLLIDES_GROUP = 2, 3  # of geoms, as MuJoCo Menagerie has them


@dataclass(frozen=True)
class Texture:
    """Picture of a part's surface.

    Attributes:
        uv: [F, 3, 2] place of every face's corners in the image, 0..1 from its lower left corner.
        image: [H, W, 3] uint8 RGB, top row first.
    """

    uv: NDArray[np.float32]
    image: NDArray[np.uint8]

    def at(self, uv: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return [N, 3] colours 0..1 at places [..., 2], v upwards; outside, of the rim."""
        high, wide = self.image.shape[:2]
        at = np.asarray(uv, np.float64).reshape(-1, 2)
        x = np.clip((at[:, 0] * wide).astype(int), 0, wide - 1)
        y = np.clip(((1 - at[:, 1]) * high).astype(int), 0, high - 1)
        return np.asarray(self.image[y, x, :3] / 255.0)


@dataclass(frozen=True)
class PartMesh:
    """Closed surface of one part, in the world frame at state 0, scene units.

    Attributes:
        vertices: [V, 3].  faces: [F, 3] outward.  colors: [V, 3] uint8.
        synthesised: share of the surface area nobody saw, 0..1.
        texture: what its faces look like; None = the colours of the vertices.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    colors: NDArray[np.uint8]
    synthesised: float = 0.0
    texture: Texture | None = None

    def painted(self, texture: Texture) -> PartMesh:
        """Return the mesh with a picture, and its vertices in the picture's colours.

        What shows no pictures shows the same, and a picture that is not of the mesh is told by its
        vertices. A vertex takes the mean of its corners, which may lie apart in the picture.
        """
        corners, total = self.faces.reshape(-1), np.zeros((len(self.vertices), 3))
        np.add.at(total, corners, texture.at(texture.uv))
        count = np.bincount(corners, minlength=len(total))[:, None]
        seen = np.rint(255 * total / np.maximum(count, 1)).astype(np.uint8)
        return replace(self, colors=np.where(count > 0, seen, self.colors), texture=texture)


@dataclass(frozen=True)
class Part:
    """One rigid part: `base` (index 0) or `part_1`, `part_2`, ...

    Attributes:
        name: file-safe name.  parent: index of the part that carries it (-1 for the base).
        mesh: visual mesh.  pieces: convex collision pieces (world frame at state 0).
        joint: None for the base; axis and origin in the world frame at state 0.
        limits: joint range [2] covering 0 and joint.value.
        limits_source: measured (the observed states) | derived (as far as nothing is in the way) |
            assumed (set by hand).
        num_gaussians: Gaussians of both states that carry this identity.
        diagnostics: losses and residuals of the optimiser for this part (contact_loss,
            vector_field_loss, motion_residual, ...), reported beside the measured overlap; and
            `yielded`, the share of its volume cut away where others pass.
    """

    name: str
    parent: int
    mesh: PartMesh
    pieces: tuple[PartMesh, ...]
    joint: Joint | None
    limits: tuple[float, float] = (0.0, 0.0)
    limits_source: str = "measured"
    num_gaussians: int = 0
    diagnostics: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Twin:
    """Parts with joints; part 0 is the base; joint position 0 is state 0.

    Attributes:
        name: model name.  parts: base first, parents before children.
        meters_per_unit: None = unknown (exporters then take `assumed_meters` and say so).
        up: [3] unit, None = unknown (exporters then assume +z and say so).
        notes: fallbacks and assumptions, one sentence each.
        assumed_meters: metres per unit that masses and gravity take when nobody knows them.
        scale_note: who says `meters_per_unit`, for people.
        material: name or kg/m3 as given (`materials.density_of`); None = unknown (exporters then
            take `materials.DEFAULT` and say so).
    """

    name: str
    parts: tuple[Part, ...]
    meters_per_unit: float | None = None
    up: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()
    assumed_meters: float = 1.0
    scale_note: str = "given"
    material: str | None = None

    @property
    def meters(self) -> float:
        """Metres per scene unit that masses and gravity take, known or assumed."""
        return self.meters_per_unit or self.assumed_meters


def corner_normals(vertices: F64, faces: I64, crease: float) -> F64:
    """Return [F, 3, 3] unit normals of the corners of faces.

    A corner has the mean by area of the faces around its vertex that look almost as its own does.

    Args:
        vertices: [V, 3].
        faces: [F, 3] outward.
        crease: cosine of the angle to its own face beyond which another one does not count.
    """
    tri = vertices[faces]
    areas = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    length = np.linalg.norm(areas, axis=1, keepdims=True)
    own = np.divide(areas, length, out=np.zeros_like(areas), where=length > 0)
    order = np.argsort(faces.ravel(), kind="stable")  # corners, those of one vertex together
    vertex, face = faces.ravel()[order], order // 3
    first = np.searchsorted(vertex, vertex)
    count = np.searchsorted(vertex, vertex, side="right") - first
    corner = np.repeat(np.arange(len(order)), count)
    place = np.arange(len(corner)) - np.repeat(np.cumsum(count) - count, count)
    mine, other = face[corner], face[first[corner] + place]
    alike = (own[mine] * own[other]).sum(1) > crease
    sums = np.zeros((len(order), 3))
    np.add.at(sums, corner[alike], areas[other[alike]])
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    unit = np.divide(sums, length, out=np.tile([0.0, 0.0, 1.0], (len(order), 1)), where=length > 0)
    out = np.empty_like(unit)
    out[order] = unit
    return out.reshape(-1, 3, 3)
