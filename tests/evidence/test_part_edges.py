"""Straight edges in the photos, and the part that each is of."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.evidence.part_edges import part_edges
from part2gs_robotics.evidence.segments import segments_of


def test_an_edge_belongs_to_the_part_that_is_nearer(toy):
    """Photos of a plate before a larger base: the plate's outline is its own, the base's is not."""
    boxes = [toy.Box((-0.5, 0.2, -0.5), (0.5, 0.6, 0.5), 1),
             toy.Box((-0.2, -0.1, -0.2), (0.2, -0.05, 0.2), 2)]
    state = toy.photographed(boxes, *toy.cameras(16, 160, np.zeros(3), 1.3), 160)
    gaussians, owner = toy.gaussians_of(boxes, 0.04)
    segments = segments_of(state)
    maps = toy.depth_maps_of_images(state)
    plate, = part_edges([segments] * 2, [maps] * 2, [gaussians] * 2, [owner] * 2, 1)
    lines = len(plate.bundles[0].lengths)
    assert lines > 15
    assert (np.abs(plate.ways[0]).max(1) > 0.95).mean() > 0.7  # mostly along its own edges
    base, = part_edges([segments] * 2, [maps] * 2, [gaussians] * 2, [1 - owner] * 2, 1)
    assert lines + len(base.bundles[0].lengths) <= len(segments)  # none belongs to both
    # A segment of the plate lies on one of its edges: its plane holds two corners or more.
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, -0.05) for z in (-0.2, 0.2)])
    bundle = plate.bundles[0]
    camera = np.linalg.inv(state.viewmats)[bundle.cameras, :3, 3]
    gaps = np.abs(np.einsum("nj,ncj->nc", bundle.planes, corners - camera[:, None]))
    assert ((gaps < 0.01).sum(1) >= 2).mean() > 0.7
