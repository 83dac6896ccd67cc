"""Study: everything the motion search looks at, gathered once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.errors import FitError
from part2gs_robotics.evidence.depth_maps import DepthMaps, observe, render_depth_maps
from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.faces import flat_faces
from part2gs_robotics.evidence.graph import Graph, build_graph, ways_along
from part2gs_robotics.evidence.guides import Guides, guides_of
from part2gs_robotics.evidence.landing import Landing, build_landing
from part2gs_robotics.evidence.light import Light, light_of, unshaded
from part2gs_robotics.evidence.part_edges import Clues, part_edges
from part2gs_robotics.evidence.segments import Segments, segments_of
from part2gs_robotics.evidence.surfels import Surfels, fuse_surfels, sampling
from part2gs_robotics.evidence.unseen import SIDE, VIEWS, without_unseen
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.small_views import SmallViews, small_views
from part2gs_robotics.runtime.side_by_side import side_by_side

SELF_TOLERANCE = 0.012  # of the diagonal: a surfel its own state sees past is a floater
FREE_TOLERANCE = 0.015  # of the diagonal: above the depth error of four pixels out of five
MARGIN = 0.05  # of the diagonal: around the object, and from a surfel that a point may land on
MIN_VIEWS = 3  # votes needed to call a place free or occupied
FINE_TAU = 0.015  # of the diagonal: twice the noise of fused depth
COARSE_TO_FINE = 1.3, 1.0, 0.7  # of the matching distance: a label's error is let in at first


@dataclass(frozen=True)
class Study:
    """Two states as surfels, landing grids, evidence and small views.

    Attributes:
        gaussians: of both states, clear where no photo shows them.
        surfels: of both states.  lands: landing grids of both states.
        evidence: vacated and arrived surfels.  graph: of all surfels, state 1 after state 0.
        nearest: per state, [N_s] the surfel nearest to every Gaussian.
        views: small views of both states.  box: corners of the object.  diag: its diagonal.
        light: how bright a face is by the way it looks; colours of surfels are without it.
        segments: straight edges in the photos of both states.
    """

    gaussians: tuple[Gaussians, Gaussians]
    maps: tuple[DepthMaps, DepthMaps]
    surfels: tuple[Surfels, Surfels]
    lands: tuple[Landing, Landing]
    evidence: Evidence
    graph: Graph
    nearest: tuple[NDArray[np.int64], NDArray[np.int64]]
    views: tuple[SmallViews, SmallViews]
    box: tuple[F64, F64]
    diag: float
    light: Light
    segments: tuple[Segments, Segments]

    @property
    def source_weight(self) -> tuple[float, float]:
        """Share of each state in the evidence of motion: the richer one shows more of the parts."""
        vacated, arrived = len(self.evidence.vacated), len(self.evidence.arrived)
        share = vacated / max(vacated + arrived, 1)
        return share, 1.0 - share

    @cached_property
    def straight(self) -> Guides:
        """Directions of parallel straight edges of both states, the most frequent first."""
        return guides_of(edge_families(bundled(self.segments), np.random.default_rng(0)))

    @cached_property
    def guides(self) -> Guides:
        """Flat faces and straight edges of both states."""
        return flat_faces(self.surfels, self.diag, np.random.default_rng(0)) + self.straight

    @cached_property
    def ways(self) -> csr_matrix:
        """[N0 + N1, N0 + N1] distances between neighbouring surfels, along the surface."""
        return ways_along(self.surfels, self.graph)

    def clues(self, labels: tuple[NDArray[np.int64], NDArray[np.int64]], count: int) -> Clues:
        """Return what draws the joints of parts 1..count, from labels of the Gaussians."""
        return Clues(self.guides, part_edges(self.segments, self.maps, self.gaussians, labels,
                                             count))

    @property
    def tau(self) -> float:
        """Matching distance in scene units."""
        return FINE_TAU * self.diag

    @property
    def taus(self) -> tuple[float, ...]:
        """Matching distances of a refinement, decreasing."""
        return distances(self.tau)

    def gaussian_labels(
        self, hard: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return per-state labels of the Gaussians from labels of all surfels."""
        n0 = len(self.surfels[0])
        return hard[:n0][self.nearest[0]], hard[n0:][self.nearest[1]]

    def own(self, hard: NDArray[np.int64], part: int) -> tuple[Surfels, Surfels]:
        """Return the surfels of both states that have a label, from labels of all surfels."""
        n0 = len(self.surfels[0])
        return (self.surfels[0].select(hard[:n0] == part),
                self.surfels[1].select(hard[n0:] == part))


