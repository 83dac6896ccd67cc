"""Error against run time: every object, preset and share of the optimiser's steps.

    python benchmarks/reconstruction.py --kit PATH [--work DIR] [--objects NAME ...] [--quick]

The kit renders the objects, runs `part2gs-robot build` and scores the twin, which is all it sees.
Held-out PSNR over time is read from the checkpoints of one build; the twin's errors come from
builds stopped early. Every build leaves a file in the work folder, and the same command goes on
where it was interrupted; rows of earlier runs stay. Without --kit, the table in docs/results.md and
the figure are made from results/reconstruction.json.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from reconstruction_figure import draw
from reconstruction_runs import OBJECTS, kept, run_once, words_of_kit
from reconstruction_suite import PAGE, RESULTS, ROOT, git, insert
from reconstruction_table import markdown

from part2gs_robotics.config import PRESETS, FitConfig
from part2gs_robotics.render.pick_device import pick_device

OUT = RESULTS.parent / "reconstruction.json"
QUICK = "reconstruction_quick.json"  # in the work folder: a trial is no result
FIGURE = ROOT / "docs/reconstruction.png"
WORK = ROOT / "runs/reconstruction"
BEGIN, END = "<!-- anytime:begin -->", "<!-- anytime:end -->"
PICTURE = "![Errors of the twin over the seconds of its build](reconstruction.png)"
SHARES = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)


def main(words: Sequence[str] | None = None) -> int:
    """Run what is not there yet, store the numbers, write table and figure."""
    args = parser().parse_args(words)
    out = args.work / QUICK if args.quick else OUT
    if args.kit:
        rows = merged(out, [run(args, *job) for job in jobs(args)])
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(summary(rows), indent=1) + "\n")
    if not out.exists():
        sys.stderr.write(f"{out}: not there yet. Expected an earlier run; give --kit PATH.\n")
        return 2
    result = json.loads(out.read_text())
    table = markdown(result)
    draw(result, args.work / "reconstruction.png" if args.quick else FIGURE)
    if not args.quick:
        PAGE.write_text(insert(PAGE.read_text(), page(result), BEGIN, END))
    sys.stdout.write(table)
    return 0


def page(result: dict[str, Any]) -> str:
    """Return picture and table, as they stand in docs/results.md."""
    return f"{PICTURE}\n\n{markdown(result)}"


def parser() -> argparse.ArgumentParser:
    """Return the command line, shared with plan_table.py."""
    words = words_of_kit(__doc__, WORK, OBJECTS)
    words.add_argument("--presets", nargs="+", default=list(PRESETS))
    words.add_argument("--shares", nargs="+", type=float, default=list(SHARES),
                       help="shares of the preset's optimiser steps")
    words.add_argument("--devices", nargs="+", help="default: cpu, and cuda where it works")
    words.add_argument("--views", type=int, default=64)
    words.add_argument("--size", type=int, default=400)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--quick", action="store_true", help="one object, draft, two shares")
    return words


def jobs(args: argparse.Namespace) -> Iterator[tuple[str, str, str, float]]:
    """Yield (object, preset, device, share), whole budgets first: they tell most."""
    if args.quick:
        first = args.objects[0] if args.objects != list(OBJECTS) else "libero_microwave"
        yield from ((first, "draft", "cpu", share) for share in (1.0, 1 / 4))
        return
    devices = args.devices or (["cpu", "cuda"] if pick_device("auto") == "cuda" else ["cpu"])
    for device in devices:
        for share in sorted(args.shares, reverse=True):
            for preset in args.presets:
                yield from ((name, preset, device, share) for name in args.objects)


def run(args: argparse.Namespace, name: str, preset: str, device: str,
        share: float) -> dict[str, Any]:
    """Return the row of one build, from its file if it ran before."""
    full, half = (int(str(PRESETS[preset].get(key, getattr(FitConfig(), key))))
                  for key in ("steps", "half_steps"))
    steps = max(1, round(share * full))
    flags = ["--preset", preset, "--steps", str(steps), "--half-steps", str(round(share * half)),
             "--device", device]
    key = {"flags": flags, "views": args.views, "size": args.size, "seed": args.seed}
    label = f"{name}_{preset}_{device}_{steps}"

    def make() -> dict[str, Any]:
        sys.stderr.write(f"{label}\n")
        return run_once(args, args.work, name, flags)

    row = kept(args.work / "rows" / f"{label}.json", key, make)
    return {"preset": preset, "device": device, "share": share, "steps": steps} | row


def merged(out: Path, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows with those of earlier runs, which may be of other objects or presets."""
    def name(row: dict[str, Any]) -> tuple[object, ...]:
        return row["object"], row["preset"], row["device"], row["share"]

    earlier = json.loads(out.read_text())["rows"] if out.exists() else []
    return list(({name(row): row for row in earlier} | {name(row): row for row in rows}).values())


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the rows with machine, versions and commit."""
    return {
        "options": rows[0]["options"] if rows else {},
        "machine": f"{os.cpu_count()} CPU cores, {platform.machine()}",
        "commit": ", ".join(dict.fromkeys(row["commit"] for row in rows)),
        "date": git("log", "-1", "--format=%cs"),
        "rows": rows,
    }


if __name__ == "__main__":
    sys.exit(main())
