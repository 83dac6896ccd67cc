"""Check articulated assets of anyone's and write what is found, why, and how long it takes.

    python benchmarks/assets.py PATH [PATH ...] [--root FOLDER] [--add] [--look]

A PATH is a twin folder, an MJCF, URDF or USD file, or a folder: then every model.xml below it. Each
is checked by `part2gs-robot check`, all by all checks. Rows that fail or warn are told with their
cause. --add keeps the rows of other assets: packages differ in their --root. Numbers go to
benchmarks/results/assets.json, the table to docs/assets.md; with --look neither is written. Assets
of others are not part of this repository: the page names the packages they come from.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from reconstruction_suite import git, insert

from part2gs_robotics.ci.alone import Request, check_alone
from part2gs_robotics.sim_checks.result import CheckReport

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/assets.json", ROOT / "docs/assets.md"
MARKS = "<!-- assets:begin -->", "<!-- assets:end -->"
MODELS = (".xml", ".urdf", ".usd", ".usda", ".usdc")
CODES = {0: "passes", 1: "fails", 2: "refused"}


def main() -> int:
    """Check, store, and write the table; return 1 where one does not pass."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", type=Path, nargs="+", help="assets, or folders of them")
    parser.add_argument("--root", type=Path, help="folder that nothing may leave")
    parser.add_argument("--add", action="store_true", help="keep the rows of other assets")
    parser.add_argument("--look", action="store_true", help="write nothing")
    args = parser.parse_args()
    rows = [told(path, check_alone(Request(str(path), str(args.root or ""))))
            for path in found(args.paths)]
    if args.add:
        names = {r["asset"] for r in rows}
        old = json.loads(RESULTS.read_text())["rows"]
        rows = [r for r in old if r["asset"] not in names] + rows
    results = {"commit": git("rev-parse", "--short", "HEAD"), "rows": rows}
    sys.stdout.write(markdown(results))
    if not args.look:
        RESULTS.write_text(json.dumps(results, indent=1) + "\n")
        PAGE.write_text(insert(PAGE.read_text(), markdown(results), *MARKS))
    return int(any(r["verdict"] != "passes" for r in rows))


def found(paths: list[Path]) -> list[Path]:
    """Return the assets that some paths mean."""
    out = []
    for path in paths:
        whole = path.suffix in MODELS or (path / "twin.xml").is_file()
        out += [path] if whole else sorted(path.rglob("model.xml"))
    return out


def told(path: Path, report: CheckReport) -> dict[str, Any]:
    """Return the row of one asset: verdict, joints, what fails and warns, causes, seconds."""
    checks = [row.to_dict() for row in report.results]
    name = path.parent.name if path.stem == "model" else path.name
    bad = [c for c in checks if c["status"] in ("fail", "incomplete")]
    return {
        "asset": name, "format": path.suffix.lstrip(".") or "twin",
        "verdict": CODES[report.exit_code], "joints": len(report.joints),
        "fails": dict(Counter(c["check"] for c in bad)),
        "warns": dict(Counter(c["check"] for c in checks if c["status"] == "warn")),
        "cause": bad[0]["cause"] or bad[0]["note"] if bad else "",
        "waits": [n.partition(" waits")[0] for n in report.notes if " waits for other joints" in n],
        "blocks": sum(c["check"] == "blocking" for c in checks),
        "seconds": round(report.seconds, 3)}


def markdown(results: dict[str, Any]) -> str:
    """Return a line of counts and a row per asset."""
    rows = results["rows"]
    count = Counter(r["verdict"] for r in rows)
    lines = [f"{len(rows)} assets ({results['commit']}): {count['passes']} pass, {count['fails']} "
             f"fail, {count['refused']} refused; {sum(r['joints'] for r in rows)} joints, "
             f"{sum(r['seconds'] for r in rows):.0f} s in all.", "",
             "| asset | format | verdict | joints | fails | warns | waits for others | s |",
             "|---|---|---|--:|---|---|---|--:|"]
    for r in rows:
        waits = ", ".join(r["waits"]) + (f"; {r['blocks']} pairs block" if r["blocks"] else "")
        lines.append(f"| {r['asset']} | {r['format']} | {r['verdict']} | {r['joints']} | "
                     f"{_counted(r['fails'])} | {_counted(r['warns'])} | {waits} | "
                     f"{r['seconds']:.1f} |")
        lines += [f"| | | cause | | {r['cause']} | | | |"] if r["cause"] else []
    return "\n".join(lines) + "\n"


def _counted(rows: dict[str, int]) -> str:
    return ", ".join(f"{name} {n}" if n > 1 else name for name, n in rows.items())


if __name__ == "__main__":
    sys.exit(main())