def gather(scene: Scene, gaussians: tuple[Gaussians, Gaussians],
           config: SearchConfig | None = None) -> Study:
    """Return the study of two fitted states.

    Args:
        scene: images of both states.
        gaussians: of both states.
        config: size of surfels and small views; None = the standard preset.

    Raises:
        FitError: a state's Gaussians show no surface.
    """
    config = config or SearchConfig()
    maps = (
        render_depth_maps(gaussians[0], scene.states[0]),
        render_depth_maps(gaussians[1], scene.states[1]),
    )
    rough, size = _rough_diagonal(gaussians), config.surfel_size
    painted = side_by_side([partial(_own_surface, maps[s], scene.states[s].images, rough, size)
                            for s in (0, 1)])
    _require_surface(painted[0].points, painted[1].points)
    shades = light_of((painted[0], painted[1]))
    surfels = [unshaded(s, shades) for s in painted]
    points = np.concatenate([s.points for s in surfels])
    lo, hi = points.min(0), points.max(0)
    diag = float(np.linalg.norm(hi - lo))
    box = lo - MARGIN * diag, hi + MARGIN * diag
    targets = side_by_side([partial(_as_target, surfels[s], maps[s], maps[1 - s], box, size, diag)
                            for s in (0, 1)])
    nearest = [
        np.asarray(cKDTree(surfels[s].points).query(gaussians[s].means)[1], np.int64)
        for s in (0, 1)
    ]
    normals = [surfels[s].normals[nearest[s]] for s in (0, 1)]
    views = [small_views(state, config.proof_views, config.proof_side) for state in scene.states]
    pair = surfels[0], surfels[1]
    shown = side_by_side([partial(_seen, *pair) for pair in
                          zip(gaussians, scene.states, strict=True)])
    return Study(
        (shown[0], shown[1]),
        maps,
        pair,
        (targets[0][0], targets[1][0]),
        Evidence(targets[0][1], targets[1][1]),
        build_graph(pair),
        (nearest[0], nearest[1]),
        (views[0], views[1]),
        (lo, hi),
        diag,
        Light(shades, (normals[0], normals[1])),
        _straight(scene),
    )


def _seen(gaussians: Gaussians, state: StateViews) -> Gaussians:
    return without_unseen(gaussians, small_views(state, VIEWS, SIDE))


def _rough_diagonal(gaussians: tuple[Gaussians, Gaussians]) -> float:
    """Return the diagonal of the box of nearly all opaque Gaussians, scene units."""
    opaque = [g.means[g.opacities > 0.5] for g in gaussians]
    _require_surface(*opaque)
    solid = np.concatenate(opaque).astype(np.float64)
    ends = np.quantile(solid, 0.998, axis=0), np.quantile(solid, 0.002, axis=0)
    return float(np.linalg.norm(ends[0] - ends[1]))


def _straight(scene: Scene) -> tuple[Segments, Segments]:
    one, two = side_by_side([partial(segments_of, state) for state in scene.states])
    return one, two


def _as_target(surfels: Surfels, maps: DepthMaps, other: DepthMaps, box: tuple[F64, F64],
               size: float, diag: float) -> tuple[Landing, Surfels]:
    """Return the landing grid of a state, and its surfels that the other state saw free."""
    seen = observe(surfels.points, other, FREE_TOLERANCE * diag)
    claimed = ((seen.surface >= MIN_VIEWS) & (seen.surface > 2 * seen.free)).astype(np.float64)
    moved = surfels.select((seen.free >= MIN_VIEWS) & (seen.free > 2 * seen.surface))
    land = build_landing(surfels, claimed, maps, *box, size * diag, MARGIN * diag)
    return land, moved


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


@dataclass(frozen=True)
class Evidence:
    """Surfels that the other state saw free: vacated (state 0) and arrived (state 1)."""

    vacated: Surfels
    arrived: Surfels

    @property
    def sets(self) -> tuple[Surfels, Surfels]:
        """Both sets, by state."""
        return self.vacated, self.arrived


def distances(tau: float) -> tuple[float, ...]:
    """Return the matching distances of a refinement, decreasing, scene units."""
    return tuple(share * tau for share in COARSE_TO_FINE)
