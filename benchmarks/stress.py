"""Error against run time, and what extremes make of a twin: numbers, two pictures and a table.

    python benchmarks/stress.py [--twin FOLDER]

The twin is the cabinet of exact boxes that benchmarks/sabotage.py breaks; --twin takes another one
and writes nothing. Numbers go to benchmarks/results/stress.json, pictures to docs/stress.svg and
docs/stress_frontier.svg, the tables to docs/stress.md. Seconds are of one thread of the processor.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from reconstruction_suite import git, insert
from toy_scenes import toy_cabinet_twin, write_all

from part2gs_robotics.ci.alone import Request, check_here

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/stress.json", ROOT / "docs/stress.md"
MARKS = "<!-- stress:begin -->", "<!-- stress:end -->"
PICTURES = {"precision": ROOT / "docs/stress.svg", "frontier": ROOT / "docs/stress_frontier.svg"}
SHOWN = ("own step", "ladder", "mass ratio", "gain span", "solref span", "clearance span",
         "scale span", "solver span", "tunnelling", "advised step")


def main() -> int:
    """Check, store, draw and write the tables; return the exit code of the check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twin", type=Path, help="another twin folder; nothing is written")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        twin = args.twin or write_all(toy_cabinet_twin(4), Path(place) / "cabinet")
        report = check_here(Request(str(twin), stress=True))
    numbers = dict(report.stress)
    pictures = numbers.pop("pictures")
    found = {"twin": twin.name, "commit": git("rev-parse", "--short", "HEAD"),
             "engine": report.engine, "seconds": round(report.seconds, 1), "stress": numbers,
             "rows": [r.to_dict() for r in report.results if r.name in SHOWN]}
    table = markdown(found)
    sys.stdout.write(table)
    if args.twin is None:
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), table, *MARKS))
        for name, path in PICTURES.items():
            path.write_text(pictures[name] + "\n")
    return report.exit_code


def markdown(found: dict[str, Any]) -> str:
    """Return a line, the table of rows, and a table of steps by integrator for both motions."""
    stress = found["stress"]
    lines = [f"{found['twin']}, {found['commit']}, {found['engine']}: all of `check --stress` "
             f"takes {found['seconds']:g} s, {stress['seconds']:.1f} s of it this page.", "",
             "| row | about | value | limit | what was found |", "|---|---|--:|--:|---|"]
    for r in found["rows"]:
        value, limit = ("" if r[k] is None else f"{r[k]:.3g}" for k in ("value", "limit"))
        lines.append(f"| {r['check']} | {r['subject']} | {value} {r['unit']} | {limit} | "
                     f"{r['note']} |")
    for kind, one in stress["precision"].items():
        lines += ["", *_points(kind, one)]
    return "\n".join(lines) + "\n"


def _points(kind: str, one: dict[str, Any]) -> list[str]:
    names = list(dict.fromkeys(p["integrator"] for p in one["points"]))
    told = one["reference"]
    lines = [f"{kind.capitalize()} motion, error of the range / ms of the processor for "
             f"{one['seconds']:g} s; the reference ({told['integrator']} at {told['step']:.3g} s) "
             f"is known to {told['own_error']:.1g}:", "",
             f"| time step, ms | {' | '.join(names)} |", "|--:|" + "--:|" * len(names)]
    for step in dict.fromkeys(p["step"] for p in one["points"]):
        row = {p["integrator"]: p for p in one["points"] if p["step"] == step}
        lines.append(f"| {step * 1e3:g} | " + " | ".join(
            "diverges" if row[n]["status"] == "diverged" else
            f"{row[n]['error']:.1e} / {row[n]['seconds'] * 1e3:.2f}" for n in names) + " |")
    orders = " | ".join("" if one["orders"][n] is None else f"{one['orders'][n]:.1f}"
                        for n in names)
    return [*lines, f"| order | {orders} |"]


if __name__ == "__main__":
    sys.exit(main())
