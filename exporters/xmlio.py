"""XML out: one number format, atomic files. YAML of strangers in: never nested without end."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ExportError
from part2gs_robotics.runtime.atomic import write_bytes_atomic

if TYPE_CHECKING:
    import yaml

DIGITS = 10  # of the largest in a vector; 6 turn an axis by 7e-7, and a chain by more than 1e-6
MOST_DEEP = 100  # of entries in entries; a twin has six
MOST_NODES = 1_000_000  # entries; a twin of a hundred parts has twenty thousand


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


def parsed_yaml(text: str) -> object:
    """Return the tree of a YAML text, by libyaml where PyYAML has it: ten times as fast.

    Raises:
        YAMLError: the text is none, or its aliases make more of it than MOST_NODES.
    """
    import yaml

    kind, depth = getattr(yaml, "CSafeLoader", yaml.SafeLoader), 0
    for event in yaml.parse(text, Loader=kind):  # libyaml's own tree is built by recursion in C
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MOST_DEEP:
            raise yaml.YAMLError(f"nested more than {MOST_DEEP} deep")
    loader = kind(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        if _expanded(node, {}) > MOST_NODES:
            raise yaml.YAMLError(f"aliases make more than {MOST_NODES} entries of it")
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _expanded(node: yaml.Node, known: dict[int, float]) -> float:
    """Return how many entries a node has once every alias is written out; inf for a ring."""
    if id(node) not in known:
        known[id(node)] = float("inf")  # met again while it is counted: a ring
        kids = node.value if isinstance(node.value, list) else []
        flat = [k for kid in kids for k in (kid if isinstance(kid, tuple) else (kid,))]
        known[id(node)] = 1.0 + sum(_expanded(k, known) for k in flat)
    return known[id(node)]
