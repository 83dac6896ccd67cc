"""Ask of every object at which step its parts are lost, and put the table into docs.

    python benchmarks/ladder.py --work FOLDER [FOLDER ...] [--objects NAME ...] [--settle]

Every FOLDER holds scenes and builds that the benchmark kit's suite made, of its objects or those of
other_states.py, solids.py or simulators.py; their fits are used, the motions are searched and
decided on anew. Five steps, from the same two fits: labels (of the surfels, under the true
motions), cost (of the true motions beside other answers), search (how near the pool comes to each
true motion), what is decided, and, with --settle, what is left of it, with carried parts, once
joints are settled.
Without --work the tables of docs/ladder.md are made anew from results/ladder.json.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from ladder_truth import Known, iou, known, remade
from other_states import STATES
from reconstruction_suite import git, published
from scipy.spatial import cKDTree
from simulators import OBJECTS
from solids_more import THINGS

from part2gs_robotics.articulate import Found, found_motions, settled_motion
from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import PART, Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/ladder.json", ROOT / "docs/ladder.md"
MARKS = "<!-- ladder:begin -->", "<!-- ladder:end -->"
NEAR, SHARED = 0.03, 0.3  # of the diagonal, and IoU: a motion further off is not the true part's


def main() -> int:
    """Climb the ladder of what is there, store the numbers, and write the table."""
    rows = remade(__doc__.splitlines()[0], RESULTS, "02_fit_1",
                  lambda *place, settle: climbed(known(*place), settle),
                  settle="settle the joints as well")
    return published(rows, RESULTS, (PAGE, *MARKS), markdown)


def climbed(case: Known, settle: bool) -> dict[str, Any]:
    """Return the row of one object; settle: whether its joints are, too."""
    began = time.monotonic()
    found = found_motions(case.both, ArticulateConfig())
    seconds = time.monotonic() - began
    judge, decided = found.judge, found.candidate
    true = case.labels(judge.study.surfels)
    truth = best(judge, judge.judge(case.candidate))
    free = [k for k in range(len(truth)) if k + 1 not in truth.parents]
    less = [best(judge, judge.judge(truth.without(k))) for k in free if len(truth) > 1]
    more = best(judge, judge.best_of([truth.plus(h) for h in found.pool]))
    shares = labels_right(judge, truth.labels, true, len(truth) + 1)
    good = right(judge, decided, case, true)
    return {
        "object": case.name, "commit": git("rev-parse", "--short", "HEAD"), "parts": len(truth),
        "miou": round(float(shares.mean()), 3), "worst": round(float(shares.min()), 3),
        "answer": round(decided.cost - truth.cost, 4),
        "least_true": round(min((c.cost - truth.cost for c in less), default=float("nan")), 4)
        if less else None,
        "best_false": round(more.cost - truth.cost, 4),
        "pool": [round(100 * nearest(h, case.own(k), found.pool) / judge.study.diag, 2)
                 for k, h in enumerate(truth.motions)],
        "decided": len(decided), "right": len(good),
        "built": case.parts_built, "seconds": round(seconds, 1),
        **(after(case, found, good) if settle else {})}  # fmt: skip


def best(judge: Judge, found: Candidate) -> Candidate:
    """Return a judged set as the decision would leave it."""
    return judge.renewed(judge.polished(found))


def labels_right(judge: Judge, hard: np.ndarray, true: np.ndarray, count: int) -> np.ndarray:
    """Return [count] IoU of every label, mean of both states."""
    first = len(judge.study.surfels[0])
    pairs = zip(np.split(hard, [first]), np.split(true, [first]), strict=True)
    return np.asarray(np.mean([iou(own, there, count) for own, there in pairs], axis=0))


def nearest(h: Joint, points: np.ndarray, pool: Sequence[Joint]) -> float:
    """Return how far from its place the best of a pool carries a part, on average."""
    there = se3.apply(h.move, points)
    return min((float(np.linalg.norm(se3.apply(p.move, points) - there, axis=1).mean())
                for p in pool), default=float("inf"))


def after(case: Known, found: Found, good: set[int]) -> dict[str, Any]:
    """Return what is left of a decision once its joints are settled, with parts that are carried.

    A surfel has the label of the Gaussian next to it. good: true parts that were decided on.
    """
    began = time.monotonic()
    motion, study = settled_motion(case.both.scene, found, ArticulateConfig()), found.judge.study
    seconds = time.monotonic() - began
    left = as_candidate(motion, study)
    end = right(found.judge, left, case, case.labels(study.surfels))
    return {"settled": len(left), "settled_right": len(end), "lost": len(good - end),
            "settled_seconds": round(seconds, 1)}


def as_candidate(motion: Motion, study: Study) -> Candidate:
    """Return settled joints as a set of motions, not judged, surfels labelled as Gaussians near."""
    labels = [motion.labels(s)[cKDTree(study.gaussians[s].means).query(study.surfels[s].points)[1]]
              for s in (0, 1)]
    carried = [replace(h, carrier=motion.joints[p - 1].move if p else None)
               for h, p in zip(motion.joints, motion.parents, strict=True)]
    return replace(on_base(carried, np.concatenate(labels)), parents=motion.parents)


def right(judge: Judge, decided: Candidate, case: Known, true: np.ndarray) -> set[int]:
    """Return the true parts that have a motion of their own that carries them to their place."""
    return set(matched(judge, decided, case, true).values())


def matched(judge: Judge, decided: Candidate, case: Known, true: np.ndarray) -> dict[int, int]:
    """Return the true part, from 0, of every motion that is one's own, by the motion's number."""
    taken: dict[int, int] = {}
    for k, h in enumerate(case.candidate.motions):
        gaps = [nearest(h, case.own(k), [g]) / judge.study.diag for g in decided.motions]
        both = [((decided.labels == n + 1) & (true == k + 1)).sum()
                / max(((decided.labels == n + 1) | (true == k + 1)).sum(), 1)
                for n in range(len(decided))]
        fits = [n for n in range(len(decided)) if n not in taken and gaps[n] < NEAR
                and both[n] > SHARED]
        if fits:
            taken[min(fits, key=lambda n: gaps[n])] = k
    return taken


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return a table of the kit's objects, in other states, of plain solids and of simulators'."""
    own = {"[other states](states.md)": STATES, "[plain solids](solids.md)": THINGS,
           "[two simulators](simulators.md)": OBJECTS}
    kit = [r for r in rows if not any(r["object"] in names for names in own.values())]
    tables = [told(kit)]
    for page, names in own.items():
        if some := [r for r in rows if r["object"] in names]:
            tables.append(f"Objects of {page}:\n\n{told(some)}")
    return "\n".join(tables)


