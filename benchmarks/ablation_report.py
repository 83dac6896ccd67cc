"""Results of the ablation: means, paired tests, tables, sentences, and what the plan quotes."""

from __future__ import annotations

import json
import math
import os
import platform
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ablation_figure import draw
from ablation_score import METRICS
from ablation_statistics import Paired, holm, paired, together, verdict
from ablation_variants import AVERAGED, NAMES, PRINTED, SWITCHES, comparisons
from raster_machine import commit

from part2gs_robotics.runtime.store import write_text_atomic

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/ablation.json"
PAGE = ROOT / "docs/ablation.md"
FIGURE = ROOT / "docs/ablation.png"
QUOTED = ROOT / "part2gs_robotics/measured_terms.json"
BEGIN, END = "<!-- ablation:begin -->", "<!-- ablation:end -->"
TITLES = {
    "identity": "Part identities", "articulation": "Articulation loss", "repel": "Repel points",
    "vector_field": "Vector-field loss", "velocity": "Velocity loss", "contact": "Contact loss",
    "canonical": "Averaged centres", "physics": "The three physical losses together",
    "alignment": "Second-order alignment",
    "pull before alignment": "Vector field and contact before alignment",
}  # fmt: skip
DIGITS = 3
Key = tuple[str, int]


def summary(runs: Sequence[dict[str, Any]], options: dict[str, Any]) -> dict[str, Any]:
    """Return every number that tables and figure need, from the runs."""
    values = values_of(runs)
    tests = tests_of(values)
    return {
        "options": options, "commit": commit(),
        "machine": f"{os.cpu_count()} CPU cores, {platform.machine()}",
        "runs": [{"object": o, "seed": s, "variant": v, **numbers}
                 for (o, s), row in values.items() for v, numbers in row.items()],
        "tests": tests,
    }  # fmt: skip


def values_of(runs: Sequence[dict[str, Any]]) -> dict[Key, dict[str, dict[str, float]]]:
    """Return metrics per (object, seed) and variant, over parts that all of its variants found.

    A part that one variant loses would otherwise raise or lower its mean; how many parts each found
    is kept beside. Averaged centres may lose any part: they do not decide.
    """
    groups: dict[Key, list[dict[str, Any]]] = defaultdict(list)
    for run in runs:
        groups[run["object"], run["seed"]].append(run)
    found: dict[Key, dict[str, dict[str, float]]] = {}
    for key, group in groups.items():
        seen = {run["variant"]: {p["part"] for p in run["parts"] if p["found"]} for run in group}
        common = set.intersection(*(parts for name, parts in seen.items() if name != AVERAGED))
        found[key] = {run["variant"]: _metrics(run, common & seen[run["variant"]])
                      for run in group}
    return found


def _metrics(run: dict[str, Any], common: set[str]) -> dict[str, float]:
    parts = [part for part in run["parts"] if part["part"] in common]
    means = {name: sum(p[name] for p in parts) / len(parts) if parts else math.nan
             for name in METRICS if name != "miou"}
    return {**means, "miou": run["miou"], "parts_common": len(parts),
            "parts_found": run["parts_found"], "parts_true": len(run["parts"]),
            "joints_pulled": run["joints_pulled"], "seconds": run["seconds"]}


def tests_of(values: dict[Key, dict[str, dict[str, float]]]) -> list[dict[str, Any]]:
    """Return all paired tests; p-values are adjusted (Holm) over all tests of one form."""
    rows: list[dict[str, Any]] = []
    raw: dict[str, dict[str, float]] = defaultdict(dict)
    for c in comparisons():
        both = [row for row in values.values() if c.before in row and c.after in row
                and row[c.before]["parts_common"] and row[c.after]["parts_common"]]
        for metric, (_, larger) in METRICS.items():
            if not both:
                continue
            test = paired([row[c.before][metric] for row in both],
                          [row[c.after][metric] for row in both], larger)
            rows.append({"term": c.key, "form": c.form, "metric": metric, **vars(test)})
            raw[c.form][f"{c.key} {metric}"] = test.p
    adjusted_by = {form: holm(family) for form, family in raw.items()}
    for row in rows:
        adjusted = adjusted_by[row["form"]][f"{row['term']} {row['metric']}"]
        test = Paired(**{name: row[name] for name in Paired.__dataclass_fields__})
        row["p_holm"] = adjusted
        row["verdict"] = verdict(test, adjusted, METRICS[row["metric"]][1])
    return [{k: None if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()}
            for row in rows]


def publish(result: dict[str, Any]) -> str:
    """Write page, figure and what the plan quotes; return the text between the markers."""
    text = markdown(result)
    page = PAGE.read_text()
    before, rest = page.split(BEGIN)
    write_text_atomic(PAGE, f"{before}{BEGIN}\n{text}{END}{rest.split(END)[1]}")
    write_text_atomic(QUOTED, json.dumps(quoted(result), indent=1) + "\n")
    draw(result, FIGURE)
    return text


