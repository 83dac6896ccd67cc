"""Planes: on which one a region of a photo lies, by what other photos see of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from part2gs_robotics.model.arrays import F32, F64, I64, Mask
from part2gs_robotics.plain.kernels import looked_past, rims
from part2gs_robotics.plain.regions import Region

Plane = tuple[int, float]  # number of its normal, offset along it
STRIDE = 2.0  # pixels of the object's picture between planes that are tried first
CLOSER = -0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6  # strides beside the best of these
LOOKED = 6  # best planes by their rims of which it is asked what photos look past
PAST = 3.0  # a look past speaks against a plane so much more than a rim for it: 2 to 5 do alike
ALIKE = 0.06  # of the colour range: photos of one colour differ by less
TOLERANCE = 0.01  # of the diagonal: what is seen nearer hides a place
SLACK = 2.5  # voxels that the bounds may be carved too far
ASLANT = 0.05  # cosine: a plane seen at less is a line
ASKEW = 0.15  # cosine: photos that see a plane at less say little of it
FEWEST = 3  # photos beside its own that face a plane: of fewer, a match is chance


@dataclass(frozen=True)
class Bounds:
    """Where the object may be.

    Attributes:
        values: [X, Y, Z] signed distance, positive inside.  lo: [3] centre of the first voxel.
        voxel: its edge.  diagonal: of the object.  All in scene units.
    """

    values: F32
    lo: F64
    voxel: float
    diagonal: float

    @property
    def middle(self) -> F64:
        """[3] of the box."""
        return np.asarray(self.lo + 0.5 * self.voxel * np.array(self.values.shape))

    def corners(self) -> F64:
        """Return [8, 3] corners of the box."""
        size = np.array(self.values.shape) * self.voxel
        return np.asarray(self.lo + size * np.stack(np.meshgrid(*[[0, 1]] * 3), -1).reshape(-1, 3))


@dataclass(frozen=True)
class Views:
    """Photos of one state and what is known of their depth.

    Attributes:
        images: [V, H, W, 3], NOTHING outside the object.  maps: [V, H, W] depth, 0 = unknown.
        Ks: [V, 3, 3].  viewmats: [V, 4, 4] camera_from_world.
        near: per view, the views that it is compared with.
        bounds: of the object.
    """

    images: F32
    maps: F32
    Ks: F64
    viewmats: F64
    near: list[I64]
    bounds: Bounds

    @cached_property
    def eyes(self) -> F64:
        """[V, 3] places of the cameras."""
        return np.asarray(-np.einsum("vji,vj->vi", self.viewmats[:, :3, :3],
                                     self.viewmats[:, :3, 3]))

    @cached_property
    def cams(self) -> F64:
        """[V, 3, 4] pixels, whole numbers at their centres, from world."""
        shift = np.eye(3)
        shift[:2, 2] = -0.5
        return np.ascontiguousarray(shift @ self.Ks @ self.viewmats[:, :3])

    def rays(self, view: int, places: F64 | I64) -> F64:
        """Return [..., 3] world ways per unit of depth of places [..., 2] (column, row)."""
        K = self.Ks[view]
        ways = np.stack([(places[..., 0] + 0.5 - K[0, 2]) / K[0, 0],
                         (places[..., 1] + 0.5 - K[1, 2]) / K[1, 1],
                         np.ones(places.shape[:-1])], -1)
        return np.ascontiguousarray(ways @ self.viewmats[view, :3, :3])


@dataclass(frozen=True)
class Asked:
    """What other photos say of a region of one photo.

    Attributes:
        views: all photos.  view: whose region it is.  region: of even colour.
    """

    views: Views
    view: int
    region: Region

    @cached_property
    def _outer(self) -> F64:
        return self.views.rays(self.view, self.region.rim)

    @cached_property
    def _inner(self) -> F64:
        return self.views.rays(self.view, self.region.within)

    @property
    def _eye(self) -> F64:
        return self.views.eyes[self.view]

    def facing(self, normal: F64, offsets: F64) -> Mask:
        """Return [O, N] which compared photos look at the side of planes that this one sees."""
        eyes = self.views.eyes[self.views.near[self.view]]
        height = eyes @ normal - offsets[:, None]
        own = (self._eye @ normal - offsets)[:, None]
        far = np.linalg.norm(eyes - self.views.bounds.middle, axis=1)
        return np.ascontiguousarray((height * own > 0) & (np.abs(height) > ASKEW * far))

    def rims(self, normal: F64, offsets: F64) -> F64:
        """Return [O] match of the rim on planes, 0..1."""
        return self._rims(met(self._eye, self._outer, normal, offsets),
                          self.facing(normal, offsets))

    def past(self, normal: F64, offsets: F64) -> F64:
        """Return [O] share of looks past the region on planes."""
        return self._past(met(self._eye, self._inner, normal, offsets),
                          self.facing(normal, offsets))

    def own(self, facing: Mask | None = None) -> float:
        """Return the score of the map's own depths, by all compared photos or some [1, N]."""
        if facing is None:
            facing = np.ones((1, len(self.views.near[self.view])), bool)
        depth = self.views.maps[self.view].astype(float)
        column, row = np.rint(self.region.rim[0]).astype(int).T
        rim = depth[row.clip(0, len(depth) - 1), column.clip(0, depth.shape[1] - 1)]
        column, row = self.region.within.T
        return float(self._rims(np.stack([rim, rim])[None], facing)[0]
                     - PAST * self._past(depth[row, column][None], facing)[0])

    def _rims(self, depths: F64, facing: Mask) -> F64:
        v, bounds, out = self.views, self.views.bounds, np.zeros(len(depths))
        rims(self._eye, self._outer, self.region.sides, depths, facing, v.near[self.view], v.cams,
             v.images, bounds.values, bounds.lo, bounds.voxel, SLACK * bounds.voxel, out)
        return _share(out, facing, self.region.length)

    def _past(self, depths: F64, facing: Mask) -> F64:
        v, bounds, out = self.views, self.views.bounds, np.zeros(len(depths))
        looked_past(self._eye, self._inner, self.region.colors, depths, facing, v.near[self.view],
                    v.cams, v.images, v.maps, TOLERANCE * bounds.diagonal, ALIKE, bounds.values,
                    bounds.lo, bounds.voxel, SLACK * bounds.voxel, out)
        return _share(out, facing, len(self._inner))


