"""Count how often `same look` tells a turned picture, and how often it doubts one that is right.

    python benchmarks/reconstruction_suite.py --kit PATH --work FOLDER
    python benchmarks/turned.py FOLDER [FOLDER ...]

Every part's picture is asked for as it is, upside down, mirrored and turned by half. Vertices are
given the colours of the right picture before, as builds give them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from part2gs_robotics.api import read_twin
from part2gs_robotics.contract.looks import looks
from part2gs_robotics.model.twin import Texture, Twin


def main() -> int:
    """Ask all twins below the folders of the command line, and print both counts."""
    files = sorted(f for work in sys.argv[1:] for f in Path(work).glob("runs/*/*/twin.yaml"))
    doubted, told = [], []
    for file in files:
        twin = painted(read_twin(file.parent))
        right = {r.subject for r in looks(file.parent, twin) if "fits" in r.detail}
        for name, wrong in turned(twin):
            subject = f"assets/{name}_texture.png"
            doubted.append(subject in right)
            told.append(subject in {r.subject for r in looks(file.parent, wrong)})
    sys.stdout.write(f"{len(files)} twins: {sum(told)} of {len(told)} turned pictures are told, "
                     f"{sum(doubted) // 3} of {len(doubted) // 3} right ones doubted\n")
    return 0


def painted(twin: Twin) -> Twin:
    """Return a twin of any version with vertices in the colours of their pictures."""
    parts = [p if (t := p.mesh.texture) is None else replace(p, mesh=p.mesh.painted(t))
             for p in twin.parts]
    return replace(twin, parts=tuple(parts))


def turned(twin: Twin) -> Iterator[tuple[str, Twin]]:
    """Yield the names of parts, and the twin with that part's picture turned one of three ways."""
    for k, part in enumerate(twin.parts):
        if (texture := part.mesh.texture) is not None:
            for image in (texture.image[::-1], texture.image[:, ::-1], texture.image[::-1, ::-1]):
                other = Texture(texture.uv, np.ascontiguousarray(image))
                changed = replace(part, mesh=replace(part.mesh, texture=other))
                yield part.name, replace(
                    twin, parts=(*twin.parts[:k], changed, *twin.parts[k + 1:]))


if __name__ == "__main__":
    sys.exit(main())
