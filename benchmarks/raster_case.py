"""Time one case of benchmarks/raster.py: our kernel, the yardstick, and a training iteration."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import raster_naive
from numpy.typing import NDArray
from raster_machine import fma_peak
from raster_pairs import FLOP_PER_PAIR, bytes_moved, evaluated_pairs, naive_pairs, tile_pairs
from raster_scene import box_surface, camera, corner_view, gaussians_of, photos

from part2gs_robotics.config import FitConfig
from part2gs_robotics.fit.fit_state import FitRun
from part2gs_robotics.fit.tones import tones_of
from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.runtime.buffers import Workspace

F64 = NDArray[np.float64]
Row = dict[str, Any]
Pass = Callable[[], tuple[float, float]]  # draws once; seconds forward and backward

FIRST_STEP = 1  # of the timed iterations; the first prune and split is at 50, runs are fewer


def our_pass(cloud: Splats, viewmats: F64, side: int) -> Pass:
    """Return what draws all views forward and backward with our kernel."""
    return _pass(render_cpu, cloud, viewmats, side, {"workspace": Workspace()})


def naive_pass(cloud: Splats, viewmats: F64, side: int) -> Pass:
    """Return what draws all views forward and backward with the yardstick."""
    return _pass(raster_naive, cloud, viewmats, side, {})


def _pass(kernel: ModuleType, cloud: Splats, viewmats: F64, side: int, more: Row) -> Pass:
    d_color = np.random.default_rng(1).normal(size=(side, side, 3)).astype(np.float32)
    cameras = [camera(viewmat, side) for viewmat in viewmats]

    def once() -> tuple[float, float]:
        forward = backward = 0.0
        for eye in cameras:
            start = time.perf_counter()
            rendered = kernel.render(cloud, eye, **more)
            middle = time.perf_counter()
            kernel.render_backward(rendered, d_color)
            backward += time.perf_counter() - middle
            forward += middle - start
        return forward, backward

    return once


def iteration(cloud: Splats, side: int) -> Callable[[], float]:
    """Return what runs one training iteration at full size and returns its seconds.

    A whole step of the fit: target, image, losses, gradients, Adam, tests for finite numbers.
    """
    state = photos(cloud, side)
    config = FitConfig(half_steps=0)
    run = FitRun(state, tones_of(state), gaussians_of(cloud), None, config, "box")
    steps = iter(range(FIRST_STEP, config.steps))

    def once() -> float:
        start = time.perf_counter()
        run.step(next(steps))
        return time.perf_counter() - start

    return once


def race(ours: Pass, naive: Pass, runs: int) -> tuple[F64, F64]:
    """Return ms [runs, 2] (forward, backward) of both, turn about; one run before is left out."""
    times: tuple[list[tuple[float, float]], list[tuple[float, float]]] = ([], [])
    for run in range(runs + 1):
        for which in (0, 1) if run % 2 else (1, 0):
            times[which].append((ours, naive)[which]())
    mine, other = (1e3 * np.array(rows[1:]) for rows in times)
    return mine, other


def spread(values: F64) -> dict[str, float]:
    """Return smallest value, quartiles and largest."""
    low, q1, median, q3, high = np.percentile(values, [0, 25, 50, 75, 100])
    return {"min": low, "q1": q1, "median": median, "q3": q3, "max": high}


def measure(count: int, side: int, runs: int) -> Row:
    """Return medians, spreads, pairs and shares of the measured peak of one case."""
    cloud, view = box_surface(count), corner_view()
    step = iteration(cloud, side)
    step()
    peak = fma_peak()
    ours, naive = race(our_pass(cloud, view[None], side), naive_pass(cloud, view[None], side), runs)
    steps = 1e3 * np.array([step() for _ in range(runs)])
    peak = max(peak, fma_peak())
    series = {"forward_ms": ours[:, 0], "backward_ms": ours[:, 1], "iteration_ms": steps,
              "naive_forward_ms": naive[:, 0], "naive_backward_ms": naive[:, 1]}
    totals = {"total_ms": ours.sum(1), "naive_total_ms": naive.sum(1)}
    medians = {name: float(np.median(values)) for name, values in (series | totals).items()}
    return {"gaussians": count, "size": side, **medians, **_counted(cloud, view, side),
            "runs": runs, "peak_gflops": peak,
            "spread": {name: spread(values) for name, values in (series | totals).items()}}


def _counted(cloud: Splats, view: F64, side: int) -> Row:
    """Return numbers of pairs and bytes; they do not depend on time."""
    ours = render_cpu.render(cloud, camera(view, side))
    naive = raster_naive.render(cloud, camera(view, side))
    evaluated, useful = naive_pairs(naive)
    return {"pairs_useful": useful, "pairs_evaluated": evaluated_pairs(ours),
            "naive_pairs_evaluated": evaluated, "tile_pairs": tile_pairs(ours),
            "bytes_moved": bytes_moved(len(cloud), side * side, tile_pairs(ours))}


def with_shares(row: Row, peak: float) -> Row:
    """Return a case with its shares of a peak in GFLOP/s, its GB/s and the speed-up."""
    ours, naive = (1e-3 * row[name] for name in ("total_ms", "naive_total_ms"))
    flop = {name: FLOP_PER_PAIR * row[name] * 1e-9 / peak
            for name in ("pairs_evaluated", "pairs_useful", "naive_pairs_evaluated")}
    return row | {
        "speedup": naive / ours, "peak_share": flop["pairs_evaluated"] / ours,
        "peak_share_useful": flop["pairs_useful"] / ours,
        "naive_peak_share": flop["naive_pairs_evaluated"] / naive,
        "gb_per_s": 1e-9 * row["bytes_moved"] / ours}
