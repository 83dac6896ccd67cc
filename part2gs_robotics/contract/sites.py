"""The sites that robosuite reads an object's size from, against the meshes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.exporters.mjcf import size_sites
from part2gs_robotics.model.twin import Twin

CLOSE = 1e-6  # of the coordinates: files have ten digits


def sites(folder: Path, twin: Twin) -> list[CheckResult]:
    """Return sites that are lacking or elsewhere than the meshes say, or one row that passes.

    Args:
        folder: of the twin.
        twin: of its twin.yaml and meshes.
    """
    wanted, out = size_sites(twin), []
    far = CLOSE * max(1e-300, *(float(np.abs(p).max()) for p in wanted.values()))
    for file in ("twin.xml", "twin_actuated.xml"):
        try:
            root = ET.parse(folder / file).getroot()
            found = {s.get("name", ""): np.array([float(w) for w in s.get("pos", "").split()])
                     for s in root.iter("site")}
        except (OSError, ET.ParseError, ValueError):
            continue  # other rows say so
        for name, place in wanted.items():
            own = found.get(name)
            if own is None or own.shape != (3,) or not np.abs(own - place).max() <= far:
                out.append(fails("own settings", f"{file}: {name}", f"the site is at {own}, the "
                                 f"meshes put it at {place.round(6)}",
                                 f"{file}: give {name} pos {place.round(9).tolist()}"))
    return out[:4] or [passes("own settings", "sites", "tell the size of the meshes")]
