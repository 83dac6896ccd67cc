"""Time and measure the fit of one state: held-out PSNR over time, error of the median depth.

Run: python benchmarks/fit.py SCENE [STATE] [--steps N]   (about a minute on two free cores)
Depth images of the scene, if any, only measure; the fit never sees them. Prints one JSON object.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.fit.fit_state import FitConfig, FitResult, fit_state
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.render.cpu import render


def depth_error(state: StateViews, result: FitResult) -> dict[str, float]:
    """Return |median depth - truth| over held-out pixels, per cent of the hull's diagonal."""
    if state.depths is None or result.hull is None:
        return {}
    g, errors = result.gaussians, []
    for view in np.flatnonzero(state.held_out):
        drawn = render(g.splats, state.camera(view))
        truth = state.depths[view]
        both = (truth > 0) & (state.alphas[view] == 255) & (drawn.median_depth > 0)
        errors.append(np.abs(drawn.median_depth - truth)[both])
    share = 100 * np.concatenate(errors) / result.hull.diagonal
    return {f"p{q}": round(float(np.percentile(share, q)), 3) for q in (50, 75, 90, 95)}


def main() -> None:
    """Fit one state and print the measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("state", type=int, choices=(0, 1), nargs="?", default=0)
    parser.add_argument("--steps", type=int, default=FitConfig.steps)
    args = parser.parse_args()
    state = read_scene(args.scene, ReadConfig()).states[args.state]
    blind, half = replace(state, depths=None), min(FitConfig.half_steps, args.steps // 2)
    fit_state(blind, config=FitConfig(steps=2, half_steps=1))  # compiles the kernels
    start = time.perf_counter()
    result = fit_state(blind, config=FitConfig(steps=args.steps, half_steps=half))
    row = {"scene": args.scene.name, "state": args.state, "steps": args.steps,
           "views": len(state), "size": [state.width, state.height],
           "threads": numba.get_num_threads(),
           "seconds": round(time.perf_counter() - start, 1),
           "psnr_held_out_white": round(result.curve[-1][1], 2),
           "gaussians": len(result.gaussians), "median_depth_error_percent":
           depth_error(state, result),
           "curve": [[round(t, 1), round(db, 2), n] for t, db, n in result.curve]}
    sys.stdout.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main()
