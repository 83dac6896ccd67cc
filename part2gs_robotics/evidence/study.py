"""Study: everything the motion search looks at, gathered once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from part2gs_robotics.config import SearchConfig
from part2gs_robotics.evidence.canonical import Canonical
from part2gs_robotics.evidence.cross_render import floor_of
from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.faces import flat_faces
from part2gs_robotics.evidence.graph import (
    Graph,
    Web,
    bonds,
    build_graph,
    touching,
    ways_along,
    web_of,
)
from part2gs_robotics.evidence.guides import Guides, guides_of
from part2gs_robotics.evidence.landing import Landing, build_landing
from part2gs_robotics.evidence.light import Light, unshaded
from part2gs_robotics.evidence.part_edges import Clues, part_edges
from part2gs_robotics.evidence.segments import Segments, segments_of
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model.arrays import F32, F64, Labels, Mask
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.small_views import SmallViews, small_views
from part2gs_robotics.runtime.side_by_side import side_by_side

MARGIN = 0.05  # of the diagonal: around the object, and from a surfel that a point may land on
FINE_TAU = 0.015  # of the diagonal: twice the noise of fused depth
COARSE_TO_FINE = 1.3, 1.0, 0.7  # of the matching distance: a label's error is let in at first
# Surfels that say which part a Gaussian is of; 16 were right a little more often than 5 and 8.
VOICES = 16


@dataclass(frozen=True)
class Around:
    """The surfels around every Gaussian of a state, and what each has to say.

    Where no surface was certain, hundreds of Gaussians have one surfel in common that is nearest
    to them: what it says alone would decide for all of them.

    Attributes:
        index: [N, VOICES] of surfels, the nearest first.
        weights: [N, VOICES] inverse squared distances, 1 together (Shepard, 1968).
        sure: [N] 1 where the nearest is no farther than most surfels are from their nearest one,
            beyond it the square of their ratio.
    """

    index: NDArray[np.int32]
    weights: F32
    sure: F32

    def shares(self, hard: Labels, count: int) -> F32:
        """Return [N, count] the share of every label 0..count-1 of surfels around."""
        labels = hard[self.index]
        return np.stack([(self.weights * (labels == k)).sum(1) for k in range(count)], 1)

    def against(self, hard: Labels, count: int) -> F32:
        """Return [N, count] 0..1, how surely a Gaussian is not of a part: far from surfels, not."""
        return np.asarray(self.sure[:, None] * (1.0 - self.shares(hard, count)), np.float32)


def around(gaussians: Gaussians, surfels: Surfels) -> Around:
    """Return the surfels around every Gaussian of a state, all of them where there are fewer."""
    count = range(1, 1 + min(VOICES, len(surfels)))
    tree = cKDTree(surfels.points)
    size = np.median(tree.query(surfels.points, k=2)[0][:, 1])  # infinite for a single one
    gaps, index = tree.query(gaussians.means, k=count)
    gaps = np.maximum(gaps, np.finfo(np.float32).tiny)  # one may lie in its surfel
    weights = np.square(gaps[:, :1] / gaps)
    return Around(index.astype(np.int32),
                  (weights / weights.sum(1, keepdims=True)).astype(np.float32),
                  np.square(np.minimum(1.0, size / gaps[:, 0])).astype(np.float32))


@dataclass(frozen=True)
class Study:
    """Two states as surfels, landing grids, evidence and small views.

    Attributes:
        gaussians: of both states, clear where no photo shows them.
        surfels: of both states.  lands: landing grids of both states.
        evidence: vacated and arrived surfels.  graph: of all surfels, state 1 after state 0.
        around: per state, the surfels around every Gaussian.
        views: small views of both states, with floors.
        box: corners of the object.  diag: its diagonal.
        light: how bright a face is by the way it looks; colours of surfels are without it.
        segments: straight edges in the photos of both states.
        bonds: [N0 + N1, k] how firmly neighbours hold together, see `graph.bonds`.
    """

    gaussians: tuple[Gaussians, Gaussians]
    maps: tuple[DepthMaps, DepthMaps]
    surfels: tuple[Surfels, Surfels]
    lands: tuple[Landing, Landing]
    evidence: Evidence
    graph: Graph
    around: tuple[Around, Around]
    views: tuple[SmallViews, SmallViews]
    box: tuple[F64, F64]
    diag: float
    light: Light
    segments: tuple[Segments, Segments]
    bonds: F32

    @property
    def source_weight(self) -> tuple[float, float]:
        """Richness weight of each state as the source of images of the other."""
        return self.evidence.weights

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

    @cached_property
    def touching(self) -> Mask:
        """[N0 + N1, k] whether neighbours are of one body."""
        return touching(self.surfels, self.graph)

    @cached_property
    def web(self) -> Web:
        """What neighbours with two labels cost."""
        return web_of(self.graph, self.bonds)

    def clues(self, labels: tuple[NDArray[np.int64], NDArray[np.int64]], count: int) -> Clues:
        """Return what draws the joints of parts 1..count, from labels of the Gaussians."""
        return Clues(self.guides, part_edges(self.segments, self.maps, self.gaussians, labels,
                                             count))

    def looking_at(self, evidence: Evidence) -> Study:
        """Return the study with other evidence; what was gathered once is not gathered again."""
        return self._keeping(replace(self, evidence=evidence))

    def under(self, shades: F64) -> Study:
        """Return the study in another light [8], taken out of all colours in place of the old."""
        def lit(surfels: Surfels) -> Surfels:
            return unshaded(surfels, shades, self.light.shades)

        zero, one = (replace(land, surfels=lit(land.surfels), shades=shades) for land in self.lands)
        return self._keeping(replace(
            self, surfels=(zero.surfels, one.surfels), lands=(zero, one),
            evidence=Evidence(*map(lit, self.evidence.sets)),
            light=replace(self.light, shades=shades)))

    def _keeping(self, new: Study) -> Study:
        known = ("straight", "guides", "ways", "web", "touching")
        vars(new).update({name: vars(self)[name] for name in known if name in vars(self)})
        return new

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
        count, states = int(hard.max(initial=0)) + 1, np.split(hard, [len(self.surfels[0])])
        zero, one = (near.shares(own, count).argmax(1)
                     for near, own in zip(self.around, states, strict=True))
        return zero, one

    def against(self, hard: Labels, count: int) -> tuple[F32, F32]:
        """Return per state [N_s, count] how surely a Gaussian is not of a part, 0..1."""
        zero, one = np.split(hard, [len(self.surfels[0])])
        return self.around[0].against(zero, count), self.around[1].against(one, count)

    def own(self, hard: NDArray[np.int64], part: int) -> tuple[Surfels, Surfels]:
        """Return the surfels of both states that have a label, from labels of all surfels."""
        n0 = len(self.surfels[0])
        return (self.surfels[0].select(hard[:n0] == part),
                self.surfels[1].select(hard[n0:] == part))


def gather(both: Canonical, config: SearchConfig | None = None) -> Study:
    """Return the study of two fitted states.

    Args:
        both: states, comparable.
        config: size of small views; None = the standard preset.

    Raises:
        FitError: a state's Gaussians show no surface.
    """
    config, seen = config or SearchConfig(), both.surfaces
    margin, voxel = MARGIN * seen.diag, both.surfel_size * seen.diag
    box = seen.box[0] - margin, seen.box[1] + margin
    lands = [replace(land, shades=seen.shades) for land in side_by_side([
        partial(build_landing, seen.surfels[s], seen.claimed[s], seen.maps[s], box, voxel, margin)
        for s in (0, 1)])]
    near = [around(both.gaussians[s], seen.surfels[s]) for s in (0, 1)]
    views = [small_views(state, config.proof_views, config.proof_side)
             for state in both.scene.states]
    normals = [seen.surfels[s].normals[near[s].index[:, 0]] for s in (0, 1)]
    segments = side_by_side([partial(segments_of, state) for state in both.scene.states])
    graph = build_graph(seen.surfels)
    views = side_by_side([partial(_with_floor, *pair) for pair in
                          zip(both.seen, views, strict=True)])
    return Study(
        both.seen,
        seen.maps,
        seen.surfels,
        (lands[0], lands[1]),
        seen.evidence,
        graph,
        (near[0], near[1]),
        (views[0], views[1]),
        seen.box,
        seen.diag,
        Light(seen.shades, (normals[0], normals[1])),
        (segments[0], segments[1]),
        bonds(seen.surfels, graph, seen.maps, both.scene.states, seen.diag),
    )


def _with_floor(own: Gaussians, views: SmallViews) -> SmallViews:
    return replace(views, floor=floor_of(own, views))


def distances(tau: float) -> tuple[float, ...]:
    """Return the matching distances of a refinement, decreasing, scene units."""
    return tuple(share * tau for share in COARSE_TO_FINE)
