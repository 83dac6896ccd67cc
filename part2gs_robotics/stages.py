"""What each stage leaves in the store: results as arrays and plain data, and back."""

from __future__ import annotations

from dataclasses import asdict, fields
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.twin import Part, PartMesh, Texture
from part2gs_robotics.runtime.store import Arrays, Saved

Curve = tuple[tuple[float, float], ...]
Fitted = tuple[Gaussians, Curve, F64 | None]


def parts_of_key(state: StateViews) -> tuple[object, ...]:
    """Return what of a state's views its fit depends on."""
    depths = state.depths if state.depths is not None else np.zeros(0)
    return (state.images, state.alphas, state.Ks, state.viewmats, depths, state.held_out)


def save_fit(result: Fitted) -> Saved:
    """Return Gaussians, (seconds, held-out dB) curve and the photos' gains of one state."""
    gaussians, curve, gains = result
    arrays: Arrays = {item.name: getattr(gaussians, item.name) for item in fields(Gaussians)}
    return Saved(arrays | ({} if gains is None else {"gains": gains}),
                 {"curve": [list(point) for point in curve]})


def load_fit(saved: Saved) -> Fitted:
    """Undo `save_fit`."""
    points = cast("list[list[float]]", saved.data["curve"])
    arrays = {item.name: saved.arrays[item.name] for item in fields(Gaussians)}
    gaussians = Gaussians(**cast("dict[str, NDArray[np.float32]]", arrays))
    curve = tuple((float(t), float(db)) for t, db in points)
    return gaussians, curve, cast("F64 | None", saved.arrays.get("gains"))


def save_motion(motion: Motion) -> Saved:
    """Return part identities as arrays, joints and notes as plain data."""
    arrays: Arrays = {f"probs_{state}": probs for state, probs in enumerate(motion.part_probs)}
    return Saved(arrays, {
        "joints": [_joint_data(joint) for joint in motion.joints], "parents": list(motion.parents),
        "diagnostics": [_numbers(one) for one in motion.diagnostics], "notes": list(motion.notes),
        "seconds": _numbers(motion.seconds),
        "unbuilt": [_joint_data(joint) for joint in motion.unbuilt],
        "shades": list(motion.shades)})


def load_motion(saved: Saved) -> Motion:
    """Undo `save_motion`."""
    data = cast("dict[str, Any]", saved.data)
    arrays = cast("dict[str, NDArray[np.float32]]", saved.arrays)
    return Motion((arrays["probs_0"], arrays["probs_1"]),
                  tuple(_joint(joint) for joint in data["joints"]), tuple(data["parents"]),
                  tuple(data["diagnostics"]), tuple(data["notes"]), data["seconds"],
                  tuple(_joint(joint) for joint in data.get("unbuilt", ())),
                  tuple(data.get("shades", Motion.shades)))


def save_built(built: tuple[Motion, tuple[Part, ...]]) -> Saved:
    """Return the motion whose parts were built, and the parts."""
    motion, parts = save_motion(built[0]), save_parts(built[1])
    return Saved(motion.arrays | parts.arrays, motion.data | parts.data)


def load_built(saved: Saved) -> tuple[Motion, tuple[Part, ...]]:
    """Undo `save_built`."""
    return load_motion(saved), load_parts(saved)


def save_parts(parts: tuple[Part, ...]) -> Saved:
    """Return meshes and convex pieces as arrays, everything else as plain data."""
    arrays: Arrays = {}
    data: list[dict[str, object]] = []
    for index, part in enumerate(parts):
        meshes = (part.mesh, *part.pieces)
        for number, mesh in enumerate(meshes):
            for name in ("vertices", "faces", "colors"):
                arrays[f"{index}_{number}_{name}"] = getattr(mesh, name)
        data.append({
            "name": part.name, "parent": part.parent, "limits": list(map(float, part.limits)),
            "joint": None if part.joint is None else _joint_data(part.joint),
            "limits_source": part.limits_source, "num_gaussians": int(part.num_gaussians),
            "diagnostics": _numbers(part.diagnostics),
            "synthesised": [float(mesh.synthesised) for mesh in meshes]})
    return Saved(arrays, {"parts": data})


def load_parts(saved: Saved) -> tuple[Part, ...]:
    """Undo `save_parts`."""
    parts = []
    for index, data in enumerate(cast("list[dict[str, Any]]", saved.data["parts"])):
        meshes = [_mesh(saved.arrays, f"{index}_{number}_", share)
                  for number, share in enumerate(data["synthesised"])]
        joint = None if data["joint"] is None else _joint(data["joint"])
        low, high = data["limits"]
        parts.append(Part(data["name"], data["parent"], meshes[0], tuple(meshes[1:]), joint,
                          (low, high), data["limits_source"], data["num_gaussians"],
                          data["diagnostics"]))
    return tuple(parts)


def save_left(left: LeftOver) -> Saved:
    """Return the marks as arrays, the shares and which photos they are on as plain data."""
    arrays: Arrays = {f"marks_{state}": marks for state, marks in enumerate(left.marks)}
    return Saved(arrays, {"share": left.share, "bound": left.bound, "views": list(left.views)})


def load_left(saved: Saved) -> LeftOver:
    """Undo `save_left`."""
    data = cast("dict[str, Any]", saved.data)
    marks = cast("dict[str, NDArray[np.bool_]]", saved.arrays)
    return LeftOver(float(data["share"]), float(data["bound"]), tuple(data["views"]),
                    (marks["marks_0"], marks["marks_1"]))


def save_textures(textures: tuple[Texture, ...]) -> Saved:
    """Return uv and image of every part's texture."""
    arrays: Arrays = {f"{index}_{name}": getattr(texture, name)
                      for index, texture in enumerate(textures) for name in ("uv", "image")}
    return Saved(arrays, {"count": len(textures)})


def load_textures(saved: Saved) -> tuple[Texture, ...]:
    """Undo `save_textures`."""
    arrays = cast("dict[str, Any]", saved.arrays)
    return tuple(Texture(arrays[f"{index}_uv"], arrays[f"{index}_image"])
                 for index in range(cast(int, saved.data["count"])))


def _mesh(arrays: Arrays, prefix: str, synthesised: float) -> PartMesh:
    named = {name: arrays[prefix + name] for name in ("vertices", "faces", "colors")}
    return PartMesh(**cast("dict[str, Any]", named), synthesised=synthesised)


def _joint_data(joint: Joint) -> dict[str, object]:
    data = asdict(joint)
    plain = {key: value.tolist() if isinstance(value, np.ndarray) else value
             for key, value in data.items()}
    return plain | {"bic": _numbers(joint.bic)} | {
        key: float(value) for key, value in plain.items() if isinstance(value, np.floating)}


def _joint(data: dict[str, Any]) -> Joint:
    arrays = {key: np.array(data[key], float) for key in ("axis", "origin")}
    return Joint(**(data | arrays | {"seen": tuple(data["seen"])}))


def _numbers(values: dict[str, float]) -> dict[str, float]:
    return {key: float(value) for key, value in values.items()}
