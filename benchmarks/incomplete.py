"""Ask whether twins that lack a part are called incomplete, and twins that lack none are not.

    python benchmarks/incomplete.py --work FOLDER [FOLDER ...] [--objects NAME ...]

Every FOLDER holds scenes and builds that the benchmark kit's suite made. The share of the moved
surface that no part explains is measured on every build as it is, with every one of its true parts
taken for what carries it, and with every one left out and all surface labelled anew without it.
Without --work the table of docs/ladder.md is made anew from benchmarks/results/incomplete.json.
"""

from __future__ import annotations

import json
import sys
import textwrap
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ladder_truth import Known, known, remade
from reconstruction_suite import git, published
from scipy.spatial import cKDTree

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.study import gather
from part2gs_robotics.joints.labels import final_labels, part_probs
from part2gs_robotics.joints.left_over import left_over
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.runtime.store import read_stage
from part2gs_robotics.stages import load_motion

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/incomplete.json", ROOT / "docs/ladder.md"
MARKS = "<!-- incomplete:begin -->", "<!-- incomplete:end -->"
SHARED = 0.3  # IoU of the surfels: a part that shares less with a true one is not that part
# Objects that were looked at while the measure and its bound were chosen, or mended.
LOOKED_AT = {"libero_microwave", "pm_100221_box", "pm_31249_table", "sektion_cabinet",
             "pm_10211_laptop", "pm_101619_safe", "pm_25308_table", "pm_32761_table",
             "pm_102703_toilet", "bigym_dishwasher", "robosuite_door", "pm_48492_box"}  # fmt: skip


def main() -> int:
    """Measure what is there, store the numbers, and write the table."""
    rows = remade(__doc__.splitlines()[0], RESULTS, "03_articulate",
                  lambda *place: measured(known(*place)))
    return published(rows, RESULTS, (PAGE, *MARKS), markdown)


def measured(case: Known) -> dict[str, Any]:
    """Return the row of one object."""
    motion = built(case.out)
    owners = true_parts(case, motion)
    whole, seconds = timed(case, motion)
    less = [timed(case, without(motion, part))[0] for part in owners]
    anew = [timed(case, fewer)[0] for fewer in labelled_anew(case, motion, list(owners))]
    return {
        "object": case.name, "commit": git("rev-parse", "--short", "HEAD"),
        "true": len(case.candidate), "found": len(set(owners.values())),
        "built": len(motion.joints),
        "share": round(whole.share, 4), "bound": round(whole.bound, 4),
        "less": [[round(left.share, 4), round(left.bound, 4)] for left in less],
        "anew": [[round(left.share, 4), round(left.bound, 4)] for left in anew],
        "seconds": round(seconds, 2)}  # fmt: skip


def timed(case: Known, motion: Motion) -> tuple[LeftOver, float]:
    """Return what a motion leaves over, and the CPU seconds that took beside what a build has."""
    _ = case.both.surfaces, case.both.seen
    began = time.process_time()
    return left_over(case.both, motion), time.process_time() - began


def built(out: Path) -> Motion:
    """Return the motion whose parts were built; of a build cut off before, what was decided."""
    folders = [out / "stages" / name for name in ("04_mesh", "03_articulate")]
    folder = next(f for f in folders if (f / "manifest.json").exists())
    saved = read_stage(folder, json.loads((folder / "manifest.json").read_text())["key"])
    assert saved is not None
    return load_motion(saved)


def true_parts(case: Known, motion: Motion) -> dict[int, int]:
    """Return which true part every part is that shares enough surface with one."""
    surfels = case.both.surfaces.surfels
    true = case.labels(surfels)
    hard = np.concatenate([motion.labels(s)[cKDTree(case.both.gaussians[s].means)
                                            .query(surfels[s].points)[1]] for s in (0, 1)])
    out = {}
    for k in range(1, len(motion.joints) + 1):
        shares = [((hard == k) & (true == t)).sum() / max(((hard == k) | (true == t)).sum(), 1)
                  for t in range(1, len(case.candidate) + 1)]
        if max(shares) > SHARED:
            out[k] = int(np.argmax(shares)) + 1
    return out


def without(motion: Motion, part: int) -> Motion:
    """Return the motion with a part taken for what carries it."""
    probs = []
    for old in motion.part_probs:
        new = old.copy()
        new[:, motion.parents[part - 1]] += old[:, part]
        new[:, part] = 0
        probs.append(new)
    return replace(motion, part_probs=(probs[0], probs[1]))


def labelled_anew(case: Known, motion: Motion, parts: Sequence[int]) -> Iterator[Motion]:
    """Yield motions without one of some parts, as a decision without it labels both states."""
    config = ArticulateConfig()
    judge = Judge(gather(case.both).under(np.array(motion.shades)))
    start = replace(on_base(motion.joints), parents=motion.parents)
    start = start.with_motions(motion.joints)
    for part in parts:
        if len(motion.joints) > 1 and part not in motion.parents:
            end = start.without(part - 1)
            hard = final_labels(judge, end, config)
            end = replace(end, labels=hard)
            probs = part_probs(judge.study, end, config)
            alone = tuple(replace(j, carrier=None) for j in end.motions)
            yield Motion(probs, alone, end.parents, shades=motion.shades)


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the counts of both halves, and the table."""
    lines = []
    for name, half in (("looked at while the measure was chosen", True),
                       ("looked at afterwards (\\*)", False)):
        lines += counted(name, [r for r in rows if (r["object"] in LOOKED_AT) == half])
    lines += ["", "| object | built, true ones of all | not explained, bound, % | verdict "
              "| with one part less: not explained, % | labelled anew without it | CPU s |",
              "|---|---|---|---|---|---|---|"]
    for r in rows:
        star = "" if r["object"] in LOOKED_AT else " \\*"
        lines.append(f"| {r['object']}{star} | {r['built']}, {r['found']} of {r['true']} | "
                     f"{100 * r['share']:.1f}, {100 * r['bound']:.1f} | "
                     f"{'incomplete' if r['share'] > r['bound'] else 'complete'} | "
                     f"{shares(r['less'])} | {shares(r['anew'])} | {r['seconds']:.1f} |")
    return "\n".join(lines) + "\n"


def shares(cases: list[list[float]]) -> str:
    """Return shares in %, those that are called complete in bold."""
    return ", ".join(f"{100 * share:.1f}" if share > bound else f"**{100 * share:.1f}**"
                     for share, bound in cases) or "-"


def counted(name: str, rows: list[dict[str, Any]]) -> list[str]:
    """Return how often the verdict is right on some rows, as an item of a list."""
    said = [(r["found"] == r["true"], r["share"] <= r["bound"]) for r in rows]
    whole, part = [s for t, s in said if t], [s for t, s in said if not t]
    less, anew = ([share > bound for r in rows for share, bound in r[key]]
                  for key in ("less", "anew"))
    told = (f"- {len(rows)} objects {name}: {sum(whole)} of {len(whole)} builds that have all "
            f"parts are called complete, {len(part) - sum(part)} of {len(part)} that lack one "
            f"incomplete; with one part less {sum(less)} of {len(less)}, labelled anew without it "
            f"{sum(anew)} of {len(anew)} incomplete.")
    return textwrap.wrap(told, 120, subsequent_indent="  ")


if __name__ == "__main__":
    sys.exit(main())
