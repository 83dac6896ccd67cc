"""XML out: one number format, atomic files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ExportError
from part2gs_robotics.runtime.atomic import write_bytes_atomic


def number(value: float) -> str:
    """Return a finite number with 12 digits (round trip below 1e-11), `-0` as `0`.

    Raises:
        ExportError: for NaN or infinity, which MuJoCo reads without an error.
    """
    if not np.isfinite(value):
        raise ExportError(
            f"a number of the twin is {value}. "
            "Needed finite numbers; look at the joints in report.json."
        )
    return f"{float(value) + 0.0:.12g}"


def numbers(values: Iterable[float] | NDArray[np.float64]) -> str:
    """Return numbers separated by blanks."""
    return " ".join(number(float(v)) for v in values)


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
