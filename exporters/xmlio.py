"""XML out and in: one number format, no entities, atomic files."""

from __future__ import annotations

import os
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import CheckError, ExportError

MAX_XML_BYTES = 50_000_000  # a twin is some kB; MJCF with inline meshes reaches tens of MB


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


def read_xml(path: Path) -> ET.Element:
    """Parse an XML file that may be hostile: size cap, UTF-8, no DTD, no entities.

    Raises:
        CheckError: if it cannot be read or is refused.
    """
    try:
        if path.stat().st_size > MAX_XML_BYTES:
            raise CheckError(
                f"{path}: larger than {MAX_XML_BYTES // 10**6} MB. "
                "Needed a model file; keep meshes in files."
            )
        data = path.read_bytes()
    except OSError as error:
        raise CheckError(
            f"{path}: cannot be read ({error.strerror}). "
            "Needed an MJCF or URDF file; check the path."
        ) from None
    if b"\0" in data or b"<!DOCTYPE" in data.upper() or b"<!ENTITY" in data.upper():
        raise CheckError(
            f"{path}: holds a document type, an entity or NUL bytes. "
            "Needed plain UTF-8 XML; remove the DTD and save the file again."
        )
    try:
        return ET.fromstring(data.decode("utf-8"))
    except (ET.ParseError, UnicodeDecodeError, ValueError) as error:
        raise CheckError(
            f"{path}: not well-formed XML ({error}). Needed an MJCF or URDF file; check that line."
        ) from None


def write_bytes_atomic(path: Path, data: bytes) -> None:
    """Write a file so that a reader sees the old or the new one, never half."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # mkstemp makes private files
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
