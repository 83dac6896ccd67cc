"""Draw error against run time from the JSON of benchmarks/reconstruction.py.

python benchmarks/reconstruction_figure.py benchmarks/results/reconstruction.json docs/out.png
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from raster_figure import FONT, INK, TALL, WIDE, Axes, Line, even, panel, powers
from reconstruction_table import comparable, complete, count, grouped

Rows = list[dict[str, Any]]
Rgb = NDArray[np.uint8]
COLORS = {"draft": (60, 150, 40), "standard": (200, 105, 40), "high": (30, 100, 217)}  # BGR
OTHER = (120, 120, 120)
PALE = 0.45  # of a colour's way to white: the same preset on CUDA
LEAST = {"angle_deg": 1e-3, "line_pct": 1e-3, "motion_deg": 1e-3}  # what is less is drawn there


def draw(result: dict[str, Any], path: Path) -> None:
    """Write the figure: six errors over run time, PSNR over the time of one build, a legend."""
    result = result | {"rows": comparable(result["rows"])}
    groups = grouped(result["rows"])
    panels = [error(groups, title, pick) for title, pick in ERRORS]
    sheet = [*panels, psnr(groups), legend(groups, result)]
    rows = [np.hstack(sheet[k:k + 4]) for k in range(0, len(sheet), 4)]
    image = np.vstack(rows)
    small = cv2.resize(image, (image.shape[1] // 2, image.shape[0] // 2),
                       interpolation=cv2.INTER_AREA)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def missed(key: str) -> Callable[[dict[str, Any]], float | None]:
    """Return how to read an error that charges parts that were not found."""
    def pick(row: dict[str, Any]) -> float | None:
        value = row["missed"].get(key)
        return None if value is None else max(float(value), LEAST.get(key, 1e-6))
    return pick


def _miou(row: dict[str, Any]) -> float | None:
    return None if row["miou"] is None else max(1.0 - float(row["miou"]), 1e-3)


def _wrong(row: dict[str, Any]) -> float:
    return 0.0 if complete(row) else 100.0


ERRORS: tuple[tuple[str, Callable[[dict[str, Any]], float | None]], ...] = (
    ("axis error, deg", missed("angle_deg")), ("position error, % of diagonal", missed("line_pct")),
    ("error of the turn, deg", missed("motion_deg")),
    ("CD-m, 1000 x squared units", missed("cd")), ("1 - mIoU", _miou),
    ("objects not complete, %", _wrong),
)


def error(groups: dict[tuple[str, str, float], Rows], title: str,
          pick: Callable[[dict[str, Any]], float | None]) -> Rgb:
    """Return the panel of one error: medians over the objects, quartiles as a band.

    Shares of objects are means, on a linear axis.
    """
    share = pick is _wrong
    lines = []
    for device, preset in dict.fromkeys(group[:2] for group in groups):
        x, y, band = [], [], []
        for group, rows in groups.items():
            found = [value for value in map(pick, rows) if value is not None]
            if group[:2] == (device, preset) and found:
                low, middle, high = np.quantile(found, (0.25, 0.5, 0.75))
                x.append(float(np.median([row["seconds"] for row in rows])))
                y.append(float(np.mean(found)) if share else float(middle))
                band.append((float(low), float(high)))
        if x:
            lines.append(Line(preset, x, y, color(preset, device), () if share else band))
    return _panel(title, lines, "x" if share else "xy")


def psnr(groups: dict[tuple[str, str, float], Rows]) -> Rgb:
    """Return the panel of held-out PSNR over the time of both fits, within one whole build."""
    lines = []
    for (device, preset, share), rows in groups.items():
        curves = [row["curve"] for row in rows if share == 1.0 and row["curve"]]
        if not curves:
            continue
        marks = min(map(len, curves))
        middle = np.median([one[:marks] for one in curves], 0)
        middle[:, 0] = np.maximum(middle[:, 0], 0.1)  # seconds: a logarithm has no zero
        lines.append(Line(preset, middle[:, 0].tolist(), middle[:, 1].tolist(),
                          color(preset, device)))
    return _panel("held-out PSNR within one build, dB", lines, "x", "seconds of both fits")


def legend(groups: dict[tuple[str, str, float], Rows], result: dict[str, Any]) -> Rgb:
    """Return a panel that names colours, machine and commit."""
    image = np.full((TALL, WIDE, 3), 255, np.uint8)
    for k, (device, preset) in enumerate(dict.fromkeys(group[:2] for group in groups)):
        cv2.line(image, (60, 110 + 60 * k), (140, 110 + 60 * k), color(preset, device), 6,
                 cv2.LINE_AA)
        _write(image, preset if device == "cpu" else f"{preset}, {device}", (165, 122 + 60 * k))
    objects = count(len({row["object"] for row in result["rows"]}), "object")
    words = [f"medians over up to {objects}, bands: quartiles", "missed parts are charged",
             "points: 1/16 to 1 of a preset's steps", result["machine"],
             f"commit {result['commit']}"]
    for k, word in enumerate(words):
        _write(image, word, (60, 440 + 42 * k), 0.8)
    return image


def color(preset: str, device: str) -> tuple[int, int, int]:
    """Return the colour of a preset, paler on CUDA."""
    b, g, r = COLORS.get(preset, OTHER)
    if device == "cpu":
        return b, g, r
    return tuple(round(v + PALE * (255 - v)) for v in (b, g, r))  # type: ignore[return-value]


def _panel(title: str, lines: Sequence[Line], log: str, label: str = "seconds of the build") -> Rgb:
    if not lines:
        return panel(Axes(f"{title}: none", label, [(0.0, "0"), (1.0, "1")],
                          [(0.0, "0"), (1.0, "1")], ""), [])
    x = [v for line in lines for v in line.x]
    y = [v for line in lines for v in (*line.y, *(b for pair in line.band for b in pair))]
    return panel(Axes(title, label, powers(x), powers(y) if "y" in log else even(y), log), lines)


def _write(image: Rgb, word: str, where: tuple[int, int], scale: float = 1.1) -> None:
    cv2.putText(image, word, where, FONT, scale, INK, 2, cv2.LINE_AA)


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
