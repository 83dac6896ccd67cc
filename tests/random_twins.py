"""Random twins of boxes: chains, screws, odd names, every up, scales from 1e-3 to 1e3."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin

NAMES = ["base", "Tür links", "<a & b>", "part 1", "部品", "", "world", "x\"'y", "Über/..",
         "9 lives", "a_turn", "a", "A", "q" * 300, "\x07bell", "part_1"]  # fmt: skip
UPS = [None, (0, 0, 1.0), (0, 1.0, 0), (0, -1.0, 0), (0, 0, -1.0), (1.0, 0, 0), (0.6, 0, 0.8)]


def random_box(rng: np.random.Generator, scale: float, middle: np.ndarray) -> PartMesh:
    import manifold3d

    size = rng.uniform(0.1, 0.6, 3) * scale
    turn = Rotation.random(random_state=int(rng.integers(1 << 31))).as_matrix()
    place = np.concatenate([turn, middle[:, None]], 1)
    mesh = to_mesh(manifold3d.Manifold.cube(size, True).transform(place),
                   tuple(int(c) for c in rng.integers(0, 256, 3)))
    if rng.random() < 0.3:
        image = rng.integers(0, 256, (4, 8, 3), dtype=np.uint8)
        uv = rng.random((len(mesh.faces), 3, 2)).astype(np.float32)
        mesh = PartMesh(mesh.vertices, mesh.faces, mesh.colors, 0.25, Texture(uv, image))
    return mesh


def random_joint(rng: np.random.Generator, scale: float, near: np.ndarray) -> Joint:
    kind = rng.choice(["revolute", "prismatic", "screw", "fixed"], p=[0.4, 0.3, 0.2, 0.1])
    axis = rng.normal(size=3)
    if rng.random() < 0.4:  # straight ones, where frames of joints degenerate
        axis = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    axis /= np.linalg.norm(axis)
    value = rng.uniform(-3, 3) if kind in ("revolute", "screw") else rng.uniform(-1, 1) * scale
    pitch = rng.uniform(-0.2, 0.2) * scale if kind == "screw" else 0.0
    return Joint(str(kind), axis, near + rng.normal(size=3) * 0.3 * scale,
                 0.0 if kind == "fixed" else float(value), pitch)


def random_twin(seed: int) -> Twin:
    """Return one twin of 1 to 6 parts; seeds go through the scales."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-3, 3)
    middle = rng.normal(size=3) * scale
    parts = [Part(NAMES[rng.integers(len(NAMES))], -1, random_box(rng, scale, middle), (), None)]
    for _ in range(rng.integers(0, 6)):
        at = middle + rng.normal(size=3) * 0.5 * scale
        mesh = random_box(rng, scale, at)
        joint = random_joint(rng, scale, at)
        more = np.sort([0.0, joint.value]) + np.array([-0.1, 0.2]) * abs(joint.value)
        parts.append(Part(NAMES[rng.integers(len(NAMES))], int(rng.integers(len(parts))), mesh,
                          (PartMesh(mesh.vertices, mesh.faces, mesh.colors),), joint,
                          (float(more[0]), float(more[1])), "derived"))
    up = UPS[rng.integers(len(UPS))]
    known = rng.random() < 0.7
    unit = float(rng.uniform(0.2, 2.0) / scale)
    return Twin(NAMES[rng.integers(len(NAMES))], tuple(parts), unit if known else None,
                None if up is None else np.array(up), assumed_meters=1.0 if known else unit,
                material="900" if rng.random() < 0.5 else None)
