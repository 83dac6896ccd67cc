"""XML out: one number format, atomic files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ExportError
from part2gs_robotics.runtime.atomic import write_bytes_atomic

DIGITS = 10  # of the largest in a vector; 6 turn an axis by 7e-7, and a chain by more than 1e-6


def number(value: float) -> str:
    """Return a finite number with 10 digits, `-0` as `0`.

    What places a part or says what it weighs keeps them: six would move the end of a chain by
    more than 1e-6 of the size. What is assumed has six from the start (`dynamics.ASSUMED_DIGITS`).

    Raises:
        ExportError: for NaN or infinity, which MuJoCo reads without an error.
    """
    if not np.isfinite(value):
        raise ExportError(
            f"a number of the twin is {value}. "
            "Needed finite numbers; look at the joints in report.json."
        )
    return f"{float(value) + 0.0:.{DIGITS}g}"


def numbers(values: Iterable[float] | NDArray[np.float64]) -> str:
    """Return numbers separated by blanks, with the decimals of the largest one's last digit.

    What is smaller is rounding: an axis of 1e-17 beside 1 is written 0.
    """
    vector = [float(v) for v in values]
    largest = max((abs(v) for v in vector if np.isfinite(v)), default=0.0)
    if largest > 0:
        decimals = DIGITS - 1 - int(np.floor(np.log10(largest)))
        vector = [round(v, decimals) for v in vector]
    return " ".join(number(v) for v in vector)


def add(parent: ET.Element, tag: str, **attributes: str | float | Iterable[float]) -> ET.Element:
    """Append a child with attributes in the given order; `_` at the end of a key is dropped."""
    return ET.SubElement(parent, tag, {k.rstrip("_"): _text(v) for k, v in attributes.items()})


def _text(value: str | float | Iterable[float]) -> str:
    if isinstance(value, str):
        return value
    return number(value) if isinstance(value, (int, float, np.floating)) else numbers(value)


def write_xml(root: ET.Element, path: Path) -> Path:
    """Write an element tree with two-space indent, atomically; return the path."""
    ET.indent(root, "  ")
    write_bytes_atomic(path, ET.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n")
    return path
