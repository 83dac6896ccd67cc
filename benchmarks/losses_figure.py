"""Draw the figure of benchmarks/losses_vs_physics.py: ranks within a part, loss against physics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from losses_ranks import WORDS
from numpy.typing import NDArray
from raster_figure import BOTTOM, LEFT, OURS, PLAIN, RIGHT, TALL, TOP, WIDE, Axes, panel
from scipy.stats import rankdata

SHOWN = (("contact", "overlap_volume"), ("velocity", "turn"), ("vector_field", "motion"))
TICKS = [(0.0, "0"), (0.5, "0.5"), (1.0, "1")]


def draw(result: dict[str, Any], path: Path) -> None:
    """Write the figure: one column per loss, corrected above, as printed below."""
    rows = [np.hstack([_scatter(result["rows"], loss, measure, form) for loss, measure in SHOWN])
            for form in ("corrected", "printed")]
    sheet = np.vstack(rows)
    small = cv2.resize(sheet, (sheet.shape[1] // 2, sheet.shape[0] // 2),
                       interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def _scatter(rows: list[dict[str, Any]], loss: str, measure: str, form: str) -> NDArray[np.uint8]:
    key = loss if form == "corrected" else f"{loss}_printed"
    image = panel(Axes(f"{loss.replace('_', ' ')} loss, {form}: rank",
                       f"rank of {WORDS[measure]}", TICKS, TICKS), [])
    for part in sorted({(r["object"], r["part"]) for r in rows}):
        own = [r for r in rows if (r["object"], r["part"]) == part]
        x, y = ((rankdata([r[k] for r in own]) - 1) / max(len(own) - 1, 1) for k in (measure, key))
        for u, v in zip(x, y, strict=True):
            at = (round(LEFT + u * (WIDE - LEFT - RIGHT)),
                  round(TALL - BOTTOM - v * (TALL - TOP - BOTTOM)))
            cv2.circle(image, at, 7, OURS if form == "corrected" else PLAIN, -1, cv2.LINE_AA)
    return image
