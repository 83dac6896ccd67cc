"""Score `part2gs-robot build` on the kit's objects in other states than its own.

    python benchmarks/other_states.py --kit PATH [--objects NAME ...]

The kit's states open everything. Here some parts close while others open, some move little, some
not at all, and drawers come out alike. Rendering and scoring are the kit's, as in
reconstruction_suite.py; objects that are not run keep their rows.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from reconstruction_suite import ROOT, score_own

# Name of the row: the kit's object, and per joint its value in both states (rad or scene units).
Moves = dict[str, tuple[float, float]]
STATES: dict[str, tuple[str, Moves]] = {
    "one_drawer_closes": (
        "libero_wooden_cabinet",
        {"middle_level": (0.0, -0.05), "bottom_level": (-0.09, -0.02)}),
    "one_door_closes": (
        "sektion_cabinet",
        {"door_right_joint": (1.25, 0.0), "door_left_joint": (-0.5, -1.3),
         "drawer_top_joint": (0.2, 0.02)}),
    "one_drawer_one_door": (
        "pm_31249_table", {"joint_0": (0.0, 0.12), "joint_3": (0.0, 0.45)}),
    "laptop_92_deg": ("pm_10211_laptop", {"joint_1": (0.3, -1.3)}),
    "microwave_14_deg": ("libero_microwave", {"microjoint": (-0.02, -0.26)}),
    "trash_can_17_deg": ("pm_102209_trashcan", {"joint_2": (0.0, 0.3)}),
    "dishwasher_door_alone": ("bigym_dishwasher", {"door_hinge": (0.05, 1.2)}),
    "door_23_deg": ("robosuite_door", {"hinge": (0.0, 0.4)}),
    "two_drawers_cross": (
        "sektion_cabinet", {"drawer_top_joint": (0.22, 0.02), "drawer_bottom_joint": (0.0, 0.25)}),
    "doors_11_deg": (
        "sektion_cabinet", {"door_right_joint": (0.1, 0.3), "door_left_joint": (-0.1, -0.3)}),
    "doors_cross": (
        "pm_31249_table",
        {"joint_3": (0.1, 0.9), "joint_4": (1.1, 0.2), "joint_1": (0.0, 0.2)}),
    "drawers_uneven": (
        "libero_wooden_cabinet",
        {"top_level": (-0.01, -0.04), "middle_level": (-0.09, -0.02), "bottom_level": (0.0, -0.1)}),
    "drawers_alike": (
        "libero_wooden_cabinet",
        {"top_level": (0.0, -0.1), "middle_level": (0.0, -0.1), "bottom_level": (0.0, -0.1)}),
    "two_drawers_alike": (
        "sektion_cabinet", {"drawer_top_joint": (0.0, 0.25), "drawer_bottom_joint": (0.0, 0.25)}),
    "desk_alike": (
        "pm_32761_table", {f"joint_{n}": (0.0, 0.2) for n in range(4)}),
    "table_alike": (
        "pm_31249_table", {"joint_0": (0.0, 0.25), "joint_1": (0.0, 0.25)}),
}


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    return score_own(__doc__.splitlines()[0], list(STATES), "benchmarks/other_states.py",
                     ROOT / "docs/states.md",
                     lambda work: ["--index", str(write_index(work, {
                         name: (*entry, {}) for name, entry in STATES.items()}).resolve())])


def write_index(folder: Path, states: Mapping[str, tuple[str, Moves, dict[str, float]]]) -> Path:
    """Write the kit's index of states and return it; of each the object, what moves, what stays."""
    entries: dict[str, dict[str, Any]] = {
        name: {"object": thing, "licence": "as in the kit", "units": "as in the kit",
               "move": {joint: list(values) for joint, values in move.items()}, "frozen": stays}
        for name, (thing, move, stays) in states.items()}
    folder.mkdir(parents=True, exist_ok=True)
    index = folder / "states.yaml"
    index.write_text(yaml.safe_dump({"objects": entries}))
    return index


if __name__ == "__main__":
    sys.exit(main())