def quoted(result: dict[str, Any]) -> dict[str, str]:
    """Return one short sentence per switch, as the plan of a build says it; none untested."""
    found = {}
    for name in SWITCHES:
        rows = _rows(result, name, "corrected")
        if rows and all(r["verdict"] != "not tested" for r in rows):
            runs = f"{rows[0]['n']} run" + "s" * (rows[0]["n"] != 1)
            numbers = ", ".join(f"{METRICS[r['metric']][0]} {signed(r['mean'])}" for r in rows)
            found[name] = f"{together([r['verdict'] for r in rows])}: {numbers} on {runs}"
    return found


def markdown(result: dict[str, Any]) -> str:
    """Return both tables, the sentences, and one line on how they were made."""
    options, tests = result["options"], result["tests"]
    keys = {(run["object"], run["seed"]) for run in result["runs"]}
    forms = dict.fromkeys(test["form"] for test in tests)
    families = ", ".join(f"{sum(t['form'] == form and t['p'] is not None for t in tests)} {form}"
                         for form in forms)
    lines = ["| variant | parts found | " + " | ".join(label for label, _ in METRICS.values())
             + " | printed: " + " | printed: ".join(label for label, _ in METRICS.values()) + " |",
             "|---|" + "--:|" * (1 + 2 * len(METRICS))]
    lines += ["| " + " | ".join(_means(result, name)) + " |" for name in NAMES]
    lines += ["", *(sentence(result, *pair) for pair in sentences()), "",
              "| what is compared | form | " + " | ".join(label for label, _ in METRICS.values())
              + " |", "|---|---|" + "---|" * len(METRICS)]
    for c in comparisons():
        rows = _rows(result, c.key, c.form)
        if rows:
            cells = " | ".join(_cell(r) for r in rows)
            lines.append(f"| {TITLES[c.key]} | {c.form} | {cells} |")
    pairs = f"{len(keys)} pair" + "s" * (len(keys) != 1)
    lines += ["", f"{pairs} (objects x seeds: {', '.join(options['objects'])}; seeds "
              f"{', '.join(map(str, options['seeds']))}), {options['views']} + {options['views']} "
              f"RGB views of {options['size']} x {options['size']}, number of parts not given; "
              f"{result['machine']}; commit {result['commit']}. Tests per family: {families}; p "
              "after Holm's correction in its family; d is Cohen's d of paired differences."]
    lines += [f"Failed: {text}" for text in options["failed"]]
    return "\n".join(lines) + "\n"


def sentences() -> list[tuple[str, str]]:
    """Return the (term, form) pairs that get a sentence."""
    return [(c.key, c.form) for c in comparisons()
            if c.form != "printed for corrected" or c.after == AVERAGED]


def sentence(result: dict[str, Any], term: str, form: str) -> str:
    """Return one plain sentence on a term: helps, hurts or no difference, and by how much."""
    rows = _rows(result, term, form)
    if not rows:
        return f"- **{TITLES[term]}**, {form}: not run."
    said = "; ".join(f"{METRICS[r['metric']][0]} {_difference(r)}" for r in rows)
    return f"- **{TITLES[term]}**, {form}: {together([r['verdict'] for r in rows])}. {said}."


def _rows(result: dict[str, Any], term: str, form: str) -> list[dict[str, Any]]:
    return [t for t in result["tests"] if (t["term"], t["form"]) == (term, form)]


def _means(result: dict[str, Any], name: str) -> list[str]:
    """Return the cells of one variant, corrected and printed side by side."""
    cells = []
    for variant in (name, name + PRINTED):
        rows = [run for run in result["runs"] if run["variant"] == variant]
        if variant == name or name + PRINTED == AVERAGED:
            found, true = (sum(r[k] for r in rows) for k in ("parts_found", "parts_true"))
            cells = [NAMES[name], f"{found:.0f} of {true:.0f}", *cells[2:]]
        known = [r for r in rows if r["parts_common"]]
        cells += [f"{sum(r[m] for r in known) / len(known):.{DIGITS}f}" if known else "-"
                  for m in METRICS]
    return cells


def _difference(row: dict[str, Any]) -> str:
    text = signed(row["mean"])
    if row["low"] is None:
        return text
    return f"{text} ({signed(row['low'])} to {signed(row['high'])})"


def signed(value: float) -> str:
    """Return a number with its sign; what rounds to nothing has none."""
    return f"{value:+.{DIGITS}f}" if round(value, DIGITS) else "0"


def _cell(row: dict[str, Any]) -> str:
    p = "" if row["p_holm"] is None else f", p {row['p_holm']:.2g}"
    effect = "" if row["effect"] is None else f", d {row['effect']:+.2f}"
    mark = f", **{row['verdict']}**" if row["verdict"] in ("helps", "hurts") else ""
    return f"{_difference(row)}{p}{effect}{mark}"
