"""Buffers used again: same results, no memory asked for, and no rendering read after its end."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import Rendered, render, render_backward
from part2gs_robotics.runtime.buffers import Workspace

COUNT, SIDE = 3000, 96
INTRINSICS = np.array([[110.0, 0, SIDE / 2], [0, 110.0, SIDE / 2], [0, 0, 1]])
VIEWMAT = np.eye(4)
VIEWMAT[2, 3] = 2.0
CAMERA = Camera(VIEWMAT, INTRINSICS, SIDE, SIDE)


def scene(seed: int) -> Splats:
    rng = np.random.default_rng(seed)
    arrays = (rng.uniform(-0.5, 0.5, (COUNT, 3)), rng.normal(size=(COUNT, 4)),
              rng.uniform(0.01, 0.04, (COUNT, 3)), rng.uniform(0.1, 0.9, COUNT),
              rng.uniform(0, 1, (COUNT, 3)))
    return Splats(*(a.astype(np.float32) for a in arrays))


def drawn(seed: int, workspace: Workspace | None) -> Rendered:
    return render(scene(seed), CAMERA, workspace=workspace)


def test_results_are_those_of_fresh_buffers() -> None:
    work, d_color = Workspace(), np.ones((SIDE, SIDE, 3), np.float32)
    for seed in (0, 1, 0):  # what an earlier scene left behind must not show
        ours, fresh = drawn(seed, work), drawn(seed, None)
        np.testing.assert_array_equal(ours.color, fresh.color)
        np.testing.assert_array_equal(render_backward(ours, d_color).means,
                                      render_backward(fresh, d_color).means)


def test_lists_of_pairs_grow_to_what_is_asked_for() -> None:
    tight = Workspace()
    tight.room = 1
    ours, fresh = drawn(0, tight), drawn(0, None)
    np.testing.assert_array_equal(ours.color, fresh.color)
    one, other = ours.saved.pairs, fresh.saved.pairs
    np.testing.assert_array_equal(one.table, other.table)
    np.testing.assert_array_equal(one.first, other.first)
    # Every pair of a Gaussian has a place of its own among the Gaussian's.
    places = one.table[:, 1]
    assert sorted(places) == list(range(len(places)))
    assert (one.first[one.table[:, 0]] <= places).all()
    assert (places < one.first[one.table[:, 0] + 1]).all()
    assert tight.room > 1


def test_nothing_is_allocated_once_the_buffers_have_grown() -> None:
    work, d_color = Workspace(), np.ones((SIDE, SIDE, 3), np.float32)
    splats = scene(0)

    def step() -> None:
        rendered = render(splats, CAMERA, workspace=work)
        render_backward(rendered, d_color)

    step()
    step()
    tracemalloc.start()
    try:
        step()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # Views, cameras and dataclasses are some kilobytes; the smallest image is 37, the arrays 200.
    assert peak < 32 * 1024


def test_a_rendering_whose_buffers_were_used_again_is_refused() -> None:
    work = Workspace()
    first = drawn(0, work)
    drawn(1, work)
    with pytest.raises(RuntimeError, match="number 1 of its workspace, which has drawn 2"):
        render_backward(first, np.ones((SIDE, SIDE, 3), np.float32))
    with pytest.raises(RuntimeError, match="workspace"):
        _ = first.median_depth


def test_buffers_start_at_cache_lines_and_grow() -> None:
    work = Workspace()
    small = work.take("a", (3,), np.float32)
    small[:] = 1
    assert work.take("a", (3,), np.float32).sum() == 3  # the same memory
    large = work.take("a", (100, 7), np.float64)
    assert large.shape == (100, 7)
    assert large.ctypes.data % 64 == 0
