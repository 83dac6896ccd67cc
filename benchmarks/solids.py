"""Score `part2gs-robot build` on twenty things of plain solids, and put the table into docs.

    python benchmarks/solids.py --kit PATH [--objects NAME ...]

The models are written by solids_models.py and solids_more.py; rendering and scoring are the kit's,
as in reconstruction_suite.py. Objects that are not run keep their rows.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import yaml
from reconstruction_suite import ROOT, arguments, insert, markdown, merged, run_kit, summary
from solids_models import mjcf
from solids_more import THINGS

RESULTS = ROOT / "benchmarks/results/solids.json"
PAGE = ROOT / "docs/solids.md"
BEGIN, END = "<!-- solids:begin -->", "<!-- solids:end -->"


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    args = arguments(__doc__.splitlines()[0], list(THINGS))
    if args.kit:
        with tempfile.TemporaryDirectory() as temporary:
            work = args.work or Path(temporary)
            index = write_models(work / "models")
            found = run_kit(args, work, ["--index", str(index), "--roots", str(index.parent)])
        earlier = json.loads(RESULTS.read_text())["rows"] if RESULTS.exists() else []
        result = summary(found)
        result["rows"] = merged(earlier, result["rows"])
        RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    table = markdown(json.loads(RESULTS.read_text()), "benchmarks/solids.py")
    PAGE.write_text(insert(PAGE.read_text(), table, BEGIN, END))
    sys.stdout.write(table)
    return 0


def write_models(folder: Path) -> Path:
    """Write every model and the kit's index of them; return the index."""
    entries = {}
    for name, make in THINGS.items():
        thing = make()
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "model.xml").write_text(mjcf(name, thing))
        moves = {joint: list(values) for joint, values in thing.states.items()}
        entries[name] = {"licence": "Apache-2.0", "units": "metres", "nested": thing.nested,
                         "move": moves}
    index = folder.resolve() / "index.yaml"
    index.write_text(yaml.safe_dump({"objects": entries}))
    return index


if __name__ == "__main__":
    sys.exit(main())
