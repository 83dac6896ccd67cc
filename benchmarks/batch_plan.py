"""What 10,000 scenes would cost, from measured builds: the table of docs/batch.md.

    python benchmarks/batch_plan.py --twin out/demo  # measure a finished twin's folder as well
    python benchmarks/batch_plan.py                  # from the stored figures

Seconds and outcomes are those of benchmarks/results/suite.json and photos.json (two CPU cores per
build), losses of workers those of batch.json. Only the prices are assumed, and said to be.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from reconstruction_suite import insert

RESULTS = Path(__file__).resolve().parent / "results"
SCENES = 10_000
CORES = 2  # per build, as in the suite
PAGE = RESULTS.parent.parent / "docs/batch.md"
MARKS = "<!-- plan10k:begin -->", "<!-- plan10k:end -->"
HOSTS = 32  # machines of the plan
HOST_CORES = 32  # of each
CORE_HOUR = 0.04  # assumed: dollars per core and hour of a rented machine, 2025
GB_MONTH = 0.02  # assumed: dollars per gigabyte and month of object storage


def measured(twin: Path) -> dict[str, float]:
    """Return megabytes of a twin's folder: the twin itself, and the stages for resuming."""
    def size(folder: Path) -> float:
        return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6

    stages = size(twin / "stages")
    return {"twin_mb": round(size(twin) - stages, 1), "stages_mb": round(stages, 1)}


def stored() -> dict[str, object]:
    """Return the numbers the plan rests on."""
    return {name: json.loads((RESULTS / f"{name}.json").read_text())
            for name in ("suite", "photos", "batch", "batch_plan")}


def plan(found: dict[str, object]) -> dict[str, float]:
    """Return the figures of the plan."""
    rows = found["suite"]["rows"]
    build = sum(row["seconds"] for row in rows) / len(rows)
    taken = [row["seconds"] for row in found["photos"] if row["seconds"] is not None]
    photos = sum(taken) / len(taken)
    whole = [row for row in rows if row["exit"] == 0 and row["parts_found"] == row["parts_true"]
             and not row["parts_extra"]]
    size = found["batch_plan"]
    hours = SCENES * (build + photos) * CORES / 3600
    gigabytes = SCENES * size["twin_mb"] / 1000
    return {"build_seconds": build, "photo_seconds": photos, "core_hours": hours,
            "days": hours / (HOSTS * HOST_CORES) / 24, "good": len(whole), "of": len(rows),
            "twin_mb": size["twin_mb"], "stages_mb": size["stages_mb"],
            "terabytes": gigabytes / 1000,
            "stages_terabytes": SCENES * size["stages_mb"] / 1e6,
            "compute_dollars": hours * CORE_HOUR, "month_dollars": gigabytes * GB_MONTH,
            "cents": 100 * hours * CORE_HOUR / SCENES,
            "kills": found["batch"]["kills"], "scenes": found["batch"]["scenes"]}


def markdown(found: dict[str, object] | None = None) -> str:
    """Return the table of the page."""
    p = plan(stored())
    missed = 1 - p["good"] / p["of"]
    lines = [
        ("a build, 64 + 64 photos, two cores", f"{p['build_seconds']:.0f} s"),
        ("cameras and masks of 2 × 32 plain photos, two cores", f"{p['photo_seconds']:.0f} s"),
        (f"core hours of {SCENES:,} scenes of plain photos", f"{p['core_hours']:,.0f}"),
        (f"on {HOSTS} machines of {HOST_CORES} cores", f"{p['days'] * 24:.1f} hours"),
        (f"computing, at an assumed {CORE_HOUR:g} $ per core hour",
         f"{p['compute_dollars']:,.0f} $, {p['cents']:.1f} cents a twin"),
        ("a twin's folder without stages", f"{p['twin_mb']:.1f} MB"),
        (f"{SCENES:,} of them", f"{p['terabytes']:.2f} TB; {p['month_dollars']:,.0f} $ a month "
         f"at an assumed {GB_MONTH:g} $ per GB"),
        ("stages, needed only to resume", f"{p['stages_mb']:.1f} MB a twin, "
         f"{p['stages_terabytes']:.2f} TB"),
        ("twins with all parts and every check passing", f"{p['good']} of {p['of']}: "
         f"expect {SCENES * missed:,.0f} of {SCENES:,} to look at"),
        ("scenes lost or doubled by killed workers",
         f"0 of {p['scenes']} under {p['kills']} kills"),
    ]
    table = ["| what | figure |", "|---|---|", *(f"| {a} | {b} |" for a, b in lines)]
    return "\n".join(table) + "\n"


def main() -> int:
    """Measure a twin's folder if one is given, print the table and write it into its page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twin", type=Path, help="folder of a finished build")
    given = parser.parse_args()
    if given.twin:
        (RESULTS / "batch_plan.json").write_text(json.dumps(measured(given.twin), indent=1) + "\n")
    sys.stdout.write(markdown())
    PAGE.write_text(insert(PAGE.read_text(), markdown(), *MARKS))
    return 0


if __name__ == "__main__":
    sys.exit(main())
