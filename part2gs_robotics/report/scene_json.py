"""The twin as the page draws it: parts, joints, meshes and Gaussians as plain JSON.

Lengths are scene units from `centre`, so that float32 keeps its digits far from the origin.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import at_state_1, facing, moves, up_of
from part2gs_robotics.model.twin import Part, PartMesh, Twin
from part2gs_robotics.report.data import Picture, ReportData
from part2gs_robotics.report.figures import jpeg_uri

MOST_SPLATS = 20_000  # of all parts; 19 bytes each: half a megabyte of text, smooth on a phone
SOLID = 0.5  # opacity: discs are drawn solid, and what is clearer than not would hide what is there
TEXTURE_PX = 2048  # longest side of a picture on a part: what WebGL 2 promises of every phone


def scene_json(data: ReportData) -> dict[str, object]:
    """Return what viewer.js reads.

    `parts`, parents before children: name, parent (-1 = world), joint (kind, axis, origin, pitch,
    limits, state_1; null = none), surface, pieces, splats. Arrays are base64, little-endian:
    points float32 xyz, faces uint32, uv uint16 and colors uint8 of full range 1.
    """
    twin = data.twin
    box = _both_states(twin)
    centre = box.mean(0)
    splats = _shares(data.splats)
    up = up_of(twin)
    return {
        "name": twin.name, "centre": centre.tolist(), "up": up.tolist(),
        "size": float(np.linalg.norm(box[1] - box[0])),
        "floor": _lowest(twin, up, centre), "facing": facing(twin).tolist(),
        "parts": [_part(part, centre, splats[i] if i < len(splats) else None)
                  for i, part in enumerate(twin.parts)],
        "cameras": [_camera(picture, centre) for picture in data.pictures],
    }


def _both_states(twin: Twin) -> F64:
    """Return [2, 3] the box around the twin in both states."""
    every = np.concatenate([*(part.mesh.vertices for part in twin.parts), *at_state_1(twin)])
    return np.array([every.min(0), every.max(0)])


def _lowest(twin: Twin, up: F64, centre: F64) -> float:
    """Return how far along `up` the lowest corner of both states lies."""
    every = [*(part.mesh.vertices for part in twin.parts), *at_state_1(twin)]
    return min(float(((points - centre) @ up).min()) for points in every)


def _part(part: Part, centre: F64, splats: Gaussians | None) -> dict[str, object]:
    return {
        "name": part.name, "parent": part.parent,
        "joint": _joint(part.joint, part.limits, centre) if part.joint and moves(part) else None,
        "surface": _surface(part.mesh, centre),
        "pieces": [{"points": _floats(piece.vertices - centre), "faces": _faces(piece.faces)}
                   for piece in part.pieces],
        "splats": None if splats is None or not len(splats) else _points(splats, centre),
    }


def _joint(joint: Joint, limits: tuple[float, float], centre: F64) -> dict[str, object]:
    return {"kind": joint.kind, "axis": joint.axis.tolist(),
            "origin": (joint.origin - centre).tolist(), "pitch": float(joint.pitch),
            "limits": [float(limit) for limit in limits], "state_1": float(joint.value)}


def _surface(mesh: PartMesh, centre: F64) -> dict[str, object]:
    """Return a mesh with one point per corner that differs in place or in the picture."""
    points = mesh.vertices - centre
    if mesh.texture is None:
        return {"points": _floats(points), "faces": _faces(mesh.faces),
                "colors": _text(mesh.colors.astype(np.uint8))}
    uv = np.rint(np.clip(mesh.texture.uv, 0, 1) * 65535).astype("<u2").reshape(-1, 2)
    corner = np.concatenate([mesh.faces.reshape(-1, 1), uv], 1)
    keys = (corner[:, 0] << 32) | (corner[:, 1] << 16) | corner[:, 2]
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    return {"points": _floats(points[corner[first, 0]]), "faces": _faces(index.reshape(-1, 3)),
            "uv": _text(uv[first]), "image": jpeg_uri(mesh.texture.image, TEXTURE_PX)}


def _shares(parts: Sequence[Gaussians]) -> list[Gaussians]:
    """Return the solid Gaussians that cover most, at most MOST_SPLATS of all parts together."""
    if not parts:
        return []
    parts = [part.select(part.opacities > SOLID) for part in parts]
    cover = [_radius(part) ** 2 * part.opacities for part in parts]
    every = np.sort(np.concatenate(cover))
    least = every[-MOST_SPLATS] if len(every) > MOST_SPLATS else -1.0
    return [part.select(own >= least) for part, own in zip(parts, cover, strict=True)]


def _radius(gaussians: Gaussians) -> NDArray[np.float32]:
    """Return [N] the middle of the three deviations: half as wide as a flat disc looks."""
    return np.asarray(np.sort(gaussians.scales, 1)[:, 1], np.float32)


def _points(splats: Gaussians, centre: F64) -> dict[str, object]:
    colors = np.rint(np.clip(splats.colors, 0, 1) * 255).astype(np.uint8)
    return {"points": _floats(splats.means - centre), "radius": _floats(_radius(splats)),
            "colors": _text(colors)}


def _camera(picture: Picture, centre: F64) -> dict[str, object] | None:
    """Return eye, unit direction ahead and vertical field of view (degrees) of a photo."""
    pose = picture.world_from_camera
    if pose is None:
        return None
    return {"eye": (pose[:3, 3] - centre).tolist(), "ahead": pose[:3, 2].tolist(),
            "fov": float(np.degrees(picture.fov)), "state": picture.state}


def _floats(values: NDArray[np.floating]) -> str:
    return _text(np.asarray(values, "<f4"))


def _faces(faces: NDArray[np.int64]) -> str:
    return _text(faces.astype("<u4"))


def _text(values: NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
