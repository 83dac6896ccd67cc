"""Draw the figure of benchmarks/raster.py from its JSON.

python benchmarks/raster_figure.py benchmarks/results/raster.json docs/raster.png
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Rgb = NDArray[np.uint8]
F64 = NDArray[np.float64]
Color = tuple[int, int, int]

WIDE, TALL = 800, 680  # a panel, drawn at twice its size for smooth lines and text
LEFT, RIGHT, TOP, BOTTOM = 110, 60, 80, 100
INK, FAINT, PAPER = (40, 34, 27), (225, 225, 225), (255, 255, 255)  # BGR
OURS, PLAIN, OURS_1, PLAIN_1 = (200, 105, 40), (30, 100, 217), (235, 180, 130), (120, 175, 245)
BOTH = "forward + backward, ms"
FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True)
class Line:
    """A named curve; band [N, 2] holds its quartiles."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    color: Color
    band: Sequence[tuple[float, float]] = ()


@dataclass(frozen=True)
class Axes:
    """Title, label and ticks (position, text) of a panel; log says which axes are logarithmic."""

    title: str
    x_label: str
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    log: str = ""


def draw(result: dict[str, Any], path: Path) -> None:
    """Write the figure of a full run."""
    curves = result["growth"]
    panels = [cases(result)]
    panels += [grown(curves["gaussians"], "gaussians", f"{BOTH}: 400 x 400", "Gaussians"),
               grown(curves["pixels"], "size", f"{BOTH}: 30k Gaussians", "image side, pixels"),
               grown(curves["views"], "views", "ms per view: 30k Gaussians, 256 x 256", "views")]
    panels += [fit(name, kernels) for name, kernels in result["fits"].items()]
    panels += [legend(result)]
    panels += [np.full_like(panels[0], 255)] * (-len(panels) % 4)
    rows = [np.hstack(panels[k:k + 4]) for k in range(0, len(panels), 4)]
    sheet = np.vstack(rows)
    small = cv2.resize(sheet, (sheet.shape[1] // 2, sheet.shape[0] // 2),
                       interpolation=cv2.INTER_AREA)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def cases(result: dict[str, Any]) -> Rgb:
    """Return the panel of the four cases on one and two threads."""
    lines = []
    for threads, ours, plain in (("1", OURS_1, PLAIN_1), ("2", OURS, PLAIN)):
        rows = result["by_threads"].get(threads, {}).get("cases", [])
        lines += [_line(rows, None, "total_ms", ours), _line(rows, None, "naive_total_ms", plain)]
    names = [(float(k), f"{row['gaussians'] // 1000}k, {row['size']}")
             for k, row in enumerate(result["cases"])]
    lines = [line for line in lines if line.x]
    return panel(Axes(f"{BOTH}: four cases", "Gaussians, image side in pixels", names,
                      powers([y for line in lines for y in line.y]), "y"), lines)


def grown(rows: list[dict[str, Any]], key: str, title: str, label: str) -> Rgb:
    """Return the panel of one growth curve, both axes logarithmic."""
    lines = [_line(rows, key, "ms", OURS), _line(rows, key, "naive_ms", PLAIN)]
    ticks = [(float(row[key]), short(row[key])) for row in rows]
    return panel(Axes(title, label, ticks,
                      powers([y for line in lines for y in line.y]), "xy"), lines)


def fit(name: str, kernels: dict[str, list[list[float]]]) -> Rgb:
    """Return the panel of one object's held-out PSNR over seconds."""
    lines = [Line(kernel, [p[0] for p in kernels[kernel]], [p[1] for p in kernels[kernel]], color)
             for kernel, color in (("ours", OURS), ("naive", PLAIN))]
    x, y = ([v for line in lines for v in values] for values in ((0.0, *lines[0].x, *lines[1].x),
                                                                (*lines[0].y, *lines[1].y)))
    return panel(Axes(f"{name}: held-out PSNR, dB", "seconds", even(x), even(y)), lines)


def legend(result: dict[str, Any]) -> Rgb:
    """Return a panel that names the colours, the machine and the commit."""
    image = np.full((TALL, WIDE, 3), 255, np.uint8)
    names = (("our kernel", OURS), ("our kernel, 1 thread", OURS_1), ("plain kernel", PLAIN),
             ("plain kernel, 1 thread", PLAIN_1))
    for k, (name, color) in enumerate(names):
        cv2.line(image, (60, 150 + 60 * k), (140, 150 + 60 * k), color, 6, cv2.LINE_AA)
        _text(image, name, (165, 162 + 60 * k), 1.1)
    words = [*result["machine"].split(", "), f"{result['threads']} threads",
             f"commit {result['commit']}", "medians; bands: quartiles"]
    for k, word in enumerate(words):
        _text(image, word, (60, 420 + 42 * k), 0.85)
    return image


def panel(axes: Axes, lines: Sequence[Line]) -> Rgb:
    """Return one line chart."""
    image = np.full((TALL, WIDE, 3), 255, np.uint8)
    xs = [t for t, _ in axes.x_ticks] + [x for line in lines for x in line.x]
    ys = [t for t, _ in axes.y_ticks] + [y for line in lines for y in line.y]

    def place(x: Sequence[float], y: Sequence[float]) -> NDArray[np.int32]:
        u = LEFT + _share(x, xs, "x" in axes.log) * (WIDE - LEFT - RIGHT)
        v = TALL - BOTTOM - _share(y, ys, "y" in axes.log) * (TALL - TOP - BOTTOM)
        return np.rint(np.stack([u, v], 1)).astype(np.int32)

    for value, word in axes.y_ticks:
        height = int(place([xs[0]], [value])[0, 1])
        cv2.line(image, (LEFT, height), (WIDE - RIGHT, height), FAINT, 2)
        _text(image, word, (LEFT - 14, height + 10), 0.8, align=1.0)
    for value, word in axes.x_ticks:
        across = int(place([value], [ys[0]])[0, 0])
        _text(image, word, (across, TALL - BOTTOM + 38), 0.75, align=0.5)
    for line in lines:
        _draw_line(image, line, place)
    _text(image, axes.title, (LEFT, TOP - 28), 1.0)
    _text(image, axes.x_label, ((LEFT + WIDE - RIGHT) // 2, TALL - 22), 0.85, align=0.5)
    return image


def _draw_line(image: Rgb, line: Line, place: Any) -> None:
    points = place(line.x, line.y)
    if line.band:
        low, high = (place(line.x, [pair[k] for pair in line.band]) for k in (0, 1))
        shade = image.copy()
        cv2.fillPoly(shade, [np.concatenate([low, high[::-1]])], line.color)
        image[:] = cv2.addWeighted(image, 0.75, shade, 0.25, 0)
    cv2.polylines(image, [points], False, line.color, 5, cv2.LINE_AA)
    for x, y in points:
        cv2.circle(image, (int(x), int(y)), 8, line.color, -1, cv2.LINE_AA)


def _line(rows: list[dict[str, Any]], key: str | None, name: str, color: Color) -> Line:
    band = [(row["spread"][name]["q1"], row["spread"][name]["q3"]) for row in rows]
    x = [float(k if key is None else row[key]) for k, row in enumerate(rows)]
    return Line(name, x, [row[name] for row in rows], color, band)


def _share(values: Sequence[float], everything: Sequence[float], log: bool) -> F64:
    """Return where values lie between the smallest and the largest of everything, 0 to 1."""
    scale = np.log10 if log else np.asarray
    low, high = scale(min(everything)), scale(max(everything))
    return np.asarray((scale(np.asarray(values, float)) - low) / max(high - low, 1e-9))


def powers(values: Sequence[float]) -> list[tuple[float, str]]:
    """Return 1, 2, 5 x powers of ten that span positive values."""
    steps = [m * 10.0**e for e in range(-3, 6) for m in (1, 2, 5)]
    low = max((s for s in steps if s <= min(values)), default=steps[0])
    high = min((s for s in steps if s >= max(values)), default=steps[-1])
    inside = [s for s in steps if low <= s <= high]
    return [(s, f"{s:g}") for s in inside[::max(1, len(inside) // 7)]]


def even(values: Sequence[float]) -> list[tuple[float, str]]:
    """Return about five round values that span the values."""
    span = max(max(values) - min(values), 1e-9)
    step = next(m * 10.0**e for e in range(-9, 9) for m in (1, 2, 5) if span / (m * 10.0**e) <= 5)
    first, last = np.floor(min(values) / step), np.ceil(max(values) / step)
    return [(float(k * step), f"{k * step:g}") for k in np.arange(first, last + 1)]


def short(number: float) -> str:
    """Return a number with k for thousands."""
    return f"{number / 1000:g}k" if number >= 1000 and number % 1000 == 0 else f"{number:g}"


def _text(image: Rgb, word: str, where: tuple[int, int], scale: float, align: float = 0.0) -> None:
    (width, _), _ = cv2.getTextSize(word, FONT, scale, 2)
    start = (where[0] - round(align * width), where[1])
    cv2.putText(image, word, start, FONT, scale, INK, 2, cv2.LINE_AA)


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
