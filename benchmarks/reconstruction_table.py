"""The table of error against run time: medians over the objects, worst ones beside."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np

Rows = list[dict[str, Any]]
HEAD = (
    "preset", "share of steps", "seconds, median (worst)", "parts and types right", "axis, deg",
    "position, %", "turn, deg", "slide, units", "CD-s [floor]", "CD-m [floor]", "CD-w [floor]",
    "mIoU, mean (worst)", "PSNR, dB", "peak MB",
)  # fmt: skip


def markdown(result: dict[str, Any]) -> str:
    """Return the table and one line on how it was made."""
    groups = grouped(result["rows"])
    lines = ["| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    lines += ["| " + " | ".join(cells(*group)) + " |" for group in groups.items()]
    return "\n".join([*lines, "", caption(result)]) + "\n"


def grouped(rows: Rows) -> dict[tuple[str, str, float], Rows]:
    """Return rows by (device, preset, share), in the order of run time."""
    order = {"draft": 0, "standard": 1, "high": 2}
    found: dict[tuple[str, str, float], Rows] = {}
    for row in rows:
        found.setdefault((row["device"], row["preset"], row["share"]), []).append(row)
    return dict(sorted(found.items(), key=lambda item: (
        item[0][0], order.get(item[0][1], len(order)), item[0][2])))


def comparable(rows: Rows) -> Rows:
    """Return the rows of objects that were built with every share of their preset and device.

    A curve over other objects at every point would show the objects.
    """
    shares: dict[tuple[str, str], dict[str, set[float]]] = {}
    for row in rows:
        of = shares.setdefault((row["device"], row["preset"]), {})
        of.setdefault(row["object"], set()).add(row["share"])
    most = {key: max(map(len, of.values())) for key, of in shares.items()}
    return [row for row in rows if len(shares[row["device"], row["preset"]][row["object"]])
            == most[row["device"], row["preset"]]]


def cells(group: tuple[str, str, float], rows: Rows) -> list[str]:
    """Return the texts of one table row."""
    device, preset, share = group
    right = sum(complete(row) for row in rows)
    return [
        preset if device == "cpu" else f"{preset}, {device}", str(Fraction(share)),
        spread(values(rows, "seconds"), 0), f"{right} of {len(rows)}",
        *(spread(values(rows, key), digits) for key, digits in
          (("angle_deg", 2), ("line_pct", 2), ("motion_deg", 2), ("motion_units", 4))),
        *(floored(rows, key) for key in ("cd_s", "cd_m", "cd_w")),
        _miou(values(rows, "miou")), _middle(values(rows, "psnr_db"), 1),
        number(max(values(rows, "peak_mb"), default=None), 0),
    ]


def caption(result: dict[str, Any]) -> str:
    """Return what the table shows and how it was made."""
    options = result["options"]
    objects = count(len({row["object"] for row in result["rows"]}), "object")
    return (
        f"Medians over {objects}, or as many as a row says, the worst one in brackets; of the "
        "parts found; "
        "Chamfer in 1000 x squared units with the kit's sampling floor beside. "
        f"{options['views']} + {options['views']} RGB views of {options['size']} x "
        f"{options['size']} pixels, nothing given; {result['machine']}; commit {result['commit']}, "
        f"{result['date']}; `benchmarks/reconstruction.py`.")


def count(number: int, word: str) -> str:
    """Return a number with its noun."""
    return f"{number} {word}{'' if number == 1 else 's'}"


def complete(row: dict[str, Any]) -> bool:
    """Return whether exactly the true parts were found, with the right joints."""
    return bool(row["parts_found"] == row["types_right"] == row["parts_true"]
                and not row["parts_extra"])


def values(rows: Rows, key: str) -> list[float]:
    """Return what is known of a key."""
    return [float(row[key]) for row in rows if row.get(key) is not None]


def spread(numbers: list[float], digits: int) -> str:
    """Return the median and, of several, the worst in brackets."""
    worst = f" ({max(numbers):.{digits}f})" if len(numbers) > 1 else ""
    return _middle(numbers, digits) + worst


def floored(rows: Rows, key: str) -> str:
    """Return the medians of a Chamfer distance and of its floor."""
    return f"{_middle(values(rows, key), 2)} [{_middle(values(rows, f'{key}_floor'), 2)}]"


def number(value: float | None, digits: int) -> str:
    """Return a rounded number, or - where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def _middle(numbers: Iterable[float], digits: int) -> str:
    found = list(numbers)
    return number(float(np.median(found)) if found else None, digits)


def _miou(numbers: list[float]) -> str:
    return f"{np.mean(numbers):.3f} ({min(numbers):.3f})" if numbers else "-"
