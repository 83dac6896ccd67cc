"""Inline figures of the HTML report: pictures as data URIs, curves and bars as SVG."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Place = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Curve = tuple[str, Sequence[tuple[float, float]]]

MAX_PICTURE_PX = 400  # eight pictures of this size keep the report below about 2 MB
JPEG = 92  # quality of pictures on parts: 0.27 of PNG's bytes at 45 dB, median of 84 textures
_WIDTH, _HEIGHT = 640, 260  # px of a chart at its full size
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 150, 12, 34  # px around it: numbers, curves' names, air, axis
_COLOURS = ("var(--series-1)", "var(--series-2)", "var(--series-3)", "var(--series-4)")


def png_uri(image: NDArray[np.uint8]) -> str:
    """Return a data URI of an image [H, W, 3 or 4], shrunk to at most 400 pixels a side."""
    import cv2

    scale = min(1.0, MAX_PICTURE_PX / max(image.shape[:2]))
    if scale < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    bgr = image[..., [2, 1, 0, *range(3, image.shape[-1])]]
    data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    return "data:image/png;base64," + base64.b64encode(data).decode()


def jpeg_uri(image: NDArray[np.uint8], longest: int) -> str:
    """Return a data URI of an image [H, W, 3], shrunk to at most so many pixels a side."""
    import cv2

    scale = min(1.0, longest / max(image.shape[:2]))
    if scale < 1.0:
        image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG])[1].tobytes()
    return "data:image/jpeg;base64," + base64.b64encode(data).decode()


def curve_svg(curves: Sequence[Curve], x_label: str, y_label: str) -> str:
    """Return one SVG line chart; points that are not finite are left out, "" without points."""
    clean = [(label, _finite(points)) for label, points in curves]
    clean = [(label, points) for label, points in clean if len(points)]
    if not clean:
        return ""
    both = np.concatenate([points for _, points in clean])
    x_ticks = _ticks(min(0.0, float(both[:, 0].min())), max(0.0, float(both[:, 0].max())))
    y_ticks = _ticks(float(both[:, 1].min()), float(both[:, 1].max()))
    x0, x1 = x_ticks[0], max(x_ticks[-1], float(both[:, 0].max()))
    y0, y1 = min(y_ticks[0], both[:, 1].min()), max(y_ticks[-1], both[:, 1].max())
    wide, tall = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    scale = np.array([wide / (x1 - x0), -tall / (y1 - y0)])
    origin = np.array([_LEFT, _HEIGHT - _BOTTOM])

    def place(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(origin + (points - [x0, y0]) * scale)

    body = _grid(x_ticks, y_ticks, place) + _labels(x_label, y_label)
    ends = [float(place(points)[-1, 1]) for _, points in clean]
    for i, (label, points) in enumerate(clean):
        body += _line(label, place(points), _COLOURS[i % len(_COLOURS)], _spread(ends)[i])
    box = f'viewBox="0 0 {_WIDTH} {_HEIGHT}"'
    return f'<svg {box} role="img" aria-label="{escape(y_label)}">{body}</svg>'


def bars_html(seconds: Mapping[str, float]) -> str:
    """Return horizontal bars of seconds per stage, in order; "" without stages."""
    if not seconds:
        return ""
    top = max(*seconds.values(), 1e-9)
    rows = (
        f'<div>{escape(name)}</div><div class="bar-track">'
        f'<div class="bar" style="width:{100 * value / top:.1f}%"></div></div>'
        f'<div class="bar-value">{value:.1f} s</div>'
        for name, value in seconds.items()
    )
    return f'<div class="bars">{"".join(rows)}</div>'


def _finite(points: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    array = np.asarray(points, np.float64).reshape(-1, 2)
    return array[np.isfinite(array).all(1)]


def _ticks(low: float, high: float) -> list[float]:
    """Return about five round values that span [low, high]."""
    span = max(high - low, 1e-9, 1e-3 * abs(high))
    step = 10.0 ** np.floor(np.log10(span / 4))
    step *= next(m for m in (1, 2, 5, 10) if span / (m * step) <= 5)
    first = np.floor(low / step) * step
    count = max(1, int(np.ceil((high - first) / step - 1e-9)))  # a flat curve still needs a height
    return [float(first + i * step) for i in range(count + 1)]


def _grid(xs: list[float], ys: list[float], place: Place) -> str:
    out = ""
    for y in ys:
        _, v = place(np.array([xs[0], y]))
        out += f'<line class="grid" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{v:.1f}" y2="{v:.1f}"/>'
        out += _tick(f'x="{_LEFT - 6}" y="{v + 4:.1f}"', "end", f"{y:g}")
    for x in xs:
        u, _ = place(np.array([x, ys[0]]))
        out += _tick(f'x="{u:.1f}" y="{_HEIGHT - 18}"', "middle", f"{x:g}")
    return out


def _labels(x_label: str, y_label: str) -> str:
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    centre = (_TOP + _HEIGHT - _BOTTOM) / 2
    turned = f'transform="translate(11 {centre}) rotate(-90)"'
    below = f'x="{middle}" y="{_HEIGHT - 3}"'
    return _tick(below, "middle", x_label) + _tick(turned, "middle", y_label)


def _tick(where: str, anchor: str, text: str) -> str:
    return f'<text class="tick" {where} text-anchor="{anchor}">{escape(text)}</text>'


def _spread(heights: list[float]) -> list[float]:
    """Return label heights at least 15 px apart, in the order of the line ends."""
    out = list(heights)
    order = sorted(range(len(out)), key=lambda i: out[i])
    for before, after in pairwise(order):
        out[after] = max(out[after], out[before] + 15)
    return out


def _line(label: str, points: NDArray[np.float64], colour: str, label_y: float) -> str:
    path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[-1]
    return (
        f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>'
        f'<text class="series" x="{_WIDTH - _RIGHT + 10}" y="{label_y + 4:.1f}" fill="{colour}">'
        f"{escape(label)}</text>"
    )