def told(rows: list[dict[str, Any]]) -> str:
    """Return how many objects pass every step, and the table."""
    exact = [r for r in rows if r["right"] == r["decided"] == r["parts"]]
    parts, decided, found = (sum(r[key] for r in rows) for key in ("parts", "decided", "right"))
    ends = [r for r in rows if "settled" in r]
    last = [r for r in ends if r["settled_right"] == r["settled"] == r["parts"]]
    parts_, left, kept, lost = (sum(r[key] for r in ends)
                                for key in ("parts", "settled", "settled_right", "lost"))
    lines = [f"{len(exact)} of {len(rows)} objects are decided right, {found} of {parts} parts, "
             f"{decided - found} false. Margins in prices of a part ({PART}).", "",
             *((f"Settled as well, {len(ends)}: {len(last)} are right, {kept} of {parts_} parts, "
                f"{left - kept} false; {lost} that had been decided on are lost.", "")
               if ends else ()),
             "| object | labels: mIoU, worst | cost: answer | a true part less | a false one more "
             "| search: pool, % | decided, right of true | settled, right of true, lost "
             "| s, and to settle | commit |",
             "|---|---|---|---|---|---|---|---|---|---|"]
    for r in rows:
        less = "-" if r["least_true"] is None else f"{r['least_true'] / PART:+.1f}"
        pool = ", ".join(f"{p:.1f}" for p in r["pool"])
        lines.append(f"| {r['object']} | {r['miou']:.2f}, {r['worst']:.2f} | "
                     f"{r['answer'] / PART:+.1f} | {less} | {r['best_false'] / PART:+.1f} | "
                     f"{pool} | {r['decided']}, {r['right']} of {r['parts']} | {end_of(r)} | "
                     f"{r['commit']} |")
    return "\n".join(lines) + "\n"


def end_of(row: dict[str, Any]) -> str:
    """Return what is left once joints are settled, and the seconds."""
    if "settled" not in row:
        return f"- | {row['seconds']:.0f}"
    return (f"{row['settled']}, {row['settled_right']} of {row['parts']}, {row['lost']} | "
            f"{row['seconds']:.0f}, {row['settled_seconds']:.0f}")


if __name__ == "__main__":
    sys.exit(main())
