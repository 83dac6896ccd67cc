"""What the plan can leave out: time saved and accuracy kept, for every object.

    python benchmarks/plan_table.py --kit PATH [--work DIR] [--objects NAME ...] [--quick]

One build with the preset as it is, then one per thing with that thing switched. Stages that a
switch does not touch are taken over from the build before, so that a difference in seconds is the
thing's own and not the machine's noise. The table goes to docs/ablation.md; without --kit it is
made from results/plan.json.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reconstruction import parser, summary
from reconstruction_runs import OBJECTS, folders, kept, run_once
from reconstruction_suite import RESULTS, ROOT, insert
from reconstruction_table import complete, count, number, values

OUT = RESULTS.parent / "plan.json"
PAGE = ROOT / "docs/ablation.md"
QUICK = "plan_quick.json"
BEGIN, END = "<!-- plan:begin -->", "<!-- plan:end -->"
BASE = "as it is"
CHECKS = "export and check"
ERRORS = (("angle_deg", 2), ("line_pct", 2), ("motion_deg", 2), ("motion_units", 4), ("cd_m", 2),
          ("miou", 3))
HEAD = (
    "left out", "usually", "seconds saved, median (least to most)", "objects complete", "axis, deg",
    "position, %", "turn, deg", "slide, units", "CD-m", "mIoU",
)  # fmt: skip


@dataclass(frozen=True)
class Thing:
    """Something the plan can leave out.

    Attributes:
        name: as in the plan.
        flags: that change it.
        used: whether the preset has it on, so that the flags leave it out; else they put it in.
    """

    name: str
    flags: tuple[str, ...]
    used: bool = True


# Late rooms first: the stages before them are taken over from the build as it is.
THINGS = (
    Thing("convex decomposition", ("--no-convex",)),
    Thing("part identities", ("--no-identity",)),
    Thing("contact loss", ("--no-contact",)),
    Thing("vector-field loss", ("--no-vector-field",)),
    Thing("repel points", ("--repel",), used=False),
    Thing("articulation loss", ("--articulation",), used=False),
    Thing("velocity loss", ("--velocity",), used=False),
    Thing("alignment to images", ("--no-alignment",)),
    Thing("search for number of parts", ("--parts", "{parts}")),
    Thing("view-dependent colour", ("--no-view-color",)),
    Thing("depth smoothness", ("--smooth-weight", "0")),
    Thing("hollows by stereo", ("--no-stereo",)),
)


def main(words: Sequence[str] | None = None) -> int:
    """Run what is not there yet, store the numbers, write the table."""
    command = parser()
    command.description = (__doc__ or "").splitlines()[0]
    command.add_argument("--preset", default="standard")
    command.add_argument("--things", nargs="+", default=[thing.name for thing in THINGS],
                         help="what is left out; a preset may leave some of it out already")
    args = command.parse_args(words)
    if args.quick:
        args.preset = "draft"
        args.objects = args.objects[:1] if args.objects != list(OBJECTS) else ["libero_microwave"]
    out = args.work / QUICK if args.quick else OUT
    if args.kit:
        rows = [row for name in args.objects for row in measured(args, name)]
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(json.dumps(summary(rows) | {"preset": args.preset}, indent=1) + "\n")
    if not out.exists():
        sys.stderr.write(f"{out}: not there yet. Expected an earlier run; give --kit PATH.\n")
        return 2
    table = markdown(json.loads(out.read_text()))
    if not args.quick:
        PAGE.write_text(insert(PAGE.read_text(), table, BEGIN, END))
    sys.stdout.write(table)
    return 0


def measured(args: argparse.Namespace, name: str) -> list[dict[str, Any]]:
    """Return the rows of one object: as it is, then with every thing switched."""
    wanted = tuple(thing for thing in THINGS if thing.name in args.things)
    things = THINGS[:1] + THINGS[-1:] if args.quick else wanted
    base = _row(args, name, Thing(BASE, ()), None)
    return [base, *(_row(args, name, thing, base) for thing in things)]


def _row(args: argparse.Namespace, name: str, thing: Thing,
         base: dict[str, Any] | None) -> dict[str, Any]:
    parts = str(base["parts_true"]) if base else ""
    flags = ["--preset", args.preset, *(word.format(parts=parts) for word in thing.flags)]
    key = {"flags": flags, "views": args.views, "size": args.size, "seed": args.seed}

    def make() -> dict[str, Any]:
        sys.stderr.write(f"{name}: {thing.name}\n")
        if base is not None:
            _restore(args.work, name)
        row = run_once(args, args.work, name, flags, fresh=base is None)
        if base is None:
            _keep(args.work, name)
        return row

    label = f"{name}_{args.preset}_{thing.name.replace(' ', '-')}"
    row = kept(args.work / "plan" / f"{label}.json", key, make)
    return {"thing": thing.name, "used": thing.used} | row


def _keep(work: Path, name: str) -> None:
    """Copy the build as it is, stages included: every switch starts from it."""
    for out in folders(work, name):
        shutil.copytree(out, work / "base" / name, dirs_exist_ok=True)


def _restore(work: Path, name: str) -> None:
    for out in folders(work, name):
        if (work / "base" / name).exists():
            shutil.rmtree(out)
            shutil.copytree(work / "base" / name, out)


def saved(base: dict[str, Any], other: dict[str, Any], *, used: bool = True) -> float:
    """Return the seconds that leaving a thing out saves: only stages that ran again differ."""
    change = sum(float(base["stages"].get(stage, {"seconds": 0.0})["seconds"] - entry["seconds"])
                 for stage, entry in other["stages"].items()
                 if not entry["resumed"] and stage not in ("read", CHECKS))
    return change if used else -change


def markdown(result: dict[str, Any]) -> str:
    """Return the table and one line on how it was made."""
    by_thing: dict[str, list[dict[str, Any]]] = {}
    for row in result["rows"]:
        by_thing.setdefault(row["thing"], []).append(row)
    bases = {row["object"]: row for row in by_thing.pop(BASE)}
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    lines += [_line(["nothing", "", "-"], list(bases.values()))]
    for name, rows in by_thing.items():
        used = bool(rows[0]["used"])
        gains = [saved(bases[row["object"]], row, used=used) for row in rows]
        # A thing that is usually off: the builds with it are the others.
        shown = rows if used else [bases[row["object"]] for row in rows]
        lines += [_line([name, "on" if used else "off", _range(gains)], shown)]
        if not used:
            lines += [_line([f"with {name}", "", "-"], rows)]
    times = [row["stages"].get(CHECKS, {"seconds": 0.0})["seconds"] for row in bases.values()]
    lines += [_line(["simulator checks", "on", _range(times)], list(bases.values()))]
    return "\n".join([*lines, "", _caption(result, len(bases))]) + "\n"


def _caption(result: dict[str, Any], objects: int) -> str:
    words = count(objects, "object")
    return (f"Preset {result['preset']}, {words}, medians of the parts found; "
            f"{result['machine']}; commit {result['commit']}, {result['date']}; "
            "`benchmarks/plan_table.py`. Checks come after the twin and change nothing in it; "
            "their time includes the export.")


def _range(numbers: list[float]) -> str:
    return (f"{statistics.median(numbers):.1f} ({min(numbers):.1f} to {max(numbers):.1f})"
            if numbers else "-")


def _line(first: list[str], rows: list[dict[str, Any]]) -> str:
    middles = [number(statistics.median(found) if (found := values(rows, key)) else None, digits)
               for key, digits in ERRORS]
    right = f"{sum(map(complete, rows))} of {len(rows)}"
    return "| " + " | ".join([*first, right, *middles]) + " |"


if __name__ == "__main__":
    sys.exit(main())
