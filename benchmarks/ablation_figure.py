"""Draw the figure of the ablation: one panel per metric, corrected and printed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from ablation_score import METRICS
from ablation_variants import ORDER, PRINTED
from numpy.typing import NDArray
from raster_figure import FONT, INK, TALL, WIDE, Axes, Color, Line, even, panel, powers

OURS, PLAIN = (200, 105, 40), (30, 100, 217)  # BGR, as in the rasteriser's figure
SOFT_OURS, SOFT_PLAIN = (240, 215, 190), (190, 210, 248)  # one line per object
CHAIN = ("vanilla", *ORDER)
TICKS = ("van", "part", "art", "rep", "field", "vel", "cont", "ours")
LEAST = 1e-3  # of a logarithmic axis
Mean = dict[tuple[str, str], dict[str, float]]  # (object, variant) -> metric -> mean of the seeds


def draw(result: dict[str, Any], path: Path) -> None:
    """Write the figure."""
    means = means_of(result)
    panels = [metric_panel(means, metric) for metric in METRICS] + [legend(result)]
    sheet = np.hstack(panels)
    small = cv2.resize(sheet, (sheet.shape[1] // 2, sheet.shape[0] // 2),
                       interpolation=cv2.INTER_AREA)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def means_of(result: dict[str, Any]) -> Mean:
    """Return the mean over seeds of every object and variant."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in result["runs"]:
        if run["parts_common"]:
            groups.setdefault((run["object"], run["variant"]), []).append(run)
    return {key: {m: float(np.mean([run[m] for run in group])) for m in METRICS}
            for key, group in groups.items()}


def metric_panel(means: Mean, metric: str) -> NDArray[np.uint8]:
    """Return the panel of one metric: a soft line per object, a full one for their mean."""
    label, larger = METRICS[metric]
    lines: list[Line] = []
    objects = sorted({name for name, _ in means})
    for suffix, soft, full in (("", SOFT_OURS, OURS), (PRINTED, SOFT_PLAIN, PLAIN)):
        names = ["vanilla", *(name + suffix for name in ORDER), *(["ours"] if not suffix else [])]
        lines += [line for o in objects if (line := _line(means, [o], names, metric, soft)).x]
        lines += [_line(means, objects, names, metric, full)]
    lines = [line for line in lines if line.x]
    values = [y for line in lines for y in line.y] or [1.0]
    ticks = [(float(k), word) for k, word in enumerate(TICKS)]
    heights = even(values) if larger else powers(values)
    title = f"{label} ({'larger' if larger else 'smaller'} is better)"
    return panel(Axes(title, "terms added from left to right", ticks, heights,
                      "" if larger else "y"), lines)


def _line(means: Mean, objects: list[str], names: list[str], metric: str, color: Color) -> Line:
    """Return the mean over objects along the variants that all of them have."""
    x = [k for k, name in enumerate(names) if all((o, name) in means for o in objects)]
    y = [max(float(np.mean([means[o, names[k]][metric] for o in objects])), LEAST) for k in x]
    return Line(metric, [float(k) for k in x], y, color)


def legend(result: dict[str, Any]) -> NDArray[np.uint8]:
    """Return a panel that names colours, objects and commit."""
    image = np.full((TALL, WIDE, 3), 255, np.uint8)
    colours = (("corrected", OURS), ("as printed", PLAIN), ("one object, corrected", SOFT_OURS),
               ("one object, as printed", SOFT_PLAIN))
    for k, (name, color) in enumerate(colours):
        cv2.line(image, (60, 120 + 60 * k), (140, 120 + 60 * k), color, 6, cv2.LINE_AA)
        cv2.putText(image, name, (165, 132 + 60 * k), FONT, 1.1, INK, 2, cv2.LINE_AA)
    words = ["van: vanilla, part: + part identities", "art: + articulation, rep: + repel points",
             "field, vel, cont: + physical losses", "ours: identities, field, contact, alignment",
             *result["options"]["objects"], f"commit {result['commit']}"]
    for k, word in enumerate(words):
        cv2.putText(image, word, (60, 390 + 38 * k), FONT, 0.8, INK, 2, cv2.LINE_AA)
    return image
