"""Break a good twin in every way there is, one at a time, and ask the checker what it finds.

    python benchmarks/sabotage.py [--only WORD]
    python benchmarks/sabotage.py --twins FOLDER ... [--share N]

Without --twins the twin is a cabinet of exact boxes with a drawer, a door, a lever on the door and
a screw cap, one part textured, exported to SDFormat, glTF and OpenUSD as well; a FOLDER may hold
any twins. Every kind of sabotage is done to a copy. `caught` names the check that is meant for
what was broken; `other` was caught by another one; `refused` is exit code 2; `passed` is exit code
0, which is what must not be. `physics alone` is the verdict without the group of checks that
compares files, `simcheck` that of simcheck on the files which it can read: anything new that it
finds counts. All this is asked of a twin whose twin.yaml holds no sha256 of its files, as if they
had been signed anew; `sha256` marks what only they catch, or only they name the file of. Numbers
go to benchmarks/results/sabotage.json, the table to docs/sabotage.md; those of --twins to
sabotage_twins.json, one entry per twin, added to those of other calls. --share takes every N-th
kind, others for the next twin. Clean twins are checked first.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import sabotage_around
import sabotage_dynamics
import sabotage_exports
import sabotage_files
import sabotage_looks
import sabotage_models
import sabotage_more
import sabotage_small
import yaml
from reconstruction_suite import git, insert
from sabotage_rival import verdicts
from sabotage_tools import Kind, NotHereError
from toy_scenes import toy_cabinet_twin, write_all

from part2gs_robotics.errors import Part2GSError
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.twin_yaml import digests
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin
from part2gs_robotics.outputs import export_twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.runner import GROUPS

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/sabotage.json", ROOT / "docs/sabotage.md"
MARKS = "<!-- sabotage:begin -->", "<!-- sabotage:end -->"
TWINS = ROOT / "benchmarks/results/sabotage_twins.json"
TWIN_MARKS = "<!-- twins:begin -->", "<!-- twins:end -->"
KINDS = (*sabotage_models.kinds(), *sabotage_dynamics.kinds(), *sabotage_files.kinds(),
         *sabotage_exports.kinds(), *sabotage_more.kinds(),
         *sabotage_around.kinds(), *sabotage_small.kinds(), *sabotage_looks.kinds())
UNREAD = ("twin.urdf", "twin.yaml")
PHYSICS = tuple(g for g in GROUPS if g != "files")
DIGESTS = re.compile(rb"^files:\n(?: .*\n)*", re.MULTILINE)  # of twin.yaml, as it is written


def main() -> int:
    """Break, check, store, and write the table; return 1 where something passed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", type=Path, nargs="+", default=[], help="folders that hold twins")
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    parser.add_argument("--share", type=int, default=1, help="with --twins: every so-many-th kind")
    args = parser.parse_args()
    kinds = [k for k in KINDS if args.only in k.name]
    found = [file.parent for folder in args.twins for file in sorted(folder.rglob("twin.yaml"))]
    with tempfile.TemporaryDirectory() as place:
        if found:
            return many(found, kinds, Path(place), (args.share, not args.only))
        results = [sabotaged(cabinet(Path(place) / "cabinet"), kinds, Path(place))]
    sys.stdout.write(markdown(results))
    if not args.only:
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), markdown(results), *MARKS))
    return int(any(r["verdict"] in ("passed", "crashed") for r in results[0]["rows"]))


def many(twins: list[Path], kinds: list[Kind], place: Path, how: tuple[int, bool]) -> int:
    """Break many twins, by comparison of files first and by everything where that passes.

    Args:
        twins: folders.
        kinds: of sabotage.
        place: for copies.
        how: every so-many-th kind of them, others for every twin; whether to store.
    """
    bad = 0
    for number, folder in enumerate(twins):
        twin, share = exported(folder, place / folder.name), how[0]
        one = sabotaged(twin, kinds[number % share::share], place, alone=False)
        odd = [r for r in one["rows"] if r["verdict"] not in ("caught", "refused")
               or not r["named"]]
        counts = Counter(r["verdict"] for r in one["rows"])
        named = sum(r["named"] for r in one["rows"])
        entry = {k: one[k] for k in ("twin", "commit", "clean", "seconds", "joints")} | {
            "kinds": len(one["rows"]), "counts": dict(counts), "named": named, "odd": odd,
            "sha256": [r["kind"] for r in one["rows"] if r["sha256"] == "catches"]}
        sys.stdout.write(f"{json.dumps(entry)}\n")
        sys.stdout.flush()
        bad += counts["passed"] + counts["crashed"]
        if how[1]:
            before = json.loads(TWINS.read_text()) if TWINS.is_file() else []
            after = sorted([*(e for e in before if e["twin"] != entry["twin"]), entry],
                           key=lambda e: str(e["twin"]))
            TWINS.write_text(json.dumps(after, indent=1) + "\n")
            PAGE.write_text(insert(PAGE.read_text(), table_of_twins(after), *TWIN_MARKS))
        shutil.rmtree(twin)
    return int(bad > 0)


