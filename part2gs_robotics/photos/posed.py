"""What is known once photos are registered: cameras of both states and points, in one frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64


@dataclass(frozen=True)
class Posed:
    """Cameras of both states in one frame, OpenCV axes, one lens.

    Attributes:
        K: [3, 3] pixels, pixel centres at +0.5.
        distortion: radial, k1 of the OpenCV model.
        names: names of registered photos per state, in the order they were taken.
        viewmats: per state [V, 4, 4] camera_from_world.
        points: [N, 3] sparse points.
        seen: [N, 2] in which states a point is seen; both = it stayed.
        apart: median distance of what stayed between the states before they were joined, units.
        error_px: mean reprojection error.
    """

    K: F64
    distortion: float
    names: tuple[tuple[str, ...], tuple[str, ...]]
    viewmats: tuple[F64, F64]
    points: F64
    seen: NDArray[np.bool_]
    apart: float
    error_px: float

    @property
    def all_viewmats(self) -> F64:
        """[V0 + V1, 4, 4] of both states."""
        return np.concatenate(self.viewmats)

    def moved(self, scale: float, new_from_old: F64) -> Posed:
        """Return everything in another frame: x_new = new_from_old (scale x_old)."""
        back = np.linalg.inv(new_from_old)
        views = []
        for old in self.viewmats:
            scaled = old.copy()
            scaled[:, :3, 3] *= scale
            views.append(scaled @ back)
        points = scale * self.points @ new_from_old[:3, :3].T + new_from_old[:3, 3]
        return replace(self, viewmats=(views[0], views[1]), points=points,
                       apart=scale * self.apart)


def eyes(viewmats: F64) -> F64:
    """Return [V, 3] camera centres."""
    return np.asarray(-np.einsum("vij,vi->vj", viewmats[:, :3, :3], viewmats[:, :3, 3]))


def focus(viewmats: F64) -> tuple[F64, float]:
    """Return the point [3] that cameras look at, and their median distance from it.

    Args:
        viewmats: [V, 4, 4], V >= 2, not all looking the same way.
    """
    at, ahead = eyes(viewmats), viewmats[:, 2, :3]
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]  # [V, 3, 3] what is off the axis
    # The ridge keeps parallel axes solvable; it moves the point by less than 1e-6 of the scene.
    ridge = 1e-6 * len(at) * np.eye(3)
    middle = np.linalg.solve(across.sum(0) + ridge,
                             np.einsum("vij,vj->i", across, at) + ridge @ at.mean(0))
    return middle, float(np.median(np.linalg.norm(at - middle, axis=1)))


def project(points: F64, viewmat: F64, K: F64) -> tuple[F64, F64]:
    """Return pixels [N, 2] and depths [N] of world points in a pinhole camera."""
    local = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    depth = local[:, 2]
    safe = np.where(np.abs(depth) < 1e-12, 1e-12, depth)
    return np.asarray((local @ K.T)[:, :2] / safe[:, None]), depth
