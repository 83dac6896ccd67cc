"""States turned and shifted out of one frame on purpose: what `--align` leaves of it.

    python benchmarks/align.py SCENE ...

Every SCENE has both states in one frame. State 1 is turned by 2 degrees and shifted by 2 % of the
size, in a random direction, and once not at all; `--align` sees only photos. Writes
benchmarks/results/align.json and the table of docs/scene.md; scenes not given keep their rows.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from reconstruction_suite import insert

from part2gs_robotics.align.align_states import carried, on_what_stayed
from part2gs_robotics.config import resolve
from part2gs_robotics.model.se3 import apply, inverse, make, rotation_from_rotvec, turn
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.validate import common_box

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/align.json", ROOT / "docs/scene.md"
MARKS = "<!-- align:begin -->", "<!-- align:end -->"
DEGREES, SHARE, SEEDS = 2.0, 0.02, (0, 1)  # of the size; directions


def main() -> int:
    """Plant offsets in the scenes given, store what is left of them, and write the table."""
    rows = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for word in sys.argv[1:]:
        rows[Path(word).name] = measured(Path(word))
        RESULTS.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")
    PAGE.write_text(insert(PAGE.read_text(), table(rows), *MARKS))
    sys.stdout.write(table(rows))
    return 0


def measured(path: Path) -> dict[str, Any]:
    """Return what is left of planted offsets: degrees, and per cent of the size at the corners."""
    states = read_scene(path, resolve({}).read).states
    low, high = common_box(states, str(path))
    corners = np.stack(np.meshgrid(*np.stack([low, high], 1), indexing="ij"), -1).reshape(-1, 3)
    size, left = float(np.linalg.norm(high - low)), []
    for seed in SEEDS:
        wrong = planted(np.random.default_rng(seed), (low + high) / 2, size)
        pair = states[0], carried(states[1], wrong)
        found, _ = on_what_stayed(pair, common_box(pair, str(path)), str(path))
        rest = inverse(found.viewmats[0]) @ states[1].viewmats[0]
        off = np.linalg.norm(apply(rest, corners) - corners, axis=1).max() / size
        left.append([round(float(np.degrees(turn(rest))), 3), round(100 * float(off), 3)])
    same, _ = on_what_stayed(states, (low, high), str(path))
    return {"left": left, "untouched": same is states[1]}


def planted(rng: np.random.Generator, middle: np.ndarray, size: float) -> np.ndarray:
    """Return a motion [4, 4] about the object's middle, in a random direction."""
    axis, way = (v / np.linalg.norm(v) for v in rng.normal(size=(2, 3)))
    turned = rotation_from_rotvec(np.deg2rad(DEGREES) * axis)
    return make(turned, middle - turned @ middle + SHARE * size * way)


def table(rows: dict[str, Any]) -> str:
    """Return the table."""
    head = ("scene", "left of 2 degrees", "left of 2 %, at the box's corners",
            "untouched in one frame")
    lines = [f"| {' | '.join(head)} |", "|---|---|---|---|"]
    for name, row in sorted(rows.items()):
        degrees, shares = (", ".join(f"{one[k]:.2f}" for one in row["left"]) for k in (0, 1))
        lines.append(f"| {name} | {degrees} | {shares} | {'yes' if row['untouched'] else 'no'} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
