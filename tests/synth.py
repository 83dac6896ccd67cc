"""Toy twins with known answers: a cabinet of exact boxes, for trials and tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin

if TYPE_CHECKING:
    from manifold3d import Manifold

Corner = tuple[float, float, float]
SIZE = (0.5, 0.6, 0.8)  # depth x, width y, height z of the cabinet, metres
WALL = 0.018  # furniture board
SHELF = 0.4  # height of the board between the two bays


def box(low: Corner, high: Corner) -> Manifold:
    """Return the axis-aligned box between two corners."""
    import manifold3d

    size = [h - a for a, h in zip(low, high, strict=True)]
    return manifold3d.Manifold.cube(size).translate(list(low))


def toy_cabinet_twin(moving: int = 2, *, clearance: float = 0.003, refine: float = 0.0) -> Twin:
    """Return a cabinet (z up, front +x) with 1..4 moving parts and exact pieces.

    Parts: drawer (prismatic), door (revolute), lever on the door (revolute, nested), cap (screw).

    Args:
        moving: how many of them, in that order.
        clearance: gap between neighbours, scene units (metres).
        refine: longest edge of the visual meshes; 0 keeps the coarse boxes.
    """
    makers = (_drawer, _door, _lever, _cap)[:moving]
    parts = (_base(), *(make(clearance) for make in makers))
    if refine > 0:
        parts = tuple(replace(p, mesh=_refined(p.mesh, refine)) for p in parts)
    return Twin("toy_cabinet", parts, meters_per_unit=1.0, up=np.array([0.0, 0.0, 1.0]))


def lumpy_cabinet(deep: float) -> Twin:
    """Return a cabinet whose drawer meets a lump of its bay, `deep` units, on its way out only."""
    from part2gs_robotics.model.solids import to_manifold

    twin = toy_cabinet_twin(1)
    lump = box((0.48, WALL - 0.001, 0.1), (0.495, WALL + 0.003 + deep, 0.14))
    # where the lump is in state 0, the drawer has a notch
    drawer = to_manifold(twin.parts[1].mesh) - box((0.45, 0.0, 0.05), (0.6, 0.1, 0.2))
    base = to_manifold(twin.parts[0].mesh) + lump
    return replace(twin, parts=(replace(twin.parts[0], mesh=to_mesh(base)),
                                replace(twin.parts[1], mesh=to_mesh(drawer))))


def scaled(twin: Twin, factor: float) -> Twin:
    """Return the same object in a unit `factor` times smaller."""
    parts = []
    for part in twin.parts:
        joint, limits = part.joint, part.limits
        if joint is not None:
            slide = factor if joint.kind == "prismatic" else 1.0
            joint = replace(joint, origin=joint.origin * factor,
                                        value=joint.value * slide, pitch=joint.pitch * factor)
            limits = (limits[0] * slide, limits[1] * slide)
        mesh = replace(part.mesh, vertices=part.mesh.vertices * factor)
        pieces = tuple(replace(p, vertices=p.vertices * factor) for p in part.pieces)
        parts.append(replace(part, mesh=mesh, pieces=pieces, joint=joint,
                                         limits=limits))
    return replace(twin, parts=tuple(parts), meters_per_unit=1 / factor)


def union_part(
    name: str,
    parent: int,
    boxes: list[tuple[Corner, Corner]],
    joint: Joint | None,
    limits: tuple[float, float],
    color: tuple[int, int, int],
) -> Part:
    """Return a part that is the union of boxes, each box one convex piece."""
    import manifold3d

    solids = [box(low, high) for low, high in boxes]
    whole = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    pieces = tuple(to_mesh(s, color) for s in solids)
    return Part(
        name,
        parent,
        to_mesh(whole, color),
        pieces,
        joint,
        limits,
        num_gaussians=1000,
        diagnostics={"contact_loss": 0.0, "vector_field_loss": 1e-4, "motion_residual": 1e-3},
    )


def _refined(mesh: PartMesh, length: float) -> PartMesh:
    from part2gs_robotics.model.solids import to_manifold

    color = tuple(int(c) for c in mesh.colors[0])
    return to_mesh(to_manifold(mesh).refine_to_length(length), (color[0], color[1], color[2]))


def _base() -> Part:
    x, y, z = SIZE
    w, s = WALL, SHELF
    boxes: list[tuple[Corner, Corner]] = [
        ((0, 0, 0), (w, y, z)),
        ((w, 0, 0), (x, w, z)),
        ((w, y - w, 0), (x, y, z)),
        ((w, w, 0), (x, y - w, w)),
        ((w, w, s - w / 2), (x, y - w, s + w / 2)),
        ((w, w, z - w), (x, y - w, z)),
    ]
    return union_part("base", -1, boxes, None, (0.0, 0.0), (180, 140, 100))


def _drawer(gap: float) -> Part:
    x, y, _ = SIZE
    low, high, t = (
        (WALL + gap, WALL + gap, WALL + gap),
        (x, y - WALL - gap, SHELF - WALL / 2 - gap),
        0.012,
    )
    (x0, y0, z0), (x1, y1, z1) = low, high
    boxes: list[tuple[Corner, Corner]] = [
        (low, (x1, y1, z0 + t)),
        ((x0, y0, z0 + t), (x0 + t, y1, z1)),
        ((x1 - t, y0, z0 + t), (x1, y1, z1)),
        ((x0 + t, y0, z0 + t), (x1 - t, y0 + t, z1)),
        ((x0 + t, y1 - t, z0 + t), (x1 - t, y1, z1)),
    ]
    joint = Joint(
        "prismatic",
        np.array([1.0, 0, 0]),
        np.array([x / 2, y / 2, z1 / 2]),
        0.3,
        sigma_axis=1e-3,
        sigma_origin=1e-3,
        sigma_value=1e-3,
        bic={"fixed": 90.0, "prismatic": 10.0},
        confidence=0.99,
    )
    return union_part("part_1", 0, boxes, joint, (0.0, 0.3), (200, 60, 40))


def _door(gap: float) -> Part:
    x, y, z = SIZE
    boxes: list[tuple[Corner, Corner]] = [((x + gap, 0, SHELF), (x + gap + WALL, y, z))]
    joint = Joint("revolute", np.array([0, 0, -1.0]), np.array([x + gap, 0, SHELF]), 1.2)
    return union_part("part_2", 0, boxes, joint, (0.0, 1.5), (40, 80, 200))


def handled_twin() -> Twin:
    """Return the cabinet with bows of boxes to pull: upright on its door, level on its drawer."""
    twin = toy_cabinet_twin(2)
    x, door = SIZE[0], SIZE[0] + 0.003 + WALL  # the fronts
    upright = [((door - 0.001, 0.53, low), (door + 0.04, 0.55, low + 0.02)) for low in (0.5, 0.68)]
    level = [((x - 0.001, low, 0.2), (x + 0.04, low + 0.02, 0.22)) for low in (0.2, 0.38)]
    bows = {1: [*level, ((x + 0.025, 0.2, 0.2), (x + 0.04, 0.4, 0.22))],
            2: [*upright, ((door + 0.025, 0.53, 0.5), (door + 0.04, 0.55, 0.7))]}
    return replace(twin, parts=tuple(_with_boxes(part, bows.get(index, []))
                                     for index, part in enumerate(twin.parts)))


def _with_boxes(part: Part, boxes: list[tuple[Corner, Corner]]) -> Part:
    import manifold3d

    from part2gs_robotics.model.solids import to_manifold

    color = part.mesh.colors[0].tolist()
    solids = [box(low, high) for low, high in boxes]
    whole = manifold3d.Manifold.batch_boolean([to_manifold(part.mesh), *solids],
                                              manifold3d.OpType.Add)
    return replace(part, mesh=to_mesh(whole, color),
                   pieces=(*part.pieces, *(to_mesh(solid, color) for solid in solids)))


def _lever(gap: float) -> Part:
    front = SIZE[0] + gap + WALL + gap
    centre = np.array([front, 0.5, 0.6])
    boxes: list[tuple[Corner, Corner]] = [((front, 0.49, 0.5), (front + 0.02, 0.51, 0.62))]
    joint = Joint("revolute", np.array([1.0, 0, 0]), centre, 0.5)
    return union_part("part_3", 2, boxes, joint, (0.0, 0.5), (60, 60, 60))


def _cap(gap: float) -> Part:
    top = SIZE[2] + gap
    boxes: list[tuple[Corner, Corner]] = [((0.2, 0.25, top), (0.3, 0.35, top + 0.03))]
    joint = Joint("screw", np.array([0, 0, 1.0]), np.array([0.25, 0.3, top]), 2.0, pitch=0.01)
    return union_part("part_4", 0, boxes, joint, (0.0, 2.0), (90, 170, 90))


def write_all(twin: Twin, folder: Path) -> Path:
    """Write a twin and all its exports; return its folder."""
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
    from part2gs_robotics.exporters.urdf import write_urdf
    from part2gs_robotics.outputs import export_twin

    folder.mkdir(parents=True)
    for write in (write_mjcf, write_urdf, write_twin_yaml):
        write(twin, folder)
    for kind in ("sdf", "glb", "usd"):
        export_twin(folder, kind, folder / kind)
    return folder


def put(path: str, value: object) -> Callable[[dict], None]:  # type: ignore[type-arg]
    """Return what sets a value of a tree, by its way such as "parts.0.name"."""
    def change(tree: dict) -> None:  # type: ignore[type-arg]
        *way, last = path.split(".")
        for key in way:
            tree = tree[int(key) if key.isdigit() else key]
        tree[int(last) if last.isdigit() else last] = value
    return change
