"""Score `part2gs-robot build` on twenty things of plain solids, and put the table into docs.

    python benchmarks/solids.py --kit PATH [--objects NAME ...]

The models are written by solids_models.py and solids_more.py; rendering and scoring are the kit's,
as in reconstruction_suite.py. Objects that are not run keep their rows.
"""

from __future__ import annotations

import sys
from pathlib import Path

import yaml
from reconstruction_suite import ROOT, score_own
from solids_models import mjcf
from solids_more import THINGS


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    def flags(work: Path) -> list[str]:
        index = write_models(work / "models")
        return ["--index", str(index), "--roots", str(index.parent)]

    return score_own(__doc__.splitlines()[0], list(THINGS), "benchmarks/solids.py",
                     ROOT / "docs/solids.md", flags)


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
