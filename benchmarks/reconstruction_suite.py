"""Score `part2gs-robot build` with an external benchmark kit and put its table into docs.

    python benchmarks/reconstruction_suite.py --kit PATH [--objects NAME ...]

The kit is a folder with `suite.py`, which renders objects, runs the command, reads the exported
MJCF and scores it against the truth; it never sees anything else of this project. The table goes to
docs/results.md, a few rows of it to README.md. Without --kit both are made anew from
benchmarks/results/suite.json. Objects that are not run keep their rows; every row names the commit
it was made at.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/suite.json"
PAGE, README = ROOT / "docs/results.md", ROOT / "README.md"
BEGIN, END = "<!-- suite:begin -->", "<!-- suite:end -->"
SUMMARY = "<!-- summary:begin -->", "<!-- summary:end -->"
OBJECTS = ("libero_microwave", "pm_10211_laptop", "robosuite_door", "pm_103275_stapler",
           "pm_102209_trashcan", "libero_wooden_cabinet", "sektion_cabinet", "pm_31249_table",
           "bigym_dishwasher", "robosuite_door_nested", "pm_103275_stapler_nested")
COMMAND = "part2gs-robot build {scene} -o {out}"
HEAD = (
    "object", "moving parts found", "joint types right", "axis, deg", "position, % of diagonal",
    "turn, deg", "slide, units", "segmentation mIoU", "watertight", "checks", "seconds", "peak MB",
    "commit",
)  # fmt: skip
# Rows of README: one joint, many, a part on a part, and the object that is not all found.
SHOWN = {
    "libero_microwave": "microwave: door",
    "sektion_cabinet": "cabinet: two doors, two drawers",
    "libero_wooden_cabinet": "wooden cabinet: three drawers",
    "robosuite_door_nested": "door with a latch on it",
    "bigym_dishwasher": "dishwasher: door, two wire trays",
}


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the tables."""
    args = arguments(__doc__.splitlines()[0], OBJECTS)
    if args.kit:
        with tempfile.TemporaryDirectory() as temporary:
            store(RESULTS, run_kit(args, args.work or Path(temporary)))
    if not RESULTS.exists():
        sys.stderr.write(f"{RESULTS}: not there yet. Expected an earlier run; give --kit PATH.\n")
        return 2
    result = json.loads(RESULTS.read_text())
    table = markdown(result)
    PAGE.write_text(insert(PAGE.read_text(), table))
    README.write_text(insert(README.read_text(), short(result), *SUMMARY))
    sys.stdout.write(table)
    return 0


def score_own(purpose: str, names: Sequence[str], script: str, page: Path,
              flags: Callable[[Path], Sequence[str]]) -> int:
    """Score a script's own objects with the kit and put their table into a page; return 0.

    Args:
        purpose: first line of the script's help.
        names: of its objects.
        script: benchmarks/NAME.py; its numbers are kept in benchmarks/results/NAME.json.
        page: Markdown with markers of its own name around the table.
        flags: writes what the kit needs into a folder and returns the kit's flags.
    """
    args, results = arguments(purpose, names), ROOT / f"benchmarks/results/{Path(script).stem}.json"
    if args.kit:
        with tempfile.TemporaryDirectory() as temporary:
            work = args.work or Path(temporary)
            store(results, run_kit(args, work, flags(work)))
    table = markdown(json.loads(results.read_text()), script)
    marks = (f"<!-- {page.stem}:{end} -->" for end in ("begin", "end"))
    page.write_text(insert(page.read_text(), table, *marks))
    sys.stdout.write(table)
    return 0


def store(results: Path, found: dict[str, Any]) -> None:
    """Write the rows that were run beside the earlier ones."""
    results.parent.mkdir(parents=True, exist_ok=True)
    earlier = json.loads(results.read_text())["rows"] if results.exists() else []
    result = summary(found)
    result["rows"] = merged(earlier, result["rows"])
    results.write_text(json.dumps(result, indent=1) + "\n")


