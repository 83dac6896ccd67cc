"""Break a good twin in every way there is, one at a time, and ask the checker what it finds.

    python benchmarks/sabotage.py [--twins FOLDER ...] [--only WORD]

Without --twins the twin is a cabinet of exact boxes with a drawer, a door, a lever on the door and
a screw cap, one part textured, exported to SDFormat, glTF and OpenUSD as well; a FOLDER may hold
any twins. Every kind of sabotage is done to a copy. `caught` names the check that is meant for
what was broken; `other` was caught by another one; `refused` is exit code 2; `passed` is exit code
0, which is what must not be. `physics alone` is the verdict without the group of checks that
compares files. Numbers go to benchmarks/results/sabotage.json, the table to docs/sabotage.md.
Without --only, and without --twins, both are written; clean twins are checked first.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import sabotage_dynamics
import sabotage_exports
import sabotage_files
import sabotage_models
from reconstruction_suite import git, insert
from sabotage_tools import Kind, NotHereError
from toy_scenes import toy_cabinet_twin, write_all

from part2gs_robotics.errors import Part2GSError
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.runner import GROUPS

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/sabotage.json", ROOT / "docs/sabotage.md"
MARKS = "<!-- sabotage:begin -->", "<!-- sabotage:end -->"
KINDS = (*sabotage_models.kinds(), *sabotage_dynamics.kinds(), *sabotage_files.kinds(),
         *sabotage_exports.kinds())
PHYSICS = tuple(g for g in GROUPS if g != "files")


def main() -> int:
    """Break, check, store, and write the table; return 1 where something passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", type=Path, nargs="+", default=[], help="folders that hold twins")
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    args = parser.parse_args()
    kinds = [k for k in KINDS if args.only in k.name]
    with tempfile.TemporaryDirectory() as place:
        found = [file.parent for folder in args.twins for file in sorted(folder.rglob("twin.yaml"))]
        twins = found or [cabinet(Path(place) / "cabinet")]
        results = [sabotaged(twin, kinds, Path(place)) for twin in twins]
    table = markdown(results)
    sys.stdout.write(table)
    if not args.only and not args.twins:
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), table, *MARKS))
    return int(any(r["verdict"] in ("passed", "crashed") for one in results for r in one["rows"]))


def cabinet(folder: Path) -> Path:
    """Write the toy cabinet, its drawer textured, and all exports; return its folder."""
    twin = toy_cabinet_twin(4)
    parts = tuple(_textured(p) if p.name == "part_1" else p for p in twin.parts)
    twin = Twin(twin.name, parts, twin.meters_per_unit, twin.up)
    return write_all(twin, folder)


def _textured(part: Part) -> Part:
    image = np.random.default_rng(0).integers(0, 256, (8, 8, 3), dtype=np.uint8)
    uv = np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(part.mesh.faces), 1, 1))
    mesh = PartMesh(part.mesh.vertices, part.mesh.faces, part.mesh.colors, 0.0, Texture(uv, image))
    return Part(part.name, part.parent, mesh, part.pieces, part.joint, part.limits)


def sabotaged(twin: Path, kinds: list[Kind], place: Path) -> dict[str, Any]:
    """Return what a clean twin's check says, and a row for every kind that it can suffer."""
    clean = check(twin)
    own = {(r.name, r.subject) for r in clean.results if r.status in ("fail", "incomplete")}
    began = time.perf_counter()
    check(twin, only=("files",))
    seconds = time.perf_counter() - began
    rows = []
    for kind in kinds:
        copy = place / "broken"
        shutil.rmtree(copy, ignore_errors=True)
        shutil.copytree(twin, copy, ignore=shutil.ignore_patterns("stages", "*.ply", "report.*"))
        try:
            kind.deed(copy)
        except NotHereError:
            continue
        rows.append({"kind": kind.name, **judged(copy, kind, own)})
    return {"twin": twin.name, "commit": git("rev-parse", "--short", "HEAD"),
            "clean": sorted(f"{n}: {s}" for n, s in own), "seconds": round(clean.seconds, 2),
            "files_seconds": round(seconds, 2), "rows": rows}


def judged(folder: Path, kind: Kind, own: set[tuple[str, str]]) -> dict[str, Any]:
    """Return what the checker makes of a broken twin: with all checks, and by physics alone."""
    verdict, report, said = asked(folder, ("files",), own)
    if verdict == "passed":
        verdict, report, said = asked(folder, GROUPS, own)
    alone, _, _ = asked(folder, PHYSICS, own)
    failed = [] if report is None else [
        r for r in report.results if r.status in ("fail", "incomplete")
        and (r.name, r.subject) not in own]
    meant = [r for r in failed if r.name in kind.meant]
    told = any(file in f"{r.subject} {r.detail} {r.cause}" for r in meant for file in kind.files)
    if failed:
        verdict = "caught" if meant else "other"
    told = told or any(file in said for file in kind.files)
    return {"verdict": verdict, "check": (meant or failed)[0].name if failed else "",
            "named": bool(told), "physics": "caught" if alone == "failed" else alone,
            "cause": (meant or failed)[0].cause if failed else said}


def asked(folder: Path, groups: tuple[str, ...], own: set[tuple[str, str]]
          ) -> tuple[str, CheckReport | None, str]:
    """Return failed, passed, refused or crashed, the report if there is one, and what was said."""
    try:
        report = check(folder, only=groups)
    except Part2GSError as error:
        return "refused", None, str(error).replace(str(folder.parent), "")
    except Exception as error:  # what the command line would call its own bug
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
        return "crashed", None, ""
    new = {(r.name, r.subject) for r in report.results if r.status in ("fail", "incomplete")} - own
    return ("failed" if new else "passed"), report, ""


def markdown(results: list[dict[str, Any]]) -> str:
    """Return a line per twin and the table of its kinds."""
    lines = []
    for one in results:
        rows = one["rows"]
        count, before = Counter(r["verdict"] for r in rows), Counter(r["physics"] for r in rows)
        named = sum(r["named"] for r in rows)
        lines += [
            f"{one['twin']}, {one['commit']}: {len(rows)} kinds; {count['caught']} caught by the "
            f"check meant for it, {count['other']} by another, {count['refused']} refused, "
            f"{count['crashed']} crashed, {count['passed']} passed; {named} name the file at "
            "fault.",
            "", f"By physics alone {before['caught']} caught, {before['refused']} refused, "
            f"{before['crashed']} crashed, {before['passed']} passed. The clean twin has "
            f"{len(one['clean'])} failing rows; its whole check takes {one['seconds']:.1f} s, "
            f"the comparison of files {one['files_seconds']:.1f} s.", "",
            "| what is broken | verdict | by check | file named | physics alone |",
            "|---|---|---|---|---|"]
        lines += [f"| {r['kind']} | {r['verdict']} | {r['check']} | "
                  f"{'yes' if r['named'] else ''} | {r['physics']} |" for r in rows]
        lines.append("")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
