"""Ask what is lost without each rule of the decision, and put the table into docs.

    python benchmarks/rules.py --work FOLDER [FOLDER ...] [--objects NAME ...] [--rules NAME ...]
                               [--settle]

Every FOLDER holds scenes and builds that the benchmark kit's suite made, as for ladder.py; their
fits are used. Motions are decided on as the product does, and once without each rule of
`rules_off.py`, from the same study; with --settle, joints of what is decided are settled as always,
and once without each rule of that half. Where --rules names some, what all of them together find is
not asked again if it is stored. Without --work the table of docs/ladder.md is made anew from
results/rules.json.
"""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
from ladder import as_candidate, labels_right, matched
from ladder_truth import Known, known, places
from reconstruction_suite import git, published
from rules_off import DECIDED, SETTLED, Rule, off

from part2gs_robotics.articulate import Clock, Found, settled_motion
from part2gs_robotics.config import ArticulateConfig, SearchConfig
from part2gs_robotics.decide import grow
from part2gs_robotics.decide.candidate import PART, Candidate, on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.evidence.study import Study, gather
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search import pool as searching

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/rules.json", ROOT / "docs/ladder.md"
MARKS = "<!-- rules:begin -->", "<!-- rules:end -->"


def main() -> int:
    """Decide without every rule, store the numbers, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, nargs="+", default=[], help="folders of the suite")
    parser.add_argument("--objects", nargs="+", help="only these")
    parser.add_argument("--rules", nargs="+", help="only these")
    parser.add_argument("--settle", action="store_true", help="rules of the second half")
    args = parser.parse_args()
    for name, out, scene in places(args.work, args.objects, "02_fit_1"):
        case = known(name, out, scene)
        usual, every = (Rule("settled", ""), SETTLED) if args.settle else (Rule("", ""), DECIDED)
        rules = [r for r in every if not args.rules or r.name in args.rules]
        if not args.rules or not any((r["rule"], r["object"]) == (usual.name, name)
                                     for r in stored()):
            rules.insert(0, usual)
        for row in (settled if args.settle else decided)(case, rules):
            sys.stderr.write(f"{row}\n")
            keep(row)
    rows = {f"{r['rule']} {r['object']}": r for r in stored()}
    return published(rows, RESULTS, (PAGE, *MARKS), markdown)


def stored() -> list[dict[str, Any]]:
    """Return the rows so far."""
    return json.loads(RESULTS.read_text()) if RESULTS.exists() else []


def keep(row: dict[str, Any]) -> None:
    """Store a row in the place of an earlier one; another run may have stored some meanwhile."""
    named = row["rule"], row["object"]
    rows = [r for r in stored() if (r["rule"], r["object"]) != named] + [row]
    rows.sort(key=lambda r: (r["rule"], r["object"]))
    RESULTS.write_text(json.dumps(rows, indent=1) + "\n")


@dataclass(frozen=True)
class Start:
    """What all decisions about an object start from: study, pool, and the search's dice."""

    study: Study
    pool: list[Joint]
    rng: np.random.Generator


def decided(case: Known, rules: list[Rule]) -> Iterator[dict[str, Any]]:
    """Yield a row of the decision without each rule."""
    start = searched(gather(case.both, SearchConfig()))
    study = start.study
    judge = Judge(study)  # of the whole cost, whatever decided
    for rule in rules:
        began = time.process_time()
        with off(rule):
            given = start if not rule.searches else searched(study)
            found = found_of(Judge(rule.study(study)), given)
        seconds = time.process_time() - began
        yield row(case, rule, judge, found.candidate, seconds)


def settled(case: Known, rules: list[Rule]) -> Iterator[dict[str, Any]]:
    """Yield a row of the joints settled without each rule of that half."""
    start = searched(gather(case.both, SearchConfig()))
    found = found_of(Judge(start.study), start)
    for rule in rules:
        began = time.process_time()
        with off(rule):
            motion = settled_motion(case.both.scene, replace(found, clock=Clock(None)),
                                    ArticulateConfig())
        seconds = time.process_time() - began
        yield row(case, rule, found.judge, as_candidate(motion, start.study), seconds)


def searched(study: Study) -> Start:
    """Return what the product's search finds."""
    seed, moved = ArticulateConfig().seed, sum(map(len, study.evidence.sets))
    study = searching.in_its_light(study, np.random.default_rng(seed), moved, SearchConfig())
    rng = np.random.default_rng(seed)
    pool = searching.find_pool(study, rng, moved, SearchConfig())
    return Start(study, grow.neared(Judge(study), on_base([]), pool), rng)


