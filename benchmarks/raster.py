"""Time the CPU rasteriser against a plain one in the same run, and draw how it grows.

    python benchmarks/raster.py --quick --json FILE    # the four cases, under a minute
    python benchmarks/raster.py [--kit PATH]           # everything; writes the docs' figure too

The full run adds one and two threads, growth in Gaussians, pixels and views, and held-out PSNR over
seconds of three fits with either kernel: objects of an external kit, or scenes made here.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numba
from raster_case import measure, with_shares
from raster_curves import growth
from raster_figure import draw
from raster_fits import OBJECTS, fits, made_scenes, shot_scenes
from raster_machine import ROOT, commit, machine

CASES = ((10_000, 256), (30_000, 256), (30_000, 400), (100_000, 800))  # Gaussians, image side
QUICK_RUNS, RUNS = 7, 15
RESULTS, FIGURE = ROOT / "benchmarks/results/raster.json", ROOT / "docs/raster.png"


def main(words: Sequence[str] | None = None, cases: Sequence[tuple[int, int]] = CASES) -> int:
    """Measure, print the table, write JSON and, in the full run, the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="only the four cases")
    parser.add_argument("--json", type=Path, help=f"default of the full run: {RESULTS}")
    parser.add_argument("--runs", type=int, help="repetitions behind each median")
    parser.add_argument("--figure", type=Path, default=FIGURE)
    parser.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS), help="of the kit")
    parser.add_argument("--steps", type=int, default=800, help="of each fit")
    args = parser.parse_args(words)
    result = report(cases, args.runs or (QUICK_RUNS if args.quick else RUNS))
    sys.stdout.write(table(result))
    if not args.quick:
        result |= full(args, result, cases)
        draw(result, args.figure)
    path = args.json or (None if args.quick else RESULTS)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(rounded(result), indent=1) + "\n")
    return 0


def report(cases: Sequence[tuple[int, int]], runs: int) -> dict[str, Any]:
    """Measure the cases with numba's present threads; shares are of the best peak of the run."""
    rows = [measure(count, side, runs) for count, side in cases]
    peak = max(row.pop("peak_gflops") for row in rows)
    return {"cases": [with_shares(row, peak) for row in rows], "threads": numba.get_num_threads(),
            "machine": machine(), "commit": commit(), "fma_peak_gflops": peak}


def full(args: argparse.Namespace, result: dict[str, Any], cases: Sequence[tuple[int, int]],
         ) -> dict[str, Any]:
    """Return threads, growth and fits."""
    by_threads = {}
    for threads in (1, 2):
        if threads == result["threads"]:
            by_threads[str(threads)] = {key: result[key] for key in ("cases", "fma_peak_gflops")}
        elif threads < result["threads"]:
            with on_threads(threads):
                found = report(cases, args.runs or RUNS)
            by_threads[str(threads)] = {key: found[key] for key in ("cases", "fma_peak_gflops")}
    curves = growth(args.runs or RUNS)
    with tempfile.TemporaryDirectory() as folder:
        scenes = (shot_scenes(args.kit, args.objects, Path(folder)) if args.kit
                  else made_scenes(Path(folder)))
        return {"by_threads": by_threads, "growth": curves, "fits": fits(scenes, args.steps)}


@contextmanager
def on_threads(count: int) -> Iterator[None]:
    """Use some threads in numba and in OpenCV, whose blurs are part of an iteration."""
    before = numba.get_num_threads(), cv2.getNumThreads()
    numba.set_num_threads(count)
    cv2.setNumThreads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


def table(result: dict[str, Any]) -> str:
    """Return the cases as a Markdown table: medians, quartiles in brackets."""
    lines = ["| Gaussians | side | forward ms | backward ms | both ms | plain kernel ms | ratio "
             "| iteration ms | share of peak (useful) | GB/s |", "|--:" * 10 + "|"]
    for row in result["cases"]:
        times = [_cell(row["spread"][f"{name}_ms"])
                 for name in ("forward", "backward", "total", "naive_total")]
        share = f"{100 * row['peak_share']:.1f} % ({100 * row['peak_share_useful']:.1f} %)"
        cells = [f"{row['gaussians']:,}", str(row["size"]), *times, f"{row['speedup']:.2f}",
                 _cell(row["spread"]["iteration_ms"]), share, f"{row['gb_per_s']:.1f}"]
        lines.append("| " + " | ".join(cells) + " |")
    lines += ["", f"{result['machine']}, {result['threads']} threads, measured peak "
              f"{result['fma_peak_gflops']:.0f} GFLOP/s, commit {result['commit']}"]
    return "\n".join(lines) + "\n"


def _cell(spread: dict[str, float]) -> str:
    return f"{spread['median']:.1f} ({spread['q1']:.1f}–{spread['q3']:.1f})"


def rounded(value: Any) -> Any:
    """Return nested results with floats of five digits: more is noise."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


if __name__ == "__main__":
    sys.exit(main())
