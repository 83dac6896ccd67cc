"""Time the CPU rasteriser, forward and backward; prints a table and, with a path, writes JSON.

Run: python benchmarks/raster.py [OUT.json]   (about 15 s; NUMBA_NUM_THREADS sets the threads)
"""

from __future__ import annotations

import datetime
import json
import platform
import sys
import time
from pathlib import Path

import numba
import numpy as np

from part2gs_robotics.render_cpu import render, render_backward

CASES = ((10_000, 256), (30_000, 256), (30_000, 400), (100_000, 800))  # Gaussians, image side
REPEATS = 9
DISTANCE = 2.0  # of the camera from a box of about 1 unit: it fills half of the image's width


def box_surface(count: int) -> tuple[np.ndarray, ...]:
    """Return means, quats, scales, opacities, colors of flat Gaussians on a box."""
    rng = np.random.default_rng(0)
    means = rng.uniform(-1, 1, (count, 3))
    face = rng.integers(0, 3, count)
    means[np.arange(count), face] = np.sign(means[np.arange(count), face])
    # Neighbours on the surface are 1 / sqrt(count) apart; a fitted scene overlaps about this much.
    scales = np.exp(rng.normal(np.log(1.6 / np.sqrt(count)), 0.4, (count, 3))) * [0.3, 1, 1]
    arrays = (means * [0.5, 0.35, 0.4], rng.normal(size=(count, 4)), scales,
              rng.uniform(0.2, 1, count), rng.uniform(0, 1, (count, 3)))
    return tuple(a.astype(np.float32) for a in arrays)


def camera(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return viewmat and K of a camera that looks down at a corner of the box."""
    a, b = 0.5, 0.4
    yaw = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    pitch = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    viewmat = np.eye(4)
    viewmat[:3, :3], viewmat[2, 3] = pitch @ yaw, DISTANCE
    return viewmat, np.array([[1.2 * side, 0, side / 2], [0, 1.2 * side, side / 2], [0, 0, 1]])


def measure(count: int, side: int) -> dict[str, float]:
    """Return median and best milliseconds of one case; the first run compiles and is left out."""
    gaussians, (viewmat, K) = box_surface(count), camera(side)
    d_color = np.random.default_rng(1).normal(size=(side, side, 3)).astype(np.float32)
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        rendered = render(*gaussians, viewmat, K, side, side)
        middle = time.perf_counter()
        render_backward(rendered, d_color)
        times.append((1e3 * (middle - start), 1e3 * (time.perf_counter() - middle)))
    forward, backward = np.array(times[1:]).T
    return {"gaussians": count, "side": side, "intersections": len(rendered.saved.ids),
            "forward_ms": float(np.median(forward)), "forward_best_ms": float(forward.min()),
            "backward_ms": float(np.median(backward)), "backward_best_ms": float(backward.min())}


def main() -> None:
    """Write one table row per case, then the JSON file if one is named."""
    sys.stdout.write("| Gaussians | side | tile pairs | forward ms (best) | backward ms (best) |\n")
    sys.stdout.write("|--:|--:|--:|--:|--:|\n")
    rows = []
    for case in CASES:
        row = measure(*case)
        rows.append(row)
        sys.stdout.write(
            f"| {row['gaussians']:,} | {row['side']} | {row['intersections']:,} "
            f"| {row['forward_ms']:.1f} ({row['forward_best_ms']:.1f}) "
            f"| {row['backward_ms']:.1f} ({row['backward_best_ms']:.1f}) |\n")
    if len(sys.argv) > 1:
        result = {"machine": platform.processor() or platform.machine(),
                  "threads": numba.get_num_threads(), "numba": numba.__version__,
                  "date": datetime.date.today().isoformat(), "cases": rows}
        Path(sys.argv[1]).write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
