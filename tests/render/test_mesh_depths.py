"""Depths of meshes: every pixel as the plane of the nearest triangle over it says, by numpy."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.render.mesh_depths import draw_faces

WIDTH, HEIGHT, FOCAL = 60, 44, 50.0
INSIDE = 1e-6  # of a triangle's height, by which a pixel beyond its edge counts
K = np.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])


def drawn(vertices, faces):
    depths = np.full((1, HEIGHT, WIDTH), np.inf, np.float32)
    shown = np.full((1, HEIGHT, WIDTH), -1)
    draw_faces(vertices.astype(np.float32), faces, K[None], np.eye(4)[None], 1e-3, depths, shown)
    return depths[0], shown[0]


def reference(vertices, faces):
    """Return depths, faces, and where an edge is so near that rounding decides."""
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    depths, shown = np.full(x.shape, np.inf), np.full(x.shape, -1)
    close = np.zeros(x.shape, bool)
    for f, corners in enumerate(vertices.astype(np.float32).astype(float)[faces]):
        (px, py), (qx, qy), (rx, ry) = FOCAL * corners[:, :2] / corners[:, 2:] + K[:2, 2]
        double = (qx - px) * (ry - py) - (qy - py) * (rx - px)
        u = ((qx - x) * (ry - y) - (qy - y) * (rx - x)) / double
        t = ((rx - x) * (py - y) - (ry - y) * (px - x)) / double
        least = np.minimum(np.minimum(u, t), 1 - u - t)
        z = 1.0 / (np.stack([u, t, 1 - u - t], -1) @ (1.0 / corners[:, 2]))
        nearest = (least >= -INSIDE) & (z < depths)
        depths[nearest], shown[nearest] = z[nearest], f
        close |= (np.abs(least + INSIDE) < 1e-3) & (least > -1)
    return depths, shown, close


@pytest.mark.parametrize("thin", [1.0, 0.05, 0.003])
def test_every_pixel_shows_the_nearest_triangle_over_it(thin):
    """Large ones, slivers, and some that reach beyond the image."""
    rng = np.random.default_rng(0)
    first = rng.uniform((-0.7, -0.5, 1.0), (0.7, 0.5, 1.3), (200, 3))
    way = rng.normal(size=(200, 2, 3)) * (0.25, 0.25, 0.1)
    corners = np.stack([first, first + way[:, 0], first + way[:, 0] * 0.5 + thin * way[:, 1]], 1)
    vertices, faces = corners.reshape(-1, 3), np.arange(600).reshape(-1, 3)
    depths, shown = drawn(vertices, faces)
    right, numbers, close = reference(vertices, faces)
    assert (np.isfinite(right) & ~close).sum() > (200 if thin == 1.0 else 20)
    np.testing.assert_array_equal(shown[~close], numbers[~close])
    np.testing.assert_allclose(depths[~close], right[~close], rtol=1e-4)


def test_edges_along_rows_and_columns_leave_no_pixel_out():
    """Two halves of a square whose sides go through pixels' centres."""
    side = np.array([-0.2, 0.2])
    square = np.array([[x, y, 1.0] for y in side for x in side])
    depths, _ = drawn(square, np.array([[0, 1, 2], [1, 3, 2]]))
    assert np.isfinite(depths).sum() in range(20 * 20, 21 * 21 + 1)
    assert np.isfinite(depths[13:31, 21:39]).all()