def exported(twin: Path, copy: Path) -> Path:
    """Return a copy of a twin, exported to SDFormat, glTF and OpenUSD as well."""
    shutil.copytree(twin, copy, ignore=shutil.ignore_patterns("stages", "*.ply", "report.*"))
    path = copy / "twin.yaml"
    tree = yaml.safe_load(path.read_text())
    if "files" not in tree:  # as every twin has that this version writes
        tree["files"] = digests(read_twin(copy), copy)
        path.write_text(yaml.safe_dump(tree, sort_keys=False, allow_unicode=True, width=100))
    for kind in ("sdf", "glb", "usd"):
        export_twin(copy, kind, copy / kind)
    return copy


def cabinet(folder: Path) -> Path:
    """Write the toy cabinet, its drawer textured, and all exports; return its folder."""
    twin = toy_cabinet_twin(4)
    parts = tuple(_textured(p) if p.name == "part_1" else p for p in twin.parts)
    twin = Twin(twin.name, parts, twin.meters_per_unit, twin.up)
    return write_all(twin, folder)


def _textured(part: Part) -> Part:
    # a picture, at corners of faces the colours of its mesh, as a bake makes it
    image = np.tile(part.mesh.colors.mean(0).astype(np.uint8), (16, 16, 1))
    image[1:-1, 1:-1] //= np.arange(1, 15, dtype=np.uint8)[:, None, None]  # no two sides alike
    image[1:-1, 3:6] //= 2
    uv = np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(part.mesh.faces), 1, 1))
    mesh = PartMesh(part.mesh.vertices, part.mesh.faces, part.mesh.colors, 0.0, Texture(uv, image))
    return Part(part.name, part.parent, mesh, part.pieces, part.joint, part.limits)


def sabotaged(twin: Path, kinds: list[Kind], place: Path, alone: bool = True) -> dict[str, Any]:
    """Return what a clean twin's check says, and a row for every kind that it can suffer.

    Args:
        twin: folder.
        kinds: of sabotage.
        place: for copies.
        alone: also ask physics alone, and simcheck.
    """
    clean = check(twin)
    own = {(r.name, r.subject) for r in clean.results if r.status in ("fail", "incomplete")}
    began = time.perf_counter()
    check(twin, only=("files",))
    seconds = time.perf_counter() - began
    rows, broken = [], dict[str, Path]()
    for number, kind in enumerate(kinds):
        copy = place / (f"broken_{number}" if alone else "broken")
        shutil.rmtree(copy, ignore_errors=True)
        # exports beside are read as well: only where they are what is broken
        exports = any("/" in file for file in kind.files)
        left = [] if exports else ["sdf", "glb", "usd"]
        shutil.copytree(twin, copy, ignore=shutil.ignore_patterns(*left))
        try:
            kind.deed(copy)
        except NotHereError:
            continue
        broken[kind.name] = copy
        rows.append({"kind": kind.name, **judged(copy, kind, own, alone)})
    rival = verdicts(twin, broken) if alone else {}
    rows = [r | ({"simcheck": rival[r["kind"]]} if rival else {}) for r in rows]
    return {"twin": twin.name, "commit": git("rev-parse", "--short", "HEAD"),
            "clean": sorted(f"{n}: {s}" for n, s in own), "seconds": round(clean.seconds, 2),
            "files_seconds": round(seconds, 2), "joints": len(clean.joints), "rows": rows}


def judged(folder: Path, kind: Kind, own: set[tuple[str, str]], alone: bool) -> dict[str, Any]:
    """Return what the checker makes of a broken twin: with all checks, and by physics alone."""
    path = folder / "twin.yaml"
    signed = path.read_bytes() if path.is_file() else b""
    if signed:
        path.write_bytes(DIGESTS.sub(b"", signed))
    row = blamed(folder, kind, own, ("files",))
    if row["verdict"] == "passed":
        row = blamed(folder, kind, own, GROUPS)
    # what physics never reads can only fail to compile
    unread = kind.files and all(f in UNREAD or f.startswith(("sdf/", "glb/", "usd/"))
                                for f in kind.files)
    physics = asked(folder, ("compile",) if unread else PHYSICS, own)[0] if alone else ""
    if signed:
        path.write_bytes(signed)
    row |= {"sha256": "", "physics": "caught" if physics == "failed" else physics}
    if signed and not row["named"]:
        more = blamed(folder, kind, own, ("files",))
        if row["verdict"] == "passed" and more["verdict"] != "passed":
            row |= more | {"sha256": "catches"}
        elif more["named"]:
            row |= more | {"sha256": "names"}
    return row


