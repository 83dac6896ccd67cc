"""Figure of the robustness rows: one column per thing that is varied."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from raster_figure import OURS, PLAIN, Axes, Line, Rgb, even, panel

CLEAN = ("views", 64.0)  # the row every other one differs from in one thing
PLACE = {"pose noise, deg": 0.0, "pixels": 400.0, "seed": 0.0, "exposure of state 1": 1.0,
         "shadows that move": 0.0}  # where the clean scene lies on each axis
METRICS = (("angle_deg", "axis error, deg"), ("miou", "segmentation mIoU"))
COLORS = (OURS, PLAIN, (60, 150, 40), (130, 60, 160), (120, 120, 120))


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Write the figure: one column per thing that is varied, one line per object."""
    kinds = list(dict.fromkeys(row["row"] for row in rows))
    image = np.vstack([np.hstack([chart(rows, kind, metric, title) for kind in kinds])
                       for metric, title in METRICS])
    small = cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2),
                       interpolation=cv2.INTER_AREA)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def chart(rows: list[dict[str, Any]], kind: str, metric: str, title: str) -> Rgb:
    """Return the panel of one metric over one thing."""
    lines = []
    for name, color in zip(dict.fromkeys(row["object"] for row in rows), COLORS, strict=False):
        points = curve(rows, kind, name, metric)
        if points:
            lines.append(Line(name, [x for x, _ in points], [y for _, y in points], color))
    across = sorted({x for line in lines for x in line.x}) or [0.0, 1.0]
    up = [0.0, *(y for line in lines for y in line.y)]
    ticks = [(x, f"{x:g}") for x in across]
    return panel(Axes(title, kind, ticks, even(up if max(up) > 0 else [0.0, 1.0])), lines)


def curve(rows: list[dict[str, Any]], kind: str, name: str,
          metric: str) -> list[tuple[float, float]]:
    """Return (value, metric) of one object in rising order, the clean scene among them."""
    found = {}
    for row in rows:
        clean = (row["row"], float(row["value"])) == CLEAN and kind in PLACE
        if row["object"] == name and (row["row"] == kind or clean) and row[metric] is not None:
            found[PLACE[kind] if row["row"] != kind else float(row["value"])] = row[metric]
    return sorted(found.items())
