"""Compare exported twins with held-out photos, and put the table into docs.

    python benchmarks/reconstruction_suite.py --kit PATH --work FOLDER
    python benchmarks/looks.py --kit PATH --work FOLDER

The kit is a folder with `look.py`, which renders the exported MJCF as a viewer would, unlit, from
cameras that the build never saw, in both states. FOLDER holds the scenes and twins of the suite.
Without --kit the table in docs/results.md is made anew from benchmarks/results/looks.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from reconstruction_suite import OBJECTS, git, insert, number

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/looks.json", ROOT / "docs/results.md"
MARKS = "<!-- looks:begin -->", "<!-- looks:end -->"
HEAD = ("object", "PSNR, dB", "SSIM", "silhouette IoU", "normals, deg", "rough", "triangles",
        "commit")
DIGITS = {"psnr_db": 1, "ssim": 3, "mask_iou": 3, "normal_deg": 1, "rough": 2, "faces": 0}


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    parser.add_argument("--work", type=Path, help="folder that reconstruction_suite.py filled")
    parser.add_argument("--pictures", type=Path, help="folder for pictures, photo above twin")
    args = parser.parse_args()
    if args.kit and args.work:
        found = looks(args.kit, args.work, args.pictures)
        RESULTS.write_text(json.dumps(found, indent=1) + "\n")
    if not RESULTS.exists():
        sys.stderr.write(f"{RESULTS}: not there yet. Expected an earlier run; give --kit PATH and "
                         "--work FOLDER.\n")
        return 2
    table = markdown(json.loads(RESULTS.read_text()))
    PAGE.write_text(insert(PAGE.read_text(), table, *MARKS))
    sys.stdout.write(table)
    return 0


def looks(kit: Path, work: Path, pictures: Path | None) -> dict[str, Any]:
    """Return by object what the kit measured on the twins of a suite, with the commit."""
    (runs,), (scenes,) = ([p for p in (work / name).iterdir() if p.is_dir()]
                          for name in ("runs", "scenes"))
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary) / "looks.json"
        command = [sys.executable, str(kit.resolve() / "look.py"), "--all", str(runs.resolve()),
                   str(scenes.resolve()), "--json", str(out)]
        if pictures:
            command += ["--picture", str(pictures.resolve())]
        environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # the kit may be read-only
        subprocess.run(command, check=True, env=environment, stdout=2)
        rows = json.loads(out.read_text())
    commit = git("rev-parse", "--short", "HEAD")
    return {name: row | {"commit": commit} for name, row in rows.items()}


def markdown(rows: dict[str, Any]) -> str:
    """Return a table of results, objects in the suite's order, the mean last."""
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    order = [name for name in OBJECTS if name in rows]
    order += [name for name in rows if name not in OBJECTS]
    lines += ["| " + " | ".join([name, *cells(rows[name]), rows[name]["commit"]]) + " |"
              for name in order]
    lines += ["", "Held-out photos of both states beside the exported MJCF, unlit. Normals: angle "
              "between the true surface that cameras saw and the twin's, median; rough: share of "
              "it that is off by more than 20 degrees. Made by `benchmarks/looks.py`."]
    return "\n".join(lines) + "\n"


def cells(row: dict[str, Any]) -> list[str]:
    """Return the numbers of one row."""
    return [number(row.get(key), digits) for key, digits in DIGITS.items()]


if __name__ == "__main__":
    sys.exit(main())
