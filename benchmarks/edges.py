"""How well straight edges in the photos tell the directions of true joints.

    python benchmarks/edges.py SCENE ...

Every SCENE is one that the kit rendered, with its truth in SCENE.gt/gt.json beside it. No fit is
made: only the photos are looked at. Writes benchmarks/results/edges.json and docs/edges.md; scenes
that are not given keep their rows.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reconstruction_suite import insert

from part2gs_robotics.config import resolve
from part2gs_robotics.decide.made_joints import square
from part2gs_robotics.evidence.edges import bundled, edge_families
from part2gs_robotics.evidence.segments import segments_of
from part2gs_robotics.readers.read_scene import read_scene

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/edges.json", ROOT / "docs/edges.md"
HEAD = "object", "edges", "directions", "sigma, deg", "joints", "joint to its line, deg", "seconds"


def main() -> int:
    """Look at the scenes given, store the rows, and write the page."""
    scenes = [Path(word) for word in sys.argv[1:]]
    missing = [str(s) for s in scenes if not s.with_name(f"{s.name}.gt").is_dir()]
    if missing:
        sys.stderr.write(f"{', '.join(missing)}: no truth beside it. Expected a scene that the kit "
                         "rendered, and SCENE.gt; give its folder.\n")
        return 2
    rows = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    rows.update({scene.name: looked_at(scene) for scene in scenes})
    RESULTS.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")
    PAGE.write_text(insert(PAGE.read_text(), table(rows), "<!-- edges:begin -->",
                           "<!-- edges:end -->"))
    sys.stdout.write(table(rows))
    return 0


def looked_at(scene: Path) -> dict[str, Any]:
    """Return what the edges of a scene tell, and how far its true axes are from it."""
    states = read_scene(scene, resolve({"preset": "standard"}).read).states
    start = time.perf_counter()
    segments = [segments_of(state) for state in states]
    families = edge_families(bundled(segments), np.random.default_rng(0))
    seconds = time.perf_counter() - start
    lines = square(np.array([d for d, _ in families]).reshape(-1, 3))
    parts = json.loads((scene.with_name(f"{scene.name}.gt") / "gt.json").read_text())["parts"]
    axes = [np.array(p["axis"]) / np.linalg.norm(p["axis"]) for p in parts]
    return {"edges": sum(map(len, segments)), "directions": len(families), "seconds": seconds,
            "sigma_deg": [float(np.degrees(np.sqrt(np.trace(e)))) for _, e in families],
            "gaps_deg": [_gap(axis, lines) for axis in axes]}


def _gap(axis: NDArray[np.float64], lines: NDArray[np.float64]) -> float | None:
    """Return degrees between an axis and the nearest line that joints keep to."""
    if not len(lines):
        return None
    across = np.linalg.norm(np.cross(lines, axis), axis=1)
    return float(np.degrees(np.arctan2(across, np.abs(lines @ axis)).min()))


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Return the rows and their summary as Markdown."""
    lines = [_line(HEAD), _line(["---"] * len(HEAD))]
    for name, row in sorted(rows.items()):
        sigmas, gaps = row["sigma_deg"], [g for g in row["gaps_deg"] if g is not None]
        lines.append(_line([
            name, str(row["edges"]), str(row["directions"]),
            f"{min(sigmas):.3f} to {max(sigmas):.3f}" if sigmas else "-",
            str(len(row["gaps_deg"])), ", ".join(f"{g:.3f}" for g in gaps) or "-",
            f"{row['seconds']:.1f}"]))
    gaps = sorted(g for row in rows.values() for g in row["gaps_deg"] if g is not None)
    summary = (f"{len(gaps)} joints of {len(rows)} scenes: median {np.median(gaps):.3f} deg, "
               f"{sum(g < 0.02 for g in gaps)} below 0.02, {sum(g < 0.15 for g in gaps)} below "
               f"0.15, worst {gaps[-1]:.2f}." if gaps else "No scene yet.")
    return "\n".join(lines) + f"\n\n{summary} Made by `benchmarks/edges.py`.\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    sys.exit(main())
