"""The rasteriser's benchmark measures what it says: correct yardstick, counted pairs, its JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

from part2gs_robotics.fit.step import draw, params_of
from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.render.cpu import render

Load = Callable[[str], ModuleType]
SIDE = 70  # no multiple of a tile's side: the last tiles are cut
BEHIND = np.array([0.2, 0.5, 0.9], np.float32)


def drawn(load: Load, kernel: ModuleType) -> tuple[Any, Any]:
    scene = load("raster_scene")
    rng = np.random.default_rng(3)
    d_color, d_alpha, d_depth = (rng.normal(size=(SIDE, SIDE, *more)).astype(np.float32)
                                 for more in ((3,), (), ()))
    rendered = kernel.render(scene.box_surface(900), scene.camera(scene.corner_view(), SIDE),
                             background=BEHIND)
    return rendered, kernel.render_backward(rendered, d_color, d_alpha, d_depth)


def test_the_yardstick_draws_the_same_images(load: Load):
    ours, naive = (drawn(load, kernel)[0] for kernel in (render_cpu, load("raster_naive")))
    for name in ("color", "alpha", "depth"):
        apart = np.abs(getattr(ours, name) - getattr(naive, name))
        # Rounding puts single pixels on either side of alpha = 1/255 or T = 1e-4; depth is 2 units.
        assert apart.max() < 2.5 / 255
        assert apart.mean() < 1e-5
    assert np.array_equal(ours.visible, naive.visible)


def test_the_yardstick_has_the_same_gradients(load: Load):
    ours, naive = (drawn(load, kernel)[1] for kernel in (render_cpu, load("raster_naive")))
    for name in ("means", "quats", "scales", "opacities", "colors", "means2d_abs"):
        true, other = getattr(ours, name), getattr(naive, name)
        # float32 sums of thousands of pixels in another order: 1e-5 was seen, a wrong term is 1e-1.
        assert np.linalg.norm(true - other) < 1e-3 * np.linalg.norm(true), name


def test_pairs_of_one_gaussian_are_its_pixels(load: Load):
    count, naive, scene = load("raster_pairs"), load("raster_naive"), load("raster_scene")
    one = Splats(np.zeros((1, 3), np.float32), np.array([[1, 0.3, 0.2, 0.1]], np.float32),
                 np.array([[0.05, 0.15, 0.02]], np.float32), np.full(1, 0.8, np.float32),
                 np.ones((1, 3), np.float32))
    camera = scene.camera(scene.corner_view(), SIDE)
    ours = render(one, camera)
    covered = int((ours.alpha >= 1 / 255).sum())
    evaluated, useful = count.naive_pairs(naive.render(one, camera))
    assert useful == covered
    assert covered < evaluated < SIDE * SIDE
    assert covered <= count.evaluated_pairs(ours) <= SIDE * (SIDE + 8)
    assert count.evaluated_pairs(ours) % 8 == 0


def test_pairs_behind_stopped_pixels_are_not_counted(load: Load):
    count, naive, scene = load("raster_pairs"), load("raster_naive"), load("raster_scene")
    sheets = 10
    means = np.stack([np.zeros(sheets), np.zeros(sheets), np.linspace(0, 1, sheets)], 1)
    # Far wider than the image: 0.95 everywhere, so T = 0.05^4 < 1e-4 stops every pixel at the 4th.
    cloud = Splats(*(array.astype(np.float32) for array in (
        means, np.tile([1.0, 0, 0, 0], (sheets, 1)), np.tile([40.0, 40.0, 0.01], (sheets, 1)),
        np.full(sheets, 0.95), np.ones((sheets, 3)))))
    view = np.eye(4)
    view[2, 3] = scene.DISTANCE
    camera = scene.camera(view, SIDE)
    assert count.naive_pairs(naive.render(cloud, camera)) == (4 * SIDE**2, 4 * SIDE**2)
    assert count.evaluated_pairs(render(cloud, camera)) >= 4 * SIDE**2


def test_quick_writes_the_promised_json(load: Load, tmp_path: Path,
                                        capsys: pytest.CaptureFixture[str]):
    raster = load("raster")
    words = ["--quick", "--runs", "3", "--json", str(tmp_path / "out/raster.json")]
    assert raster.main(words, cases=((300, 40), (400, 48))) == 0
    result = json.loads((tmp_path / "out/raster.json").read_text())
    assert {"cases", "threads", "machine", "commit"} <= result.keys()
    assert [(row["gaussians"], row["size"]) for row in result["cases"]] == [(300, 40), (400, 48)]
    for row in result["cases"]:
        for name in ("forward_ms", "backward_ms", "iteration_ms", "naive_forward_ms",
                     "naive_backward_ms"):
            assert row["spread"][name]["min"] <= row[name] <= row["spread"][name]["max"]
        assert row["runs"] == 3
        assert 0 < row["pairs_useful"] <= row["naive_pairs_evaluated"]
        assert row["pairs_useful"] <= row["pairs_evaluated"]
        assert 0 < row["peak_share_useful"] <= row["peak_share"] < 1
    assert "| 300 | 40 |" in capsys.readouterr().out


def test_a_full_run_draws_its_figure(load: Load, tmp_path: Path):
    machine, case = load("raster_machine"), load("raster_case")
    curves, figure = load("raster_curves"), load("raster_figure")
    growth = curves.growth(1, gaussians=(100, 200), sides=(32, 40), views=(1, 2), count=150)
    for points in growth.values():
        assert all(point["ms"] > 0 and point["naive_ms"] > 0 for point in points)
    row = case.measure(300, 40, 1)
    fit = {kernel: [[0.0, 20.0, 300], [seconds, 25.0, 300]]
           for kernel, seconds in (("ours", 1.0), ("naive", 3.0))}
    figure.draw({"cases": [row, row], "by_threads": {"2": {"cases": [row, row]}},
                 "growth": growth, "fits": {"box": fit}, "threads": 2,
                 "machine": machine.machine(), "commit": "abc"}, tmp_path / "docs/raster.png")
    picture = cv2.imread(str(tmp_path / "docs/raster.png"))
    assert picture.shape[0] < picture.shape[1]
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10


def test_a_fit_can_draw_with_the_yardstick(load: Load):
    scene, naive = load("raster_scene"), load("raster_naive")
    params = params_of(scene.gaussians_of(scene.box_surface(50)))
    camera = scene.camera(scene.corner_view(), 32)
    d_color = np.ones((32, 32, 3), np.float32)
    with load("raster_fits").yardstick():
        fit = sys.modules["part2gs_robotics.fit.fit_state"]
        rendered = draw(params, camera, BEHIND)
        assert isinstance(rendered, naive.NaiveRendered)
        assert fit.render_backward(rendered, d_color).means.any()
    assert not isinstance(draw(params, camera, BEHIND), naive.NaiveRendered)
