"""Pictures of a study: work and precision as lines, the frontier as coloured cells, both SVG."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from itertools import pairwise

import numpy as np

from part2gs_robotics.stress.cells import Cell
from part2gs_robotics.stress.precision import INTEGRATORS, Diagram

WIDE, TALL = 430, 320  # px of one panel
LEFT, RIGHT, TOP, BOTTOM = 56, 14, 34, 44  # px around its lines
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00")  # Okabe and Ito: colour-blind
STATES = {"ok": "#009e73", "inaccurate": "#e6c229", "diverged": "#c1272d"}
LOWEST, HIGHEST = -12, 0.5  # decades of error that are shown
FONT = 'font-family="sans-serif" font-size="11" fill="#333"'


def diagrams_svg(diagrams: Sequence[Diagram], own_step: float) -> str:
    """Return error over run time, one panel per motion, one line per integrator.

    Args:
        diagrams: of both motions.
        own_step: the model's time step, s; the point nearest to it has a ring.
    """
    body = "".join(_panel(d, own_step, i * WIDE) for i, d in enumerate(diagrams))
    for i, name in enumerate(INTEGRATORS):
        x = LEFT + i * 110
        body += (f'<line x1="{x}" x2="{x + 18}" y1="{TALL + 12}" y2="{TALL + 12}" stroke="'
                 f'{COLOURS[i]}" stroke-width="2"/><text x="{x + 23}" y="{TALL + 16}" {FONT}>'
                 f"{name}</text>")
    body += (f'<text x="{LEFT + 560}" y="{TALL + 16}" {FONT}>dashed: the reference; ring: own step'
             "</text>")
    return _svg(2 * WIDE, TALL + 28, body, "error against run time")


def _svg(wide: float, tall: float, body: str, label: str) -> str:
    return (f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide:g} {tall:g}" role="img" '
            f'aria-label="{escape(label)}"><rect width="{wide:g}" height="{tall:g}" fill="white"/>'
            f"{body}</svg>")


def _panel(found: Diagram, own_step: float, shift: float) -> str:
    shown = [c for c in found.cells if c.error is not None and c.error < 10**HIGHEST]
    times = np.log10([max(c.seconds, 1e-7) for c in shown] or [0.0])
    low, high = float(np.floor(times.min())), float(np.ceil(times.max()))
    high = max(high, low + 1)
    least = min([found.own_error, *(c.error or 1.0 for c in shown)])
    bottom = max(LOWEST, float(np.floor(np.log10(least))))

    def x_of(seconds: float) -> float:
        share = (np.log10(max(seconds, 1e-7)) - low) / (high - low)
        return shift + LEFT + share * (WIDE - LEFT - RIGHT)

    def y_of(error: float) -> float:
        share = (np.log10(max(error, 10.0**bottom)) - bottom) / (HIGHEST - bottom)
        return TALL - BOTTOM - share * (TALL - TOP - BOTTOM)

    body = _axes((low, high), bottom, (x_of, y_of), shift)
    for i, name in enumerate(INTEGRATORS):
        points = [(x_of(c.seconds), y_of(c.error or 0.0), c) for c in shown
                  if c.set["integrator"] == name]
        body += "".join(f'<line x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{b[0]:.1f}" y2="{b[1]:.1f}" '
                        f'stroke="{COLOURS[i]}" stroke-width="1.5"/>' for a, b in pairwise(points))
        for x, y, cell in points:
            ring = abs(np.log2(cell.set["step"] / own_step)) < 0.5
            body += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.6" fill="{COLOURS[i]}"/>'
            body += (f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5.5" fill="none" stroke="{COLOURS[i]}"'
                     "/>" if ring else "")
    y = y_of(found.own_error)
    return body + (f'<line x1="{shift + LEFT}" x2="{shift + WIDE - RIGHT}" y1="{y:.1f}" y2="{y:.1f}'
                   '" stroke="#555" stroke-dasharray="5 4"/>'
                   f'<text x="{shift + LEFT}" y="20" {FONT} font-weight="bold">{found.kind}</text>')


Place = Callable[[float], float]


def _axes(times: tuple[float, float], bottom: float, places: tuple[Place, Place], shift: float
          ) -> str:
    x_of, y_of = places
    out = ""
    for k in range(int(times[0]), int(times[1]) + 1):
        x = x_of(10.0**k)
        out += (f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{TALL - BOTTOM}" stroke="#ddd"/>'
                f'<text x="{x:.1f}" y="{TALL - BOTTOM + 15}" text-anchor="middle" {FONT}>1e{k}'
                "</text>")
    for k in range(int(bottom), 1, 2 if bottom < -6 else 1):
        y = y_of(10.0**k)
        out += (f'<line x1="{shift + LEFT}" x2="{shift + WIDE - RIGHT}" y1="{y:.1f}" y2="{y:.1f}" '
                f'stroke="#ddd"/><text x="{shift + LEFT - 6}" y="{y + 4:.1f}" text-anchor="end" '
                f"{FONT}>1e{k}</text>")
    middle = shift + (LEFT + WIDE - RIGHT) / 2
    return out + (f'<text x="{middle:.1f}" y="{TALL - 10}" text-anchor="middle" {FONT}>s of the '
                  f'processor</text><text x="{shift + 12}" y="20" {FONT}>error</text>')


def frontier_svg(studies: Mapping[str, Sequence[Cell]]) -> str:
    """Return a row of cells per study and value: green right, yellow inaccurate, red diverged."""
    body, y = "", 24.0
    for name, cells in studies.items():
        keys = [k for k in cells[0].set if k not in ("joint", "rate")] if cells else []
        first, rest = keys[-1:], keys[:-1]
        groups = list(dict.fromkeys(" ".join(_short(c.set[k]) for k in rest) for c in cells))
        for group in groups:
            row = [c for c in cells if " ".join(_short(c.set[k]) for k in rest) == group]
            values = list(dict.fromkeys(c.set[first[0]] for c in row))
            body += f'<text x="8" y="{y + 11:.0f}" {FONT}>{escape(f"{name} {group}")}</text>'
            for i, value in enumerate(values):
                body += _cell([c for c in row if c.set[first[0]] == value], value, (i, y))
            y += 17
        y += 8
    return _svg(2 * WIDE, y + 6, body, "frontier of every study")


def _cell(cells: Sequence[Cell], value: object, place: tuple[int, float]) -> str:
    worst = max((c.status for c in cells), key=list(STATES).index)
    x, y = 190 + 50 * place[0], place[1]
    return (f'<rect x="{x}" y="{y:.0f}" width="48" height="15" fill="{STATES[worst]}" '
            f'fill-opacity="0.75"/><text x="{x + 24}" y="{y + 11:.0f}" text-anchor="middle" '
            f"{FONT}>{_short(value)}</text>")


def _short(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