def found_of(judge: Judge, start: Start) -> Found:
    """Return what is decided on, as the product decides; dice are thrown alike every time."""
    rng, search = deepcopy(start.rng), SearchConfig()
    candidate, short = grow.decide(judge, start.pool, None, lambda left: searching.find_more(
        judge.study, left, rng, search))
    return Found(judge, candidate, start.pool, short, Clock(None))


def row(case: Known, rule: Rule, judge: Judge, end: Candidate, seconds: float) -> dict[str, Any]:
    """Return what a set of motions with labels is worth beside the truth.

    `cost`: of its motions by the whole cost, above the set in which nothing moves. `seconds`: of
    processors, as other work may run beside.
    """
    true = case.labels(judge.study.surfels)
    pairs = matched(judge, end, case, true)
    named = np.zeros(len(end) + 1, np.int64)
    named[1:] = [pairs.get(n, len(case.candidate) + n) + 1 for n in range(len(end))]
    shares = labels_right(judge, named[end.labels], true, len(case.candidate) + 1)
    axes = [angle(end.motions[n], case.candidate.motions[k]) for n, k in pairs.items()]
    whole = judge.judge(replace(end, judged=None)).cost - judge.judge(on_base([])).cost
    return {"rule": rule.name, "object": case.name, "parts": len(case.candidate),
            "found": len(end), "right": len(pairs), "miou": round(float(shares.mean()), 3),
            "axis": round(max(axes, default=0.0), 3), "cost": round(whole / PART, 2),
            "seconds": round(seconds, 1), "commit": git("rev-parse", "--short", "HEAD")}


def angle(h: Joint, true: Joint) -> float:
    """Return the angle between two axes, degrees."""
    return float(np.rad2deg(np.arccos(min(abs(float(h.axis @ true.axis)), 1.0))))


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the two tables: rules of the decision, and rules of what settles it."""
    return "\n".join([table(rows, "", DECIDED, "decided"), table(rows, "settled", SETTLED,
                                                                   "settled")])


def table(rows: list[dict[str, Any]], usual: str, rules: tuple[Rule, ...], word: str) -> str:
    """Return a table of what changes without each rule, on the objects that were asked."""
    by = {(r["rule"], r["object"]): r for r in rows}
    names = sorted(o for rule, o in by if rule == usual)
    lines = [*textwrap.wrap(f"{word.capitalize()} with and without each rule, {len(names)} "
                            f"objects: {', '.join(names)}.", 120), "",
             "| without | objects right | parts right, false | mIoU | axis, worst, deg "
             "| cost, prices | CPU time | otherwise on |", "|---" * 8 + "|"]
    for rule in rules:
        own = [by[rule.name, o] for o in names if (rule.name, o) in by]
        if own:
            was = [by[usual, r["object"]] for r in own]
            lines.append(line(rule, own, was))
    return "\n".join(lines) + "\n"


def line(rule: Rule, own: list[dict[str, Any]], was: list[dict[str, Any]]) -> str:
    """Return the table's line of one rule; was: the same objects with it."""
    same = "right", "found", "miou", "axis", "cost"
    others = [f"`{r['object']}`" for r, w in zip(own, was, strict=True)
              if any(r[key] != w[key] for key in same)]
    gap = fmean(r["cost"] - w["cost"] for r, w in zip(own, was, strict=True))
    # The first search ran anew for some rules, once for all others: their seconds are not alike.
    share = ("-" if rule.searches else
             f"x {sum(r['seconds'] for r in own) / sum(w['seconds'] for w in was):.2f}")
    before, after = ([exact(rows), f"{total(rows, 'right')}, {false(rows)}",
                      f"{fmean(r['miou'] for r in rows):.3f}",
                      f"{max(r['axis'] for r in rows):.2f}"] for rows in (was, own))
    counts, parts, *rest = (a if a == b else f"{b} → {a}"
                            for b, a in zip(before, after, strict=True))
    return (f"| {rule.told} | {counts} of {len(own)} | {parts} of {total(own, 'parts')} | "
            f"{' | '.join(rest)} | {gap:+.2f} | {share} | {', '.join(others) or 'none'} |")


def exact(rows: list[dict[str, Any]]) -> str:
    """Return how many objects are right: all their parts, and no other."""
    return str(sum(r["right"] == r["found"] == r["parts"] for r in rows))


def total(rows: list[dict[str, Any]], key: str) -> int:
    """Return a sum over objects."""
    return sum(r[key] for r in rows)


def false(rows: list[dict[str, Any]]) -> int:
    """Return how many parts are found that are none."""
    return total(rows, "found") - total(rows, "right")


if __name__ == "__main__":
    sys.exit(main())
