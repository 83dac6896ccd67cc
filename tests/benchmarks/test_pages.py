"""What stands on the pages is what the scripts make of the numbers stored beside them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results"
# A page's markers, the numbers, and what the script makes of them.
TABLES = {
    ("docs/results.md", "suite"): ("suite", "reconstruction_suite", "markdown"),
    ("README.md", "summary"): ("suite", "reconstruction_suite", "short"),
    ("docs/results.md", "anytime"): ("reconstruction", "reconstruction", "page"),
    ("docs/ablation.md", "plan"): ("plan", "plan_table", "markdown"),
    ("docs/ablation.md", "ablation"): ("ablation", "ablation_report", "markdown"),
    ("docs/edges.md", "edges"): ("edges", "edges", "table"),
    ("docs/judges.md", "judges"): ("judges", "judges", "table"),
    ("docs/geometry.md", "geometry"): ("geometry", "geometry_tables", "markdown"),
    ("docs/geometry.md", "pieces"): ("pieces", "pieces", "markdown"),
    ("docs/ladder.md", "ladder"): ("ladder", "ladder", "markdown"),
    ("docs/ladder.md", "incomplete"): ("incomplete", "incomplete", "markdown"),
    ("docs/ladder.md", "rules"): ("rules", "rules", "markdown"),
    ("docs/losses.md", "losses"): ("losses", "losses_ranks", "markdown"),
    ("docs/scene.md", "align"): ("align", "align", "table"),
    ("docs/masks.md", "masks"): ("masks", "masks", "table"),
    ("docs/sabotage.md", "sabotage"): ("sabotage", "sabotage", "markdown"),
    ("docs/sabotage.md", "twins"): ("sabotage_twins", "sabotage", "table_of_twins"),
    ("docs/photos.md", "photos"): ("photos", "photos", "markdown"),
    ("docs/batch.md", "trial"): ("batch", "batch", "markdown"),
    ("docs/batch.md", "plan10k"): ("batch_plan", "batch_plan", "markdown"),
    ("docs/assets.md", "assets"): ("assets", "assets", "markdown"),
    ("docs/checks.md", "fuzz"): ("fuzz_models", "fuzz_models", "markdown"),
    ("docs/ci.md", "time"): ("check_time", "check_time", "markdown"),
    ("docs/stress.md", "stress"): ("stress", "stress", "markdown"),
    ("docs/raster.md", "kernels"): ("kernels", "kernels", "markdown"),
}
OWN = {"solids": "solids", "simulators": "simulators", "states": "other_states",
       "random_states": "random_states"}


def stored(name: str):
    return json.loads((RESULTS / f"{name}.json").read_text())


def between(page: str, marker: str) -> str:
    """Return what stands between markers, each of which is there once."""
    text = (ROOT / page).read_text()
    parts = re.split(rf"<!-- {marker}:(?:begin|end) -->", text)
    assert len(parts) == 3, f"{page}: markers of {marker}"
    return parts[1].removeprefix("\n")


@pytest.mark.parametrize(("page", "marker"), TABLES)
def test_a_page_holds_what_its_script_makes(load, page: str, marker: str) -> None:
    numbers, script, function = TABLES[page, marker]
    assert between(page, marker) == getattr(load(script), function)(stored(numbers))


@pytest.mark.parametrize("marker", OWN)
def test_a_page_of_own_objects_holds_what_its_script_makes(load, marker: str) -> None:
    made = load("reconstruction_suite").markdown(stored(OWN[marker]),
                                                 f"benchmarks/{OWN[marker]}.py")
    assert between(f"docs/{marker}.md", marker) == made


def test_the_page_of_robustness_is_what_its_script_makes(load) -> None:
    made = load("robustness").document(stored("robustness")["rows"])
    assert (ROOT / "docs/robustness.md").read_text() == made


def test_every_row_of_the_rasteriser_is_of_its_numbers(load) -> None:
    page = (ROOT / "docs/raster.md").read_text()
    rows = load("raster").table(stored("raster")).splitlines()[2:6]
    assert all(row in page for row in rows)


def test_the_readme_says_what_its_rows_are_of(load) -> None:
    result, text = stored("suite"), (ROOT / "README.md").read_text()
    options = result["options"]
    assert (f"{options['views']} + {options['views']} photos of {options['size']} x "
            f"{options['size']} pixels") in text
    assert result["machine"].split(",")[0] in text
    assert set(load("reconstruction_suite").SHOWN) <= {row["object"] for row in result["rows"]}