def arguments(purpose: str, objects: Sequence[str]) -> argparse.Namespace:
    """Return the command line of a script that runs the kit on some of its objects."""
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    parser.add_argument("--objects", nargs="+", default=list(objects))
    parser.add_argument("--views", type=int, default=64)
    parser.add_argument("--size", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cmd", default=COMMAND, help="command with {scene} and {out}")
    parser.add_argument("--work", type=Path, help="folder for scenes and twins; default: temporary")
    return parser.parse_args()


def run_kit(args: argparse.Namespace, work: Path,
            extra: Sequence[str] = ()) -> dict[str, object]:
    """Run the kit's suite, with `extra` flags, and return its results.json."""
    environment = os.environ | {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    # The console script of this interpreter, wherever the shell would look.
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"
    environment["PYTHONDONTWRITEBYTECODE"] = "1"  # the kit may be read-only
    command = [
        sys.executable, str(args.kit.resolve() / "suite.py"),
        "--objects", *args.objects, "--out", str(work.resolve()), "--cmd", args.cmd,
        "--views", str(args.views), "--size", str(args.size), "--seed", str(args.seed), *extra,
    ]  # fmt: skip
    # The kit's own table goes to stderr: ours alone is the output.
    subprocess.run(command, check=True, env=environment, stdout=2)
    return dict(json.loads((work / "results.json").read_text()))


def merged(earlier: list[dict[str, Any]], rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows with those of objects that were not run again before them."""
    fresh = {row["object"] for row in rows}
    return [row for row in earlier if row["object"] not in fresh] + rows


def summary(found: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of the table, with machine, versions and commit."""
    commit = git("rev-parse", "--short", "HEAD")
    return {
        "options": found["options"],
        "machine": f"{os.cpu_count()} CPU cores, {platform.machine()}, no GPU",
        "rows": [summary_row(row) | {"commit": commit} for row in found["rows"]],
    }


def summary_row(row: dict[str, Any]) -> dict[str, object]:
    """Return one object's numbers; None where nothing was found."""
    run, score = row["run"], row.get("score") or {}
    matched = score.get("matched_only") or {}
    parts = [part for part in score.get("parts", []) if part["matched"]]
    return {
        "object": row["name"],
        "parts_true": row["parts_true"],
        "parts_found": score.get("parts_found", 0),
        "parts_extra": score.get("parts_unmatched", 0),
        "types_right": score.get("types_right", 0),
        "angle_deg": matched.get("angle_deg"),
        "line_pct": matched.get("line_pct"),
        "motion_deg": matched.get("motion_deg"),
        "motion_units": matched.get("motion_units"),
        "miou": (score.get("segmentation") or {}).get("miou"),
        "watertight": bool(parts)
        and bool(score.get("base_watertight"))
        and all(part["watertight"] for part in parts),
        "compiles": score.get("compiles", False),
        "exit": run["exit"],
        "seconds": run["seconds"],
        "peak_mb": run["peak_mb"],
        "error": row.get("error"),
    }


def markdown(result: dict[str, Any], script: str = "benchmarks/reconstruction_suite.py") -> str:
    """Return a table of results and one line on how a script made it."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    lines += ["| " + " | ".join(cells(row)) + " |" for row in result["rows"]]
    options = result["options"]
    lines += [
        "",
        f"{options['views']} + {options['views']} RGB views of {options['size']} x "
        f"{options['size']} pixels, no depth, number of parts not given, default preset; "
        f"{result['machine']}. "
        f"Made by `{script}` with an external kit that sees the exported "
        "MJCF only. Axis, position, turn (hinges) and slide are mean errors over the parts found.",
    ]
    return "\n".join(lines) + "\n"


def short(result: dict[str, Any]) -> str:
    """Return README's rows of the results: what was found, how well, and how long it took."""
    rows = {row["object"]: row for row in result["rows"]}
    lines = ["| object | parts found | axis error | checks | seconds |", "|---|---|---|---|---|"]
    for name, words in SHOWN.items():
        if name in rows:
            _, found, _, axis, *rest = cells(rows[name])
            degrees = axis if axis == "-" else f"{axis}°"
            lines.append(f"| {words} | {found} | {degrees} | {rest[5]} | {rest[6]} |")
    return "\n".join(lines) + "\n"


def cells(row: dict[str, Any]) -> list[str]:
    """Return the texts of one table row."""
    extra = f" + {row['parts_extra']} extra" if row["parts_extra"] else ""
    checks = {0: "pass", 1: "fail, reported"}.get(row["exit"], f"exit {row['exit']}")
    return [
        row["object"],
        f"{row['parts_found']} of {row['parts_true']}{extra}",
        f"{row['types_right']} of {row['parts_true']}",
        number(row["angle_deg"], 2),
        number(row["line_pct"], 2),
        number(row["motion_deg"], 2),
        number(row["motion_units"], 4),
        number(row["miou"], 3),
        "yes" if row["watertight"] else "no",
        checks,
        number(row["seconds"], 0),
        number(row["peak_mb"], 0),
        row["commit"],
    ]


def number(value: float | None, digits: int) -> str:
    """Return a rounded number, or - where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def insert(text: str, table: str, begin: str = BEGIN, end: str = END) -> str:
    """Return a page with everything between two markers replaced."""
    before, rest = text.split(begin)
    return f"{before}{begin}\n{table}{end}{rest.split(end)[1]}"


def published(rows: dict[str, Any], results: Path, page: tuple[Path, str, str],
              markdown: Callable[[list[Any]], str]) -> int:
    """Put the table of rows into a page and print it; 2 where there are no rows yet.

    Args:
        rows: by object.
        results: file that they are from.
        page: file, and the markers around the table.
        markdown: makes the table of rows in order of their names.
    """
    if not rows:
        sys.stderr.write(f"{results}: not there yet. Expected an earlier run; give --work.\n")
        return 2
    table = markdown([rows[name] for name in sorted(rows)])
    page[0].write_text(insert(page[0].read_text(), table, *page[1:]))
    sys.stdout.write(table)
    return 0


def git(*words: str) -> str:
    """Return the output of a git command, or "unknown" outside a clone."""
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


if __name__ == "__main__":
    sys.exit(main())
