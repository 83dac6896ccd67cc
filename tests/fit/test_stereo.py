"""Stereo inside the visual hull: an open cup, whose floor no silhouette shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.config import FitConfig
from part2gs_robotics.fit.hull import carve
from part2gs_robotics.fit.start import first_gaussians
from part2gs_robotics.fit.stereo import stereo_depths
from part2gs_robotics.fit.stereo_kernels import TRUNCATED, aggregate, matching_cost

WALL, SIZE, HEIGHT = 0.06, 0.8, 0.5
CENTRE = np.array([SIZE / 2, SIZE / 2, HEIGHT / 2])
DIAGONAL = float(np.linalg.norm([SIZE, SIZE, HEIGHT]))


@pytest.fixture(scope="module")
def cup(toy):
    """Ray-cast photos of an open cup with exact depth, and its hull."""
    s, w, h = SIZE, WALL, HEIGHT
    walls = [((0, 0, 0), (s, s, w)), ((0, 0, 0), (w, s, h)), ((s - w, 0, 0), (s, s, h)),
             ((0, 0, 0), (s, w, h)), ((0, s - w, 0), (s, s, h))]
    boxes = [toy.Box(lo, hi, i) for i, (lo, hi) in enumerate(walls, 1)]
    state = toy.cast(boxes, *toy.cameras(40, 120, CENTRE, DIAGONAL), 120)
    return state, carve(replace(state, depths=None), resolution=64)


def middle_of_floor(points):
    """Return which points are over the middle of the floor, off the walls."""
    return (np.abs(points[:, :2] - SIZE / 2) < SIZE / 2 - 2 * WALL).all(1)


def test_the_floor_of_a_cup_is_seen_by_stereo_and_not_by_silhouettes(cup) -> None:
    state, hull = cup
    lid = np.array([[SIZE / 2, SIZE / 2, HEIGHT - WALL]])
    assert hull.sample(lid)[0] > 0  # the hull is closed up there
    maps, views = stereo_depths(replace(state, depths=None), hull)
    assert maps.depths.shape == views.alphas.shape
    height, width = maps.depths.shape[1:]
    rows = ((np.arange(height) + 0.5) * state.height / height).astype(int)
    cols = ((np.arange(width) + 0.5) * state.width / width).astype(int)
    order = [int(np.abs(state.viewmats - m).sum((1, 2)).argmin()) for m in views.viewmats]
    truth = state.depths[order][:, rows][:, :, cols]
    both = (maps.depths > 0) & (truth > 0)
    error = np.abs(maps.depths - truth)[both] / DIAGONAL
    assert both.sum() > 0.95 * (truth > 0).sum()
    assert np.median(error) < 0.006  # bins are 0.01 apart
    assert (error > 0.05).mean() < 0.12  # the hull alone is that wrong in a fifth of the pixels


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_fit_starts_on_the_floor_and_not_on_the_lid(cup, with_depth: bool) -> None:
    state, hull = cup
    seen = state if with_depth else replace(state, depths=None)
    start = first_gaussians(hull, seen, FitConfig(start_gaussians=2000))
    points = start.means[middle_of_floor(start.means)]
    top = points[:, 2] > HEIGHT - 0.03
    floor = np.abs(points[:, 2] - WALL) < 0.03
    assert floor.sum() > 60
    assert top.sum() < 0.1 * floor.sum()


def test_a_box_keeps_its_hull(toy) -> None:
    state = toy.cast([toy.Box((0, 0, 0), (SIZE, SIZE, HEIGHT), 1)],
                     *toy.cameras(24, 96, CENTRE, DIAGONAL), 96)
    hull = carve(replace(state, depths=None), resolution=48)
    start = first_gaussians(hull, replace(state, depths=None), FitConfig(start_gaussians=1500))
    outside = np.maximum(start.means - [SIZE, SIZE, HEIGHT], -start.means).max(1)
    assert (np.abs(outside) < 0.04).mean() > 0.97  # on a face; a hull voxel is 0.017


def aggregated(cost: np.ndarray, image: np.ndarray, front: np.ndarray) -> np.ndarray:
    total = np.zeros_like(cost)
    mask = np.ones(cost.shape[:2], bool)
    for dy, dx in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        aggregate(cost, total, image, mask, front, dy, dx)
    return total.argmin(-1)


def test_a_plain_surface_takes_the_depth_of_its_outline() -> None:
    cost = np.zeros((20, 20, 12), np.float32)  # any depth looks right inside
    outline = np.ones((20, 20), bool)
    outline[1:-1, 1:-1] = False
    cost[outline] = 0.1
    cost[outline, 7] = 0.0
    plain, level = np.full((20, 20, 3), 0.5, np.float32), np.zeros((20, 20), np.float32)
    assert (aggregated(cost, plain, level) == 7).all()


def test_following_the_slope_of_the_hull_costs_nothing() -> None:
    cost = np.full((8, 30, 40), 0.1, np.float32)
    slanted = np.arange(30) + 2
    cost[:, np.arange(30), slanted] = 0.099  # hardly better than any level profile
    plain = np.full((8, 30, 3), 0.5, np.float32)
    front = np.repeat(np.arange(30, dtype=np.float32)[None], 8, 0)
    assert (aggregated(cost, plain, front) == slanted).all()


@pytest.mark.parametrize(("views", "used"), [(1, 1), (4, 3), (6, 6), (12, 9)])
def test_a_depth_costs_what_the_views_that_like_it_best_differ_by(views, used) -> None:
    """Against the plain formula: bilinear colours of each view, the best of them averaged."""
    rng = np.random.default_rng(views)
    image, others = (rng.random(size, np.float32) for size in ((3, 4, 3), (views, 9, 11, 3)))
    others *= 0.2  # near enough to the image for differences below the truncation
    image *= 0.2
    inverse, first, last = np.linspace(2.0, 0.5, 13), np.full((3, 4), 0.7), np.full((3, 4), 1.6)
    first[0, 0], last[0, 0] = 0.0, 0.1  # a ray that misses
    rays, shifts = rng.uniform(-0.3, 0.3, (3, 4, 2)), rng.uniform(-1.0, 1.0, (views, 2))
    cams = np.tile(np.array([[9.0, 0, 5.0, 0], [0, 9.0, 4.5, 0], [0, 0, 1, 0]]), (views, 1, 1))
    cams[:, :2, 3] = shifts
    cost = np.zeros((3, 4, 13), np.float32)
    matching_cost(image, first.astype(np.float32), last.astype(np.float32), inverse, rays, cams,
                  others, used, 0.01, cost)
    for i, j, k in np.ndindex(cost.shape):
        z = 1.0 / inverse[k]
        if not first[i, j] <= z <= last[i, j]:
            assert cost[i, j, k] == np.float32(2 * TRUNCATED)
            continue
        place = np.array([*(rays[i, j] * z), z, 1.0])
        found = []
        for cam, other in zip(cams, others, strict=True):
            u, v = (cam @ place)[:2] / z - 0.5
            if not (0 <= u < 10 and 0 <= v < 8):
                found.append(TRUNCATED)
                continue
            a, b = int(v), int(u)
            rows = (1 - v + a) * other[a:a + 2][0] + (v - a) * other[a:a + 2][1]
            color = (1 - u + b) * rows[b] + (u - b) * rows[b + 1]
            found.append(min(float(np.abs(color - image[i, j]).mean()), TRUNCATED))
        behind = max((1 / first[i, j] - inverse[k]) / (inverse[0] - inverse[1]), 0.0)
        wanted = np.mean(sorted(found)[:used]) + 0.01 * behind
        assert cost[i, j, k] == pytest.approx(wanted, abs=2e-6)
    assert len(np.unique(cost)) > 20
