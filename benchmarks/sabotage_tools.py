"""Ways to change one number of a twin's files, for `sabotage.py`: each says if it found nothing."""

from __future__ import annotations

import json
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

MJCF = ("twin.xml", "twin_actuated.xml")
Deed = Callable[[Path], None]


class NotHereError(Exception):
    """The twin has nothing that this kind of sabotage could break."""


@dataclass(frozen=True)
class Kind:
    """One kind of sabotage.

    Attributes:
        name: what is done.  files: which a cause may blame.  meant: checks that look at this.
        deed: does it to a folder.
    """

    name: str
    files: tuple[str, ...]
    meant: tuple[str, ...]
    deed: Deed


def edit_xml(names: str | tuple[str, ...], change: Callable[[ET.Element], object]) -> Deed:
    """Return a deed that changes the root of every named file."""
    def deed(folder: Path) -> None:
        for name in (names,) if isinstance(names, str) else names:
            if not (folder / name).exists():
                raise NotHereError(name)
            tree = ET.parse(folder / name)
            before = ET.tostring(tree.getroot())
            change(tree.getroot())
            if ET.tostring(tree.getroot()) == before:
                raise NotHereError(f"{name}: nothing to change")
            tree.write(folder / name)
    return deed


def put(names: str | tuple[str, ...], path: str, key: str,
        value: str | Callable[[str], str]) -> Deed:
    """Return a deed that sets an attribute of the first element of a path; "*" before it: of all.

    The value may be a function of the old one; `TEXT` as the key means the element's text.
    """
    def change(root: ET.Element) -> None:
        found = root.findall(path.removeprefix("*"))
        for element in found if path.startswith("*") else found[:1]:
            old = (element.text if key == "TEXT" else element.get(key)) or ""
            new = value(old) if callable(value) else value
            if key == "TEXT":
                element.text = new
            else:
                element.set(key, new)
    return edit_xml(names, change)


def drop(names: str | tuple[str, ...], path: str) -> Deed:
    """Return a deed that removes the first element of a path; "*" before it: all of them."""
    def change(root: ET.Element) -> None:
        found = root.findall(path.removeprefix("*"))
        for element in found if path.startswith("*") else found[:1]:
            next(p for p in root.iter() if element in list(p)).remove(element)
    return edit_xml(names, change)


def insert(names: str | tuple[str, ...], path: str, text: str) -> Deed:
    """Return a deed that puts an element into the first one of a path; "." is the root."""
    return edit_xml(names, lambda root: root.findall(path)[0].append(ET.fromstring(text))
                    if root.findall(path) else None)


def times(factor: float) -> Callable[[str], str]:
    """Return a change of all numbers of an attribute by a factor."""
    return lambda text: " ".join(f"{float(w) * factor:.10g}" for w in text.split())


def plus(*shift: float) -> Callable[[str], str]:
    """Return a change of the numbers of an attribute by a shift; short ones repeat."""
    return lambda text: " ".join(f"{float(w) + shift[i % len(shift)]:.10g}"
                                 for i, w in enumerate(text.split()))


def turned(degrees: float) -> Callable[[str], str]:
    """Return a change of an axis by an angle."""
    def change(text: str) -> str:
        axis = np.array([float(w) for w in text.split()])
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        across /= np.linalg.norm(across)
        a = np.deg2rad(degrees)
        return " ".join(f"{v:.10g}" for v in np.cos(a) * axis + np.sin(a) * across)
    return change


def swapped(*order: int) -> Callable[[str], str]:
    """Return a change of the order of an attribute's numbers."""
    return lambda text: " ".join(text.split()[i] for i in order)


def tell(change: Callable[[Any], object]) -> Deed:
    """Return a deed that changes the tree of twin.yaml."""
    def deed(folder: Path) -> None:
        path = folder / "twin.yaml"
        tree = yaml.safe_load(path.read_text())
        before = json.dumps(tree, default=str)
        try:
            change(tree)
        except (IndexError, KeyError) as error:
            raise NotHereError(f"twin.yaml: {error}") from None
        if json.dumps(tree, default=str) == before:
            raise NotHereError("twin.yaml: nothing to change")
        path.write_text(yaml.safe_dump(tree, sort_keys=False))
    return deed


def told(where: str, key: str, value: object) -> Deed:
    """Return a deed on {value: ...} of the first moving part or joint, or of the whole."""
    def change(tree: Any) -> None:
        entry = tree if where == "" else tree[where][1 if where == "parts" else 0]
        old = entry[key]["value"]
        entry[key]["value"] = value(old) if callable(value) else value
    return tell(change)


def file(name: str, change: Callable[[bytes], bytes] | None) -> Deed:
    """Return a deed on the bytes of the first file that a pattern finds; None removes it."""
    def deed(folder: Path) -> None:
        found = sorted(folder.glob(name))
        if not found:
            raise NotHereError(name)
        if change is None:
            found[0].unlink()
        else:
            found[0].write_bytes(change(found[0].read_bytes()))
    return deed


def half(data: bytes) -> bytes:
    """Return the first half."""
    return data[:len(data) // 2]


def obj(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Deed:
    """Return a deed on the vertices [V, 3] of every OBJ that a pattern finds."""
    def deed(folder: Path) -> None:
        found = sorted(folder.glob(name))
        if not found:
            raise NotHereError(name)
        for path in found:
            lines = path.read_text().splitlines()
            rows = [i for i, line in enumerate(lines) if line.startswith("v ")]
            points = change(np.array([lines[i].split()[1:4] for i in rows], float))
            for i, point in zip(rows, points, strict=True):
                rest = lines[i].split()[4:]
                lines[i] = " ".join(["v", *(f"{x:.9g}" for x in point), *rest])
            path.write_text("\n".join(lines) + "\n")
    return deed


def faces(name: str, change: Callable[[list[str]], list[str]]) -> Deed:
    """Return a deed on the lines of the faces of an OBJ."""
    def on(data: bytes) -> bytes:
        lines = data.decode().splitlines()
        other = [line for line in lines if not line.startswith("f ")]
        return "\n".join(other + change([f for f in lines if f.startswith("f ")])).encode() + b"\n"
    return file(name, on)


def turn_face(line: str) -> str:
    """Return a face that looks the other way."""
    head, *corners = line.split()
    return " ".join([head, *corners[::-1]])


def glb(change: Callable[[dict[str, Any]], object]) -> Deed:
    """Return a deed on the JSON of an exported glTF."""
    def on(data: bytes) -> bytes:
        length = struct.unpack_from("<I", data, 12)[0]
        tree = json.loads(data[20:20 + length])
        change(tree)
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        rest = data[20 + length:]
        return (struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
                + struct.pack("<I4s", len(text), b"JSON") + text + rest)
    return file("glb/twin.glb", on)


def both(*deeds: Deed) -> Deed:
    """Return one deed after the other."""
    def deed(folder: Path) -> None:
        for one in deeds:
            one(folder)
    return deed