def blamed(folder: Path, kind: Kind, own: set[tuple[str, str]], groups: tuple[str, ...]
           ) -> dict[str, Any]:
    """Return the verdict of checks, the one that found it, and whether the file is named."""
    verdict, report, said = asked(folder, groups, own)
    failed = [] if report is None else [
        r for r in report.results if r.status in ("fail", "incomplete")
        and (r.name, r.subject) not in own]
    meant = [r for r in failed if r.name in kind.meant]
    told = any(file in f"{r.subject} {r.detail} {r.cause}" for r in meant for file in kind.files)
    if failed:
        verdict = "caught" if meant else "other"
    told = told or any(file in said for file in kind.files)
    return {"verdict": verdict, "check": (meant or failed)[0].name if failed else "",
            "named": bool(told), "cause": (meant or failed)[0].cause if failed else said}


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
        count, before, rival = (Counter(r[k] for r in rows)
                                for k in ("verdict", "physics", "simcheck"))
        named, digested = sum(r["named"] for r in rows), Counter(r["sha256"] for r in rows)
        lines += [
            f"{one['twin']}, {one['commit']}: {len(rows)} kinds; {count['caught']} caught by the "
            f"check meant for it, {count['other']} by another, {count['refused']} refused, "
            f"{count['crashed']} crashed, {count['passed']} passed; {named} name the file at "
            f"fault. {digested['catches']} are caught by the sha256 of files alone.",
            "", f"By physics alone {before['caught']} caught, {before['refused']} refused, "
            f"{before['crashed']} crashed, {before['passed']} passed. simcheck catches "
            f"{rival['caught']}, passes {rival['passed']}, and does not read what "
            f"{rival['not read']} change. The clean twin has "
            f"{len(one['clean'])} failing rows; its whole check takes {one['seconds']:.1f} s, "
            f"the comparison of files {one['files_seconds']:.1f} s.", "",
            "| what is broken | verdict | by check | file named | sha256 | physics alone | "
            "simcheck |",
            "|---|---|---|---|---|---|---|"]
        lines += [f"| {r['kind']} | {r['verdict']} | {r['check']} | "
                  f"{'yes' if r['named'] else ''} | {r['sha256']} | "
                  f"{r['physics']} | {r['simcheck']} |" for r in rows]
        lines.append("")
    return "\n".join(lines)


def table_of_twins(entries: list[dict[str, Any]]) -> str:
    """Return a line, a row per twin, and every kind that was not caught as meant."""
    digested = Counter(kind for e in entries for kind in e.get("sha256", ()))
    total = sum((Counter(e["counts"]) for e in entries), Counter())
    done, named = total.total(), sum(e["named"] for e in entries)
    good = total["caught"] + total["refused"]
    lines = [f"{done} broken copies of {len(entries)} twins: {good} ({good / max(done, 1):.1%}) "
             f"caught by the check meant for it or refused, {total['other']} caught by another, "
             f"{total['crashed']} crashed, {total['passed']} passed; {named} name the file at "
             f"fault; {digested.total()} are caught by the sha256 of files alone. "
             f"Rows that fail on clean twins: {sum(len(e['clean']) for e in entries)}.", "",
             "| twin | commit | joints | fails when clean | kinds | caught | refused | other | "
             "crashed | passed |", "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|"]
    for e in entries:
        cells = [str(e["counts"].get(k, 0)) for k in ("caught", "refused", "other", "crashed",
                                                      "passed")]
        lines.append(f"| {e['twin']} | {e['commit']} | {e['joints']} | {len(e['clean'])} | "
                     f"{e['kinds']} | {' | '.join(cells)} |")
    odd = [f"- {e['twin']}: {r['kind']}: {r['verdict']}{' by ' + r['check'] if r['check'] else ''}"
           + ("" if r["named"] else ", file not named") for e in entries for r in e["odd"]]
    if digested:
        told = ", ".join(f"{kind} ({count})" for kind, count in sorted(digested.items()))
        lines += ["", f"By sha256 alone, and of how many twins: {told}."]
    return "\n".join([*lines, "", *odd]).rstrip() + "\n"


if __name__ == "__main__":
    sys.exit(main())
