"""Fused surfels lie on the surface that the depth maps saw, and face outwards."""

from __future__ import annotations

import numpy as np


def test_surfels_of_a_box_lie_on_it_and_face_outwards(toy):
    lo, hi = np.array([0.0, 0, 0]), np.array([0.8, 0.6, 0.5])
    s = toy.seen_surface([toy.Box(tuple(lo), tuple(hi))]).surfels
    gap = np.maximum(lo - s.points, s.points - hi).max(1)  # 0 on a face, negative inside
    assert len(s) > 1500
    assert np.abs(gap).max() < 0.01  # half a voxel: the mean of a cell on an edge cuts the corner
    assert np.quantile(np.abs(gap), 0.9) < 1e-3
    outward = ((s.points - (lo + hi) / 2) * s.normals).sum(1)
    assert (outward > 0).mean() > 0.999
    assert np.allclose(np.linalg.norm(s.normals, axis=1), 1.0)
    assert (s.views >= 3).all()


def test_the_two_sides_of_a_thin_plate_stay_apart(toy):
    """The plate is thinner than a voxel, so only the facing direction separates its sides."""
    s = toy.seen_surface([toy.Box((0.0, 0.295, 0.0), (0.8, 0.305, 0.6))], voxel=0.03).surfels
    front, back = s.normals[:, 1] < -0.9, s.normals[:, 1] > 0.9
    assert front.sum() > 200
    assert back.sum() > 200
    assert np.abs(s.points[front, 1] - 0.295).max() < 2e-3
    assert np.abs(s.points[back, 1] - 0.305).max() < 2e-3


def test_colours_are_those_of_the_paint_where_the_surfel_is(toy):
    seen = toy.seen_surface([toy.Box((0, 0, 0), (0.8, 0.6, 0.5), 4)])
    s = seen.surfels
    view, K = seen.state.viewmats[0], seen.state.Ks[0]
    local = s.points @ view[:3, :3].T + view[:3, 3]
    towards = (s.normals @ view[:3, :3].T * local).sum(1) / np.linalg.norm(local, axis=1) < -0.5
    pixel = np.floor(local[towards, :2] / local[towards, 2:] * K[0, 0] + K[0, 2]).astype(int)
    shown = seen.state.images[0][pixel[:, 1], pixel[:, 0]] / 255.0
    assert np.median(np.abs(shown - s.colors[towards])) < 0.05
