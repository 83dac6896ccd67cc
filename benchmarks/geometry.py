"""Measure the shape, limits and use of exported twins, and put the tables into docs.

    python benchmarks/geometry.py --kit PATH --work FOLDER [FOLDER ...]

The kit is a folder with `look.py`, `score.py`, `oracle.py` and `grasp.py`; every FOLDER holds the
scenes and twins that its suite made. Every finished twin is measured, the missing ones are named.
Rows of objects that are not there are kept; every row names the commit it was measured at. Without
--kit the tables of docs/geometry.md are made anew from benchmarks/results/geometry.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from geometry_grips import grips
from geometry_kit import attempt, cases, module, wanted
from geometry_measures import measured
from geometry_stops import stops
from geometry_tables import markdown
from reconstruction_suite import git, insert

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/geometry.json", ROOT / "docs/geometry.md"
MARKS = "<!-- geometry:begin -->", "<!-- geometry:end -->"
DIGITS = 5  # of a figure in the JSON, significant


def main() -> int:
    """Measure what is there if a kit is given, store the numbers, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    parser.add_argument("--work", type=Path, nargs="+", default=[], help="folders of its suite")
    parser.add_argument("--objects", nargs="+", help="only these")
    parser.add_argument("--pictures", type=Path, help="folder for the kit's pictures")
    args = parser.parse_args()
    if args.kit and args.work:
        RESULTS.parent.mkdir(parents=True, exist_ok=True)
        run(args)
    if not RESULTS.exists():
        sys.stderr.write(f"{RESULTS}: not there yet. Expected an earlier run; give --kit PATH and "
                         "--work FOLDER.\n")
        return 2
    table = markdown(json.loads(RESULTS.read_text()))
    PAGE.write_text(insert(PAGE.read_text(), table, *MARKS))
    sys.stdout.write(table)
    return 0


def run(args: argparse.Namespace) -> None:
    """Measure every finished twin; numbers are stored after each."""
    names, found = wanted(args.kit), cases(args.kit, args.work)
    found = [case for case in found if not args.objects or case.name in args.objects]
    there = {case.name for case in found}
    missing = [name for name in names if name not in there]
    sys.stderr.write(f"{len(found)} twins; not there: {', '.join(missing) or 'none'}\n")
    result = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"rows": []}
    commit = git("rev-parse", "--short", "HEAD")
    if args.pictures:
        args.pictures.mkdir(parents=True, exist_ok=True)
    for case in sorted(found, key=lambda case: names.index(case.name) if case.name in names
                       else len(names)):
        picture = args.pictures / f"{case.name}.png" if args.pictures else None
        row = measured(case, stops, picture)
        row["grips"] = attempt(f"{case.name}: grips",
                               lambda case=case: grips(case, args.pictures)) or []
        row = plain(row | {"licence": licence(case), "commit": commit})
        rows = [r for r in result["rows"] if r["object"] != case.name] + [row]
        result["rows"] = sorted(rows, key=lambda r: names.index(r["object"])
                                if r["object"] in names else len(names))
        result["objects"] = names
        RESULTS.write_text(json.dumps(result, indent=1) + "\n")


def licence(case: Any) -> str:
    """Return the first word of what an object may be used under."""
    entry = module(case.kit, "common").load_entry(case.name, case.kit / "objects.yaml")
    return str(entry["licence"]).split()[0].rstrip(":")


def plain(value: Any) -> Any:
    """Return numbers, lists and mappings as JSON has them, floats short, NaN as null."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if value is None or isinstance(value, str | bool | int):
        return value
    number = float(value)
    return float(f"{number:.{DIGITS}g}") if number - number == 0 else None


if __name__ == "__main__":
    sys.exit(main())
