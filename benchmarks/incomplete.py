"""Ask whether twins that lack a part are called incomplete, and twins that lack none are not.

    python benchmarks/incomplete.py --work FOLDER [FOLDER ...] [--objects NAME ...]

Every FOLDER holds scenes, builds and scores that the benchmark kit's suite made. The share of the
moved surface that no part explains is measured on every build as it is, and with every one of its
true parts taken for what carries it. Without --work the table of docs/ladder.md is made anew from
benchmarks/results/incomplete.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ladder_truth import Known, known
from reconstruction_suite import git, published

from part2gs_robotics.joints.left_over import left_over
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.runtime.store import read_stage
from part2gs_robotics.stages import load_motion

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/incomplete.json", ROOT / "docs/ladder.md"
MARKS = "<!-- incomplete:begin -->", "<!-- incomplete:end -->"
# Objects that were looked at while the measure and its bound were chosen.
LOOKED_AT = {"libero_microwave", "pm_100221_box", "pm_31249_table", "sektion_cabinet",
             "pm_10211_laptop", "pm_101619_safe", "pm_25308_table", "pm_32761_table",
             "libero_wooden_cabinet", "robosuite_door"}  # fmt: skip


def main() -> int:
    """Measure what is there, store the numbers, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, nargs="+", default=[], help="folders of the suite")
    parser.add_argument("--objects", nargs="+", help="only these")
    args = parser.parse_args()
    rows = {r["object"]: r for r in json.loads(RESULTS.read_text())} if RESULTS.exists() else {}
    for work in args.work:
        for score in json.loads((work / "results.json").read_text())["rows"]:
            name = score["name"]
            out = next(work.glob(f"runs/*/{name}/stages/04_mesh/manifest.json"), None)
            if out is None or not score.get("score") or (args.objects
                                                         and name not in args.objects):
                continue
            folder = out.parents[2]
            case = known(name, folder, work / "scenes" / folder.parent.name / name)
            rows[name] = measured(case, score["score"])
            sys.stderr.write(f"{rows[name]}\n")
            RESULTS.write_text(json.dumps([rows[n] for n in sorted(rows)], indent=1) + "\n")
    return published(rows, RESULTS, (PAGE, *MARKS), markdown)


def measured(case: Known, score: dict[str, Any]) -> dict[str, Any]:
    """Return the row of one object."""
    motion = built(case.out)
    true = case.labels(case.both.surfaces.surfels)
    owners = true_parts(case, motion, true)
    whole, seconds = timed(case, motion)
    less = [timed(case, without(motion, part))[0] for part in owners]
    return {
        "object": case.name, "commit": git("rev-parse", "--short", "HEAD"),
        "true": score["parts_true"], "found": score["parts_found"],
        "share": round(whole.share, 4), "bound": round(whole.bound, 4),
        "less": [[round(left.share, 4), round(left.bound, 4)] for left in less],
        "seconds": round(seconds, 2)}  # fmt: skip


def timed(case: Known, motion: Motion) -> tuple[LeftOver, float]:
    """Return what a motion leaves over, and the CPU seconds that took beside what a build has."""
    _ = case.both.surfaces, case.both.seen
    began = time.process_time()
    return left_over(case.both, motion), time.process_time() - began


def built(out: Path) -> Motion:
    """Return the motion whose parts were built."""
    folder = out / "stages" / "04_mesh"
    saved = read_stage(folder, json.loads((folder / "manifest.json").read_text())["key"])
    assert saved is not None
    return load_motion(saved)


def true_parts(case: Known, motion: Motion, true: np.ndarray) -> list[int]:
    """Return the numbers of the parts that are mostly surface of some true part's own."""
    from scipy.spatial import cKDTree

    surfels = case.both.surfaces.surfels
    hard = np.concatenate([motion.labels(s)[cKDTree(case.both.gaussians[s].means)
                                            .query(surfels[s].points)[1]] for s in (0, 1)])
    return [k for k in range(1, len(motion.joints) + 1)
            if (hard == k).any() and np.bincount(true[hard == k]).argmax() > 0]


def without(motion: Motion, part: int) -> Motion:
    """Return the motion with a part taken for what carries it."""
    probs = []
    for old in motion.part_probs:
        new = old.copy()
        new[:, motion.parents[part - 1]] += old[:, part]
        new[:, part] = 0
        probs.append(new)
    return replace(motion, part_probs=(probs[0], probs[1]))


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the counts of both halves, and the table."""
    lines = []
    for name, half in (("looked at while the measure was chosen", True),
                       ("looked at afterwards", False)):
        lines += counted(name, [r for r in rows if (r["object"] in LOOKED_AT) == half])
    lines += ["", "| object | found of true | not explained, bound, % | verdict "
              "| with one part less: not explained, % | called incomplete | CPU s |",
              "|---|---|---|---|---|---|---|"]
    for r in rows:
        less = ", ".join(f"{100 * share:.1f}" for share, _ in r["less"]) or "-"
        hits = sum(share > bound for share, bound in r["less"])
        star = "" if r["object"] in LOOKED_AT else " *"
        lines.append(f"| {r['object']}{star} | {r['found']} of {r['true']} | "
                     f"{100 * r['share']:.1f}, {100 * r['bound']:.1f} | "
                     f"{'incomplete' if r['share'] > r['bound'] else 'complete'} | {less} | "
                     f"{hits} of {len(r['less'])} | {r['seconds']:.1f} |")
    return "\n".join([*lines, "", "\\* looked at afterwards"]) + "\n"


def counted(name: str, rows: list[dict[str, Any]]) -> list[str]:
    """Return how often the verdict is right on some rows, as a line of a list."""
    said = [(r["found"] == r["true"], r["share"] <= r["bound"]) for r in rows]
    whole, part = [s for t, s in said if t], [s for t, s in said if not t]
    less = [share > bound for r in rows for share, bound in r["less"]]
    return [f"- {len(rows)} objects {name}: {sum(whole)} of {len(whole)} complete builds are "
            f"called complete, {len(part) - sum(part)} of {len(part)} that lack a part incomplete; "
            f"with one part less {sum(less)} of {len(less)} incomplete."]


if __name__ == "__main__":
    sys.exit(main())
