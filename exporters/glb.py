"""Write twin.glb: glTF 2.0 for viewers, one node per part, pictures inside, an animation."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.exporters.dynamics import Physics, physics_of
from part2gs_robotics.exporters.inertia import link_origin, upright
from part2gs_robotics.exporters.meshfile import CREASE, png_of
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import linear_of_srgb
from part2gs_robotics.model.kinematics import children, moves
from part2gs_robotics.model.twin import Part, Twin, corner_normals
from part2gs_robotics.runtime.atomic import write_bytes_atomic

FLOAT, UNSIGNED = 5126, 5125  # component types of glTF
KEYS = 33  # of the animation: a full turn in steps of 11 degrees, between which viewers turn evenly
SECONDS = 2.0  # from state 0 to state 1, a calm hand
Node = dict[str, object]


def write_glb(twin: Twin, folder: Path) -> list[Path]:
    """Write twin.glb; return it.

    The root node turns up to +y and scales to metres, as the format wants; below it are scene
    units. Nodes of parts stand on their joint's axis and hang on the part that carries them.
    Joints, limits and masses are in the `extras` of nodes; there are no collision pieces.

    Raises:
        ExportError: if a mass cannot be computed.
    """
    writer = _Writer(twin, physics_of(twin))
    write_bytes_atomic(folder / "twin.glb", writer.data())
    return [folder / "twin.glb"]


class _Writer:
    """The tables of a glTF file while they grow, and its binary chunk."""

    def __init__(self, twin: Twin, physics: Physics) -> None:
        self.twin, self.physics = twin, physics
        self.chunk = bytearray()
        self.views: list[Node] = []
        self.accessors: list[Node] = []
        self.pictures: list[int] = []
        self.meshes: list[Node] = []
        self.materials: list[Node] = []

    def data(self) -> bytes:
        """Return the whole file."""
        twin = self.twin
        quat = se3.quat_from_rotation(upright(twin, (0.0, 1.0, 0.0)))
        root: Node = {"name": twin.name, "children": [1], "scale": [twin.meters] * 3,
                      "rotation": [*map(float, quat[1:]), float(quat[0])]}
        nodes = [root, *(self._part(index) for index in range(len(twin.parts)))]
        tree: Node = {
            "asset": {"version": "2.0", "generator": "part2gs-robotics"}, "scene": 0,
            "scenes": [{"nodes": [0]}], "nodes": nodes, "meshes": self.meshes,
            "materials": self.materials}
        if self.pictures:
            tree |= {"images": [{"bufferView": v, "mimeType": "image/png"} for v in self.pictures],
                     "textures": [{"source": i} for i in range(len(self.pictures))]}
        if any(moves(part) for part in twin.parts):
            tree["animations"] = [self._animation()]
        tree |= {"accessors": self.accessors, "bufferViews": self.views,
                 "buffers": [{"byteLength": len(self.chunk)}]}
        text = json.dumps(tree, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        body = (struct.pack("<I4s", len(text), b"JSON") + text
                + struct.pack("<I4s", len(self.chunk), b"BIN\0") + bytes(self.chunk))
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def _part(self, index: int) -> Node:
        part, props = self.twin.parts[index], self.physics.masses[index]
        up = self.twin.parts[part.parent] if part.parent >= 0 else None
        origin = link_origin(part)
        node: Node = {
            "name": part.name, "mesh": self._mesh(part),
            "translation": (origin - (link_origin(up) if up else 0.0)).tolist(),
            "extras": {"mass": props.mass, "center": (props.center - origin).tolist(),
                       "inertia": props.inertia.tolist(), **_joint_extras(part)}}
        carried = [child + 1 for child in children(self.twin, index)]
        return node | ({"children": carried} if carried else {})

    def _mesh(self, part: Part) -> int:
        """Add a part's mesh with a vertex per corner that differs; return its index."""
        mesh = part.mesh
        normals = corner_normals(mesh.vertices, mesh.faces, CREASE)
        columns = [(mesh.vertices - link_origin(part))[mesh.faces], normals.round(6)]
        if mesh.texture is None:
            columns.append(linear_of_srgb(mesh.colors / 255.0)[mesh.faces])
        else:  # from the upper left corner
            columns.append(mesh.texture.uv.astype(np.float64) * (1.0, -1.0) + (0.0, 1.0))
        rows = np.concatenate(columns, -1).astype("<f4").reshape(-1, columns[-1].shape[-1] + 6)
        raw = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1])))
        _, first, index = np.unique(raw.ravel(), return_index=True, return_inverse=True)
        points, extra = rows[first], "COLOR_0" if mesh.texture is None else "TEXCOORD_0"
        attributes = {"POSITION": self._floats(points[:, :3], 34962),
                      "NORMAL": self._floats(points[:, 3:6], 34962),
                      extra: self._floats(points[:, 6:], 34962)}
        where = self._view(index.astype("<u4").tobytes(), 34963)
        self.accessors.append({"bufferView": where, "componentType": UNSIGNED, "count": index.size,
                               "type": "SCALAR"})
        self.meshes.append({"name": part.name, "primitives": [
            {"attributes": attributes, "indices": len(self.accessors) - 1,
             "material": self._material(part)}]})
        return len(self.meshes) - 1

    def _material(self, part: Part) -> int:
        look: Node = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        if part.mesh.texture is not None:
            self.pictures.append(self._view(png_of(part.mesh.texture), None))
            look["baseColorTexture"] = {"index": len(self.pictures) - 1}
        self.materials.append({"name": f"{part.name}_color", "pbrMetallicRoughness": look})
        return len(self.materials) - 1

    def _animation(self) -> Node:
        """Return the way of every joint from state 0 to state 1."""
        share = np.linspace(0.0, 1.0, KEYS)
        time = self._floats(share * SECONDS, None)
        samplers: list[Node] = []
        channels: list[Node] = []
        for index, part in enumerate(self.twin.parts):
            if part.joint is None or not moves(part):
                continue
            up, joint = self.twin.parts[part.parent], part.joint
            rise = joint.rise if joint.turns else joint.value
            rest = link_origin(part) - link_origin(up)
            paths = {"translation": rest + share[:, None] * rise * joint.axis}
            if joint.turns:
                half = share[:, None] * joint.value / 2
                paths["rotation"] = np.concatenate([np.sin(half) * joint.axis, np.cos(half)], 1)
            for path, values in paths.items():
                samplers.append({"input": time, "output": self._floats(values, None)})
                channels.append({"sampler": len(samplers) - 1,
                                 "target": {"node": index + 1, "path": path}})
        return {"name": "state_0 to state_1", "samplers": samplers, "channels": channels}

    def _floats(self, values: F64 | NDArray[np.float32], target: int | None) -> int:
        found = np.ascontiguousarray(values, "<f4")
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[1 if found.ndim == 1
                                                              else found.shape[1]]
        low, high = np.atleast_1d(found.min(0)).tolist(), np.atleast_1d(found.max(0)).tolist()
        self.accessors.append({"bufferView": self._view(found.tobytes(), target), "type": kind,
                               "componentType": FLOAT, "count": len(found), "min": low,
                               "max": high})
        return len(self.accessors) - 1

    def _view(self, data: bytes, target: int | None) -> int:
        self.chunk += b"\0" * (-len(self.chunk) % 4)
        view: Node = {"buffer": 0, "byteOffset": len(self.chunk), "byteLength": len(data)}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.chunk += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1


def _joint_extras(part: Part) -> Node:
    """Return what glTF has no words for: how the node moves, in scene units and rad."""
    if part.joint is None:
        return {}
    joint = part.joint
    return {"joint": {"name": joint_name(part), "type": joint.kind, "axis": joint.axis.tolist(),
                      "pitch": joint.pitch, "range": list(part.limits), "state_1": joint.value}}
