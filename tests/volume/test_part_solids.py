"""Solids of parts: what was seen of them stays, blobs that hardly any view saw do not."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.grid import Grid
from part2gs_robotics.volume.carve import Solid
from part2gs_robotics.volume.fuse import TRUNCATION, Fused
from part2gs_robotics.volume.part_solids import keep_large, without_blobs


def box_solid(grid, lo, hi) -> Solid:
    points = grid.centers(np.stack(np.indices(grid.shape), -1))
    inside = np.minimum(points - lo, hi - points).min(-1) / grid.voxel
    return Solid(grid, np.clip(inside, -TRUNCATION, TRUNCATION).astype(np.float32))


def test_a_small_piece_that_was_seen_stays():
    grid = Grid.around(np.zeros(3), np.full(3, 0.6), 0.01)
    body = box_solid(grid, np.full(3, 0.05), np.full(3, 0.4))
    rail = box_solid(grid, np.array([0.05, 0.5, 0.5]), np.array([0.4, 0.53, 0.53]))
    both = Solid(grid, np.maximum(body.values, rail.values))
    zero = np.zeros(grid.shape, np.float32)
    seen = Fused(grid, zero, zero, 2.0 * (np.abs(rail.values) < 3), *[zero] * 7)
    assert (keep_large(both).values > 0).sum() == (body.values > 0).sum()
    np.testing.assert_array_equal(keep_large(both, seen).values, both.values)


def test_a_separate_piece_of_a_moving_part_that_views_hardly_saw_is_left_out():
    grid = Grid.around(np.zeros(3), np.full(3, 0.8), 0.01)
    body = box_solid(grid, np.full(3, 0.05), np.array([0.4, 0.4, 0.2]))
    knob = box_solid(grid, np.array([0.1, 0.1, 0.25]), np.array([0.2, 0.2, 0.35]))
    blob = box_solid(grid, np.full(3, 0.5), np.full(3, 0.75))
    air = Solid(grid, np.maximum.reduce([body.values, knob.values, blob.values]))
    votes = 2.0 * ((np.abs(body.values) < 3) | (np.abs(knob.values) < 3))
    votes += 2.0 * (np.abs(blob.values) < 0.3)  # a few stray votes at its rim
    zero = np.zeros(grid.shape, np.float32)
    seen = Fused(grid, zero, zero, votes, *[zero] * 7)
    left = without_blobs(air, seen).values > 0
    np.testing.assert_array_equal(left, (body.values > 0) | (knob.values > 0))
    unseen = Fused(grid, *[zero] * 10)  # the largest stays whatever was seen
    np.testing.assert_array_equal(without_blobs(air, unseen).values > 0, body.values > 0)
