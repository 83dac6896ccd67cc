"""How long `check` takes from a shell: cold, from the cache, and under stress.

    python benchmarks/check_time.py [--twins FOLDER ...] [--repeat 3]

Each is the command itself, imports and all; cold is the first of a new cache folder. Wall seconds
are of the quickest of some calls, beside them the seconds of the processor, which a machine that
others use as well does not change much. Without --twins the twin is the cabinet of exact boxes with
four joints. Numbers go to benchmarks/results/check_time.json, the table to docs/ci.md; --look
writes neither.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path
from typing import Any

from reconstruction_suite import git, insert
from toy_scenes import toy_cabinet_twin, write_all

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/check_time.json", ROOT / "docs/ci.md"
MARKS = "<!-- time:begin -->", "<!-- time:end -->"


def main() -> int:
    """Measure, store, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", type=Path, nargs="+", default=[], help="further twin folders")
    parser.add_argument("--repeat", type=int, default=3, help="calls of which the quickest counts")
    parser.add_argument("--look", action="store_true", help="write nothing")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        twins = [write_all(toy_cabinet_twin(4), Path(place) / "cabinet"), *args.twins]
        rows = [measured(twin, Path(place), args.repeat) for twin in twins]
    found = {"commit": git("rev-parse", "--short", "HEAD"), "repeat": args.repeat,
             "load": round(os.getloadavg()[0], 1), "cores": os.cpu_count(), "rows": rows}
    sys.stdout.write(markdown(found))
    if not args.look:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), markdown(found), *MARKS))
    return 0


def measured(twin: Path, place: Path, repeat: int) -> dict[str, Any]:
    """Return wall and processor seconds of the three calls."""
    cold = min(timed(twin, "--cache", str(place / f"{twin.name}_{k}")) for k in range(repeat))
    cached = min(timed(twin, "--cache", str(place / f"{twin.name}_0")) for _ in range(repeat))
    stress = min(timed(twin, "--stress") for _ in range(repeat))
    tree = json.loads(called(twin, "--format", "json").stdout)
    report = tree[0] if isinstance(tree, list) else tree
    return {"twin": twin.name, "joints": len(report["joints"]), "ok": report["ok"],
            "cold": cold, "cached": cached, "stress": stress}


def timed(twin: Path, *flags: str) -> tuple[float, float]:
    """Return wall seconds and those of the processor of one call."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    called(twin, *flags)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return round(wall, 2), round(after.ru_utime + after.ru_stime - before.ru_utime
                                 - before.ru_stime, 2)


def called(twin: Path, *flags: str) -> subprocess.CompletedProcess[str]:
    """Run the command."""
    program = str(Path(sysconfig.get_path("scripts")) / "part2gs-robot")
    return subprocess.run([program, "check", str(twin), *flags], capture_output=True, text=True,
                          check=False)


def markdown(found: dict[str, Any]) -> str:
    """Return a line and a row per twin."""
    lines = [f"`benchmarks/check_time.py` at {found['commit']}, {found['cores']} cores with a load "
             f"of {found['load']:g}, the quickest of {found['repeat']}: wall seconds / seconds of "
             "the processor.", "", "| twin | joints | passes | check, cold | from the cache | "
             "--stress |", "|---|--:|---|--:|--:|--:|"]
    for row in found["rows"]:
        cells = [f"{row[k][0]:.2f} / {row[k][1]:.2f}" for k in ("cold", "cached", "stress")]
        lines.append(f"| {row['twin']} | {row['joints']} | {'yes' if row['ok'] else 'no'} | "
                     f"{' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