def spoken_for(asked: Asked, normals: F64) -> list[tuple[float, Plane]]:
    """Return planes that other photos speak for, each with its score.

    A plane's score is the match of the region's rim less what photos look past.

    Args:
        asked: of a region.
        normals: [M, 3] unit, of the planes that are tried.
    """
    bounds, found = asked.views.bounds, list[tuple[float, Plane]]()
    step = STRIDE * bounds.diagonal / max(asked.views.images.shape[1:3])
    for k, normal in enumerate(normals):
        along = bounds.corners() @ normal
        offsets = np.arange(along.min(), along.max() + step, step)
        peaks = _peaks(asked.rims(normal, offsets))
        if not peaks:
            continue
        closer = offsets[peaks][:, None] + step * np.array(CLOSER)
        match = asked.rims(normal, closer.ravel()).reshape(closer.shape)
        best = closer[np.arange(len(peaks)), match.argmax(1)]
        found += _scored(asked, k, normal, best, match.max(1))
    return [(score, plane) for score, plane in found if score > 0]


def likeliest(asked: Asked, normals: F64, planes: Sequence[Plane]) -> tuple[float, Plane] | None:
    """Return the one of some planes that other photos speak for most, None if none does."""
    found = list[tuple[float, Plane]]()
    for k in sorted({k for k, _ in planes}):
        offsets = np.array([offset for n, offset in planes if n == k])
        match = asked.rims(normals[k], offsets)
        top = [at for at in np.argsort(-match, kind="stable")[:LOOKED] if match[at] > 0]
        if top:
            found += _scored(asked, k, normals[k], offsets[top], match[top])
    return max(found) if found else None


def met(eye: F64, rays: F64, normal: F64, offsets: F64) -> F64:
    """Return [O, ...] depths at which rays [..., 3] meet planes, 0 where they hardly do."""
    slope = rays @ normal
    aslant = np.abs(slope) < ASLANT
    depths = (offsets - eye @ normal).reshape(-1, *(1,) * slope.ndim) / np.where(aslant, 1, slope)
    return np.ascontiguousarray(np.where(aslant, 0.0, depths))


def _scored(asked: Asked, k: int, normal: F64, offsets: F64, match: F64,
            ) -> Iterable[tuple[float, Plane]]:
    score = match - PAST * asked.past(normal, offsets)
    return [(float(s), (k, float(o))) for s, o in zip(score, offsets, strict=True)]


def _share(found: F64, facing: Mask, places: int) -> F64:
    """Return [O] sums over places and photos as shares of those that face a plane."""
    count = facing.sum(1)
    return np.where(count >= FEWEST, found / (np.maximum(count, 1) * places), 0.0)


def _peaks(match: F64) -> list[int]:
    """Return the places of the highest local maxima."""
    padded = np.concatenate([[-1.0], match, [-1.0]])
    top = np.flatnonzero((match >= padded[:-2]) & (match > padded[2:]) & (match > 0))
    return [int(k) for k in top[np.argsort(-match[top], kind="stable")][:LOOKED]]
