"""Compare our collision pieces with CoACD's on parts of twins, and put the table into docs.

    pip install coacd
    python benchmarks/pieces.py TWIN [TWIN ...]

Every part of the twins is cut anew by both, at most 32 pieces of at most 64 corners, CoACD at two
thresholds (0.05 is its own default) and without its own repair, since meshes are closed. Each runs
in a process of its own; what takes longer than LIMIT is cut off and said. Without twins the table
in docs/geometry.md is made anew from benchmarks/results/pieces.json.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from reconstruction_suite import git, insert, number

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/pieces.json", ROOT / "docs/geometry.md"
MARKS = "<!-- pieces:begin -->", "<!-- pieces:end -->"
WAYS = ("ours", "coacd 0.05", "coacd 0.02")
LIMIT = 30.0  # seconds per part: a build has as many for all parts
PIECES, CORNERS = 32, 64
CELLS = 192  # of the default preset along the longest side
HEAD = ("object", "part", "triangles", "way", "pieces", "phantom, %", "missing, %", "overlap",
        "s", "commit")


def main() -> int:
    """Measure the twins that are given, store the numbers, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("twins", type=Path, nargs="*", help="twin folders")
    args = parser.parse_args()
    if args.twins:
        rows = [row for twin in args.twins for row in measured(twin)]
        RESULTS.write_text(json.dumps(rows, indent=1) + "\n")
    page = markdown(json.loads(RESULTS.read_text()))
    PAGE.write_text(insert(PAGE.read_text(), page, *MARKS))
    sys.stdout.write(page)
    return 0


def measured(folder: Path) -> list[dict[str, Any]]:
    """Return one row per part of a twin and way."""
    from part2gs_robotics.exporters.read_twin import read_twin

    twin = read_twin(folder)
    points = np.concatenate([part.mesh.vertices for part in twin.parts])
    cell = float(np.ptp(points, axis=0).max()) / CELLS
    rows = []
    for index, part in enumerate(twin.parts):
        for way in WAYS:
            row = {"object": folder.name, "part": part.name, "triangles": len(part.mesh.faces),
                   "way": way, "commit": git("rev-parse", "--short", "HEAD")}
            rows.append(row | limited(folder, index, way, cell))
            sys.stderr.write(f"{rows[-1]}\n")
    return rows


def limited(folder: Path, index: int, way: str, cell: float) -> dict[str, Any]:
    """Return what `cut` says, or nothing but the time where it takes longer than LIMIT."""
    context = multiprocessing.get_context("spawn")
    answers: Any = context.Queue()
    task = context.Process(target=cut, args=(folder, index, way, cell, answers))
    task.start()
    try:
        return dict(answers.get(timeout=LIMIT + 10.0))  # the process starts in less
    except Exception:
        return {"seconds": LIMIT}
    finally:
        task.kill()
        task.join()


def cut(folder: Path, index: int, way: str, cell: float, answers: Any) -> None:
    """Put figures of one part's pieces into a queue."""
    from part2gs_robotics.exporters.read_twin import read_twin
    from part2gs_robotics.model.solids import bound

    mesh = read_twin(folder).parts[index].mesh
    began = time.perf_counter()
    pieces = pieces_of(mesh, way, cell)
    seconds = time.perf_counter() - began
    found = bound(mesh, pieces)
    answers.put({"pieces": len(pieces), "phantom": found.phantom / found.volume,
                 "missing": found.missing / found.volume, "overlap": found.overlap,
                 "seconds": seconds})


def pieces_of(mesh: Any, way: str, cell: float) -> tuple[Any, ...]:
    """Return convex pieces of a closed mesh, made the one or the other way."""
    from part2gs_robotics.collision.convex import convex_pieces
    from part2gs_robotics.model.twin import PartMesh

    if way == "ours":
        return convex_pieces(mesh, tolerance=cell, max_pieces=PIECES)
    coacd = import_module("coacd")  # of this comparison alone, so no dependency of the workshop
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=float(way.split()[1]),
                            max_convex_hull=PIECES, preprocess_mode="off", decimate=True,
                            max_ch_vertex=CORNERS, seed=0)
    dark = [np.zeros((len(corners), 3), np.uint8) for corners, _ in parts]
    return tuple(PartMesh(np.array(v, float), np.array(f, np.int64), color)
                 for (v, f), color in zip(parts, dark, strict=True))


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return the table, one row per way with means first."""
    out = [f"| {' | '.join(('way', *HEAD[4:9]))} | parts within {LIMIT:g} s |", "|---" * 7 + "|"]
    for way in WAYS:
        mine = [row for row in rows if row["way"] == way]
        done = [row for row in mine if "pieces" in row]
        cells = [_mean(done, key) for key in ("pieces", "phantom", "missing", "overlap")]
        seconds = float(np.mean([row["seconds"] for row in mine])) if mine else None
        out.append(f"| {' | '.join((way, *_cells([*cells, seconds])))} "
                   f"| {len(done)} of {len(mine)} |")
    out += ["", f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for row in rows:
        values = [row.get(k) for k in ("pieces", "phantom", "missing", "overlap", "seconds")]
        names = (row["object"], row["part"], str(row["triangles"]), row["way"])
        out.append(f"| {' | '.join((*names, *_cells(values), row['commit']))} |")
    return "\n".join(out) + "\n"


def _mean(rows: list[dict[str, Any]], key: str) -> float | None:
    return float(np.mean([row[key] for row in rows])) if rows else None


def _cells(values: list[float | None]) -> list[str]:
    pieces, phantom, missing, overlap, seconds = values
    percent = [None if v is None else 100 * v for v in (phantom, missing)]
    return [number(pieces, 0), number(percent[0], 1), number(percent[1], 1), number(overlap, 2),
            number(seconds, 1)]


if __name__ == "__main__":
    sys.exit(main())
