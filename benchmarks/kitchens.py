"""Score `part2gs-robot build` on kitchen cabinets out of a third simulator.

    git clone https://github.com/chernyadev/bigym
    BIGYM=bigym python benchmarks/kitchens.py --kit PATH [--objects NAME ...]

bigym (Apache-2.0) holds one cabinet with all that it can be filled with; every object here is what
one kitchen would have of it: look-alike drawers, a door before a shelf, two doors on a wall.
Rendering and scoring are the kit's, as in reconstruction_suite.py. Objects that are not run keep
their rows.
"""

from __future__ import annotations

import os
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import yaml
from reconstruction_suite import ROOT, score_own

PLACE = "bigym/envs/xmls/props/kitchen"
BASE, WALL = "base_cabinet_600.xml", "wall_cabinet_600.xml"
FRAME = {"walls", "counter", "shelf_bottom"}  # what every cabinet has
# Name: model, what else the cabinet has that stands still, and per joint (named as its body) its
# value in both states (rad or metres).
OBJECTS: dict[str, tuple[str, set[str], dict[str, tuple[float, float]]]] = {
    "big_two_drawers": (BASE, {"hob"}, {"drawer_big_1": (0.0, 0.22), "drawer_big_2": (0.01, 0.15)}),
    "four_drawers": (BASE, set(), {
        "drawer_small_1": (0.0, 0.25), "drawer_small_2": (0.01, 0.12),
        "drawer_small_3": (0.0, 0.19), "drawer_small_4": (0.0, 0.3)}),
    "mixed_drawers": (BASE, {"hob"}, {
        "drawer_small_1": (0.0, 0.27), "drawer_small_2": (0.0, 0.18), "drawer_big_2": (0.01, 0.1)}),
    "door_shelf": (BASE, {"shelf"}, {"door_left": (0.05, 1.2)}),
    "wall_two_doors": (WALL, {"shelf"}, {"door_right": (0.05, 1.1), "door_left": (0.1, 0.8)}),
}


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    def flags(work: Path) -> list[str]:
        index = write_objects(work / "models")
        return ["--index", str(index), "--roots", str(index.parent)]

    return score_own(__doc__.splitlines()[0], list(OBJECTS), "benchmarks/kitchens.py",
                     ROOT / "docs/kitchens.md", flags)


def write_objects(folder: Path) -> Path:
    """Write every object's model and the kit's index of them; return the index."""
    entries = {}
    for name, (model, still, states) in OBJECTS.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "model.xml").write_text(cabinet(source() / model, still | set(states)))
        moves = {joint: list(values) for joint, values in states.items()}
        entries[name] = {"licence": "Apache-2.0", "units": "metres", "move": moves}
    index = folder.resolve() / "index.yaml"
    index.write_text(yaml.safe_dump({"objects": entries}))
    return index


def source() -> Path:
    """Return the folder of bigym's kitchen models."""
    place = Path(os.environ.get("BIGYM", "bigym")) / PLACE
    if not place.is_dir():
        raise SystemExit(f"BIGYM: no {PLACE} in {os.environ.get('BIGYM', 'bigym')!r}. Expected a "
                         "checkout of github.com/chernyadev/bigym")
    return place.resolve()


def cabinet(model: Path, wanted: set[str]) -> str:
    """Return MJCF of a cabinet with what is wanted in it, drawn whole, and nothing else."""
    root = ET.parse(model).getroot()
    compiler, cabinet = root.find("compiler"), root.find("worldbody/body")
    assert compiler is not None, model
    assert cabinet is not None, model
    for kind in ("meshdir", "texturedir"):
        compiler.set(kind, str(model.parent / compiler.get(kind, ".")))
    lifted = [one for one in cabinet.findall("body") if one.get("name", "").endswith("_offset")]
    host = lifted[0] if lifted else cabinet  # a wall cabinet hangs in a body of its own
    for body in host.findall("body"):
        if body.get("name") not in wanted | FRAME:
            host.remove(body)
    for body in list(root.iter("body")):
        for shape in [one for one in body.findall("geom") if one.get("class") == "collision"]:
            body.remove(shape)
        for shape in body.findall("geom"):  # the kit draws what touches nothing, if there is any
            shape.set("contype", "0")
            shape.set("conaffinity", "0")
    return ET.tostring(root, encoding="unicode")


if __name__ == "__main__":
    sys.exit(main())
