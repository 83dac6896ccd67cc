"""Surfaces of both states, in one light, and what of them the other state saw to be gone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.depth_maps import (
    MIN_VIEWS,
    DepthMaps,
    observe,
    render_depth_maps,
)
from part2gs_robotics.evidence.light import light_of, unshaded
from part2gs_robotics.evidence.surfels import Surfels, fuse_surfels, sampling
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.runtime.side_by_side import side_by_side

SELF_TOLERANCE = 0.012  # of the diagonal: a surfel its own state sees past is a floater
FREE_TOLERANCE = 0.015  # of the diagonal: above the depth error of four pixels out of five


@dataclass(frozen=True)
class Evidence:
    """Surfels that the other state saw free: vacated (state 0) and arrived (state 1)."""

    vacated: Surfels
    arrived: Surfels

    @property
    def sets(self) -> tuple[Surfels, Surfels]:
        """Both sets, by state."""
        return self.vacated, self.arrived

    @property
    def weights(self) -> tuple[float, float]:
        """Share of each state: the richer one shows more of the parts.

        Source: lambda of Part2GS eq. 3, of what the other state saw free instead of all points:
        as printed, an interior that opens counts as motion.
        """
        vacated, arrived = len(self.vacated), len(self.arrived)
        share = vacated / (vacated + arrived) if vacated + arrived else 0.5
        return share, 1.0 - share


@dataclass(frozen=True)
class Surfaces:
    """Surfaces of both states.

    Attributes:
        maps: first-surface depth in every view.
        surfels: in even light.
        shades: [8] of the light, see `light.Light`.
        claimed: per state, [M_s] 1 where the other state saw the surfel in its old place.
        evidence: surfels that the other state saw free.
        box: corners of the object.  diag: its diagonal, scene units.
    """

    maps: tuple[DepthMaps, DepthMaps]
    surfels: tuple[Surfels, Surfels]
    shades: F64
    claimed: tuple[F64, F64]
    evidence: Evidence
    box: tuple[F64, F64]
    diag: float


def surfaces_of(scene: Scene, gaussians: tuple[Gaussians, Gaussians], size: float) -> Surfaces:
    """Return the surfaces of two fitted states.

    Args:
        scene: images of both states.
        gaussians: of both states.
        size: of a surfel, as a share of the object's diagonal.

    Raises:
        FitError: a state's Gaussians show no surface.
    """
    rough = _rough_diagonal(gaussians)
    maps = (
        render_depth_maps(gaussians[0], scene.states[0], FREE_TOLERANCE * rough),
        render_depth_maps(gaussians[1], scene.states[1], FREE_TOLERANCE * rough),
    )
    painted = side_by_side([partial(_own_surface, maps[s], scene.states[s].images, rough, size)
                            for s in (0, 1)])
    _require_surface(painted[0].points, painted[1].points)
    shades = light_of((painted[0], painted[1]))
    zero, one = (unshaded(s, shades) for s in painted)
    points = np.concatenate([zero.points, one.points])
    lo, hi = points.min(0), points.max(0)
    diag = float(np.linalg.norm(hi - lo))
    (claimed0, vacated), (claimed1, arrived) = side_by_side([
        partial(_by_other, zero, maps[1], diag), partial(_by_other, one, maps[0], diag)])
    return Surfaces(maps, (zero, one), shades, (claimed0, claimed1), Evidence(vacated, arrived),
                    (lo, hi), diag)


def _by_other(surfels: Surfels, other: DepthMaps, diag: float) -> tuple[F64, Surfels]:
    """Return which surfels the other state saw in their place, and those it saw past."""
    seen = observe(surfels.points, other, FREE_TOLERANCE * diag)
    claimed = ((seen.surface >= MIN_VIEWS) & (seen.surface > 2 * seen.free)).astype(np.float64)
    return claimed, surfels.select((seen.free >= MIN_VIEWS) & (seen.free > 2 * seen.surface))


def _rough_diagonal(gaussians: tuple[Gaussians, Gaussians]) -> float:
    """Return the diagonal of the box of nearly all opaque Gaussians, scene units."""
    opaque = [g.means[g.opacities > 0.5] for g in gaussians]
    _require_surface(*opaque)
    solid = np.concatenate(opaque).astype(np.float64)
    ends = np.quantile(solid, 0.998, axis=0), np.quantile(solid, 0.002, axis=0)
    return float(np.linalg.norm(ends[0] - ends[1]))


def _require_surface(*states: NDArray[np.floating]) -> None:
    for s, points in enumerate(states):
        if not len(points):
            raise FitError(f"state {s}: the fitted Gaussians show no surface. Expected one that "
                           f"{MIN_VIEWS} views see; check the poses and the scale of the scene.")


def _own_surface(maps: DepthMaps, images: NDArray[np.uint8], diag: float, size: float) -> Surfels:
    voxel, stride = sampling(maps, size * diag)
    surfels = fuse_surfels(maps, images, voxel, min_views=MIN_VIEWS, stride=stride)
    seen = observe(surfels.points, maps, SELF_TOLERANCE * diag)
    return surfels.select((seen.surface >= MIN_VIEWS) & (seen.free < 0.5 * seen.surface))
