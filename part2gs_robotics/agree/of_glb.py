"""An exported twin.glb in the words of `described.py`: its root's turn and scale taken back."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.agree.described import Body, Described, Drive
from part2gs_robotics.exporters.inertia import upright
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.twin import Twin

UP = (0.0, 1.0, 0.0)  # of the format
TURNED = 1e-6  # of a matrix' entries and of the scale: the file holds all digits
MOST = 1 << 30  # bytes, as of other meshes
FLOATS = 1e-5  # of the size: corners are float32
UNSIGNED = 5125  # component type of indices
Node = dict[str, object]


def of_glb(path: Path, name: str, twin: Twin) -> Described:
    """Return what a twin.glb says; it has no collision pieces.

    Args:
        path: file.
        name: of the file, from the twin folder.
        twin: whose unit and up its root must have.

    Raises:
        ValueError: if it is no such file.
    """
    try:
        tree, chunk = chunks(path)
        nodes = cast("list[Node]", tree["nodes"])
        root, bodies = nodes[0], dict[str, Body]()
        _collect(tree, chunk, (cast("list[int]", root["children"])[0], "", np.zeros(3)), bodies)
        turn = Rotation.from_quat(_vector(root.get("rotation", [0, 0, 0, 1]))).as_matrix()
        scale, shift = _vector(root.get("scale", [1, 1, 1])), _vector(
            root.get("translation", [0, 0, 0]))
    except (KeyError, IndexError, TypeError, struct.error, RecursionError, OverflowError) as error:
        raise ValueError(f"not a glTF of ours ({type(error).__name__}: {error})") from None
    off = max(float(np.abs(turn - upright(twin, UP)).max()), float(np.abs(shift).max()),
              float(np.abs(scale / twin.meters - 1).max()))
    text = (f"the root node has scale {scale.tolist()}, rotation {root.get('rotation')}, "
            f"translation {shift.tolist()}; a unit is {twin.meters:g} m and up goes to +y")
    faults = () if off <= TURNED else (("same pose", name, text,
                                        f"{name}: export it again, or correct its root node"),)
    return Described(name, bodies, FLOATS, faults)


def chunks(path: Path) -> tuple[Node, bytes]:
    """Return the tree and the buffer of a glTF in one file.

    Raises:
        ValueError: if it is no such file.
    """
    if path.stat().st_size > MOST:
        raise ValueError(f"larger than {MOST >> 20} MB")
    data = path.read_bytes()
    magic, version, _ = struct.unpack_from("<4sII", data)
    length, kind = struct.unpack_from("<I4s", data, 12)
    if magic != b"glTF" or version != 2 or kind != b"JSON" or 20 + length > len(data):
        raise ValueError("no glTF 2.0 in one whole file")
    size, _ = struct.unpack_from("<I4s", data, 20 + length)
    body = data[28 + length:28 + length + size]
    if len(body) != size:
        raise ValueError(f"{len(body)} of {size} bytes of its buffer are there")
    return cast("Node", json.loads(data[20:20 + length])), body


def _collect(tree: Node, chunk: bytes, at: tuple[int, str, F64], bodies: dict[str, Body]) -> None:
    """Add the part of a node and all it carries; at: node, its parent's name and place."""
    index, parent, base = at
    node = cast("list[Node]", tree["nodes"])[index]
    name, extras = str(node["name"]), cast("Node", node["extras"])
    if name in bodies:
        raise ValueError(f"two nodes are called {name[:60]!r}")
    place = base + _vector(node.get("translation", [0, 0, 0]))
    said = cast("Node | None", extras.get("joint"))
    drive = None
    if said is not None:
        low, high = _vector(said["range"], 2)
        kind = str(said["type"])
        drive = Drive(kind, _vector(said["axis"]), place, float(_vector([said["pitch"]], 1)[0])
                      if kind == "screw" else 0.0, (float(low), float(high)), {},
                      {"state_1": float(_vector([said["state_1"]], 1)[0])}, str(said["name"]))
    inertia = np.array([_vector(r) for r in cast("list[object]", extras["inertia"])])
    local = _positions(tree, chunk, cast(int, node["mesh"])) @ _turn(node).T
    bodies[name] = Body(name, parent, float(_vector([extras["mass"]], 1)[0]),
                        place + _vector(extras["center"]), inertia, local + place, None, drive)
    for child in cast("list[int]", node.get("children", [])):
        _collect(tree, chunk, (child, name, place), bodies)


def _turn(node: Node) -> F64:
    """Return the [3, 3] turn and scale of a node; ours have neither."""
    turn = Rotation.from_quat(_vector(node.get("rotation", [0, 0, 0, 1]), 4)).as_matrix()
    return np.asarray(turn * _vector(node.get("scale", [1, 1, 1])))


def _positions(tree: Node, chunk: bytes, mesh: int) -> F64:
    primitives = cast("list[Node]", cast("list[Node]", tree["meshes"])[mesh]["primitives"])
    which = cast("dict[str, int]", primitives[0]["attributes"])["POSITION"]
    return floats(tree, chunk, which, 3)


def floats(tree: Node, chunk: bytes, which: int, width: int) -> F64:
    """Return the [N, width] numbers of an accessor as ours are: packed floats or indices.

    Args:
        tree: of the file.
        chunk: its buffer.
        which: index of the accessor.
        width: numbers per row.
    """
    accessor = cast("list[dict[str, int]]", tree["accessors"])[which]
    view = cast("list[dict[str, int]]", tree["bufferViews"])[accessor["bufferView"]]
    kind = "<u4" if accessor["componentType"] == UNSIGNED else "<f4"
    found = np.frombuffer(chunk, kind, width * accessor["count"], view["byteOffset"])
    return found.reshape(-1, width).astype(np.float64)


def _vector(value: object, size: int = 0) -> F64:
    found = np.asarray(cast("Sequence[float]", value), np.float64)
    if found.ndim != 1 or len(found) not in ((size,) if size else (3, 4)) or not np.isfinite(
            found).all():
        raise ValueError(f"{str(value)[:60]} where numbers are needed")
    return found
