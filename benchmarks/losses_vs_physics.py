"""Losses of the paper against physics: do they rank broken twins as exact geometry does?

Finished twins count as true. Every moving part that hangs on the base is broken in five sizes each
of: its axis tilted, itself shifted into the base, itself grown, its pivot moved (a slide: its end
value). Contact, velocity and vector-field loss, as printed and corrected, are those of the package;
beside them stand exact overlap with the base (manifold3d, nine joint values) and the place of the
part in state 1 against the true one. Reported is Spearman's rank correlation.

Run: python benchmarks/losses_vs_physics.py TWIN_FOLDER... (a second a broken twin)
Draws benchmarks/results/losses.json and docs/losses.png; `markdown` writes the table.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh
from losses_figure import draw
from losses_ranks import summary
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_manifold
from part2gs_robotics.model.twin import Part, PartMesh, Twin
from part2gs_robotics.paper import losses
from part2gs_robotics.paper.joint_terms import SWEEP, Base
from part2gs_robotics.paper.matching import match_hungarian
from part2gs_robotics.sim_checks.geometry import overlap, place

ROOT = Path(__file__).resolve().parents[1]
F64 = NDArray[np.float64]
SIZES = np.geomspace(1.0, 16.0, 5)
TILT, SHIFT, GROWTH = np.radians(0.4), 0.003, 0.006  # rad, diagonals, share; times SIZES
# Surface samples: of the base, of a part in state 0 and state 1, and for pairs; as in a build
BASE_POINTS, PART_POINTS, END_POINTS, PAIR_POINTS = 20_000, 3000, 8000, 1500
ROUNDING = 9  # digits of lengths in diagonals: what is less is no error but arithmetic
PLACES = np.linspace(0, 1, 9)  # of the joint value, where overlap is measured
SIMPLER = 5e-4  # of the diagonal: both solids simplified before their booleans


@dataclass(frozen=True)
class Case:
    """A true part and what was observed of it.

    Attributes:
        solids: base and part.  base: surfels of the base.  zero: [n, 3] points in state 0.
        one: [m, 3] points of state 1.  partners: [n, 3] nearest of `one` under the true joint.
        pairs: indices into zero and points of state 1 that eq. 2 gives them.  inward: to the base.
    """

    solids: tuple[Any, Any]
    base: Base
    joint: Joint
    zero: F64
    one: F64
    partners: F64
    pairs: tuple[NDArray[np.int64], F64]
    inward: F64
    centre: F64


def main() -> None:
    """Break the twins that are named, write numbers and figure; without any, rank anew."""
    torch.set_num_threads(1)
    stored = ROOT / "benchmarks/results/losses.json"
    rows: list[dict[str, Any]] = [] if sys.argv[1:] else json.loads(stored.read_text())["rows"]
    for folder in map(Path, sys.argv[1:]):
        rows += twin_rows(read_twin(folder), folder.name)
        sys.stderr.write(f"{folder.name}: {len(rows)} broken twins\n")
    result = {"rows": rows, "ranks": summary(rows)}
    stored.write_text(json.dumps(result, indent=0) + "\n")
    draw(result, ROOT / "docs/losses.png")


def twin_rows(twin: Twin, name: str) -> list[dict[str, Any]]:
    """Return one row per broken twin of an object."""
    corners = np.concatenate([p.mesh.vertices for p in twin.parts])
    diag = float(np.linalg.norm(np.ptp(corners, axis=0)))
    points, normals = sampled(twin.parts[0].mesh, BASE_POINTS, 0)
    base = Base(points, normals, diag)
    carriers = {p.parent for p in twin.parts}
    rows = []
    for k, part in enumerate(twin.parts[1:], 1):
        if part.joint is not None and part.parent == 0 and k not in carriers:
            case = observed(twin.parts[0], part, base)
            for kind, size, move, joint in broken(case, np.random.default_rng(k)):
                rows.append({"object": name, "part": part.name, "kind": kind,
                             "size": round(float(size), 3), **measured(case, move, joint)})
    return rows


def observed(base_part: Part, part: Part, base: Base) -> Case:
    """Return a part with points of both states, and their pairs."""
    joint, mesh = part.joint, part.mesh
    assert joint is not None
    zero, one = sampled(mesh, PART_POINTS, 1)[0], sampled(mesh, END_POINTS, 2)[0]
    one = se3.apply(joint.transform(joint.value), one)
    partners = one[cKDTree(one).query(se3.apply(joint.transform(joint.value), zero))[1]]
    still = base.points[:: BASE_POINTS // PAIR_POINTS]
    other = base.points[3 :: BASE_POINTS // PAIR_POINTS]
    ends = np.concatenate([other, one[:: END_POINTS // PAIR_POINTS]])
    pairs = match_hungarian(np.concatenate([still, zero]), ends, PAIR_POINTS)
    own = pairs[pairs[:, 0] >= len(still)]
    gap, index = base.tree.query(zero)
    seam = gap < np.quantile(gap, 0.3)
    inward = (base.points[index] - zero)[seam].sum(0)
    step = SIMPLER * base.diag
    solids = [to_manifold(m).simplify(step).as_original() for m in (base_part.mesh, mesh)]
    return Case((solids[0], solids[1]), base, joint, zero, one, partners,
                (own[:, 0] - len(still), ends[own[:, 1]]), inward / np.linalg.norm(inward),
                mesh.vertices.mean(0))


def broken(case: Case, rng: np.random.Generator) -> Iterator[tuple[str, float, F64, Joint]]:
    """Yield kind, size, motion of the geometry [4, 4] and joint of every broken twin."""
    still, joint, diag = np.eye(4), case.joint, case.base.diag
    for size in SIZES:
        side = across(joint.axis, rng)
        axis = np.cos(TILT * size) * joint.axis + np.sin(TILT * size) * side
        yield "axis tilted", size, still, replace(joint, axis=axis)
        yield "shifted", size, se3.make(np.eye(3), SHIFT * size * diag * case.inward), joint
        grown = 1.0 + GROWTH * size
        yield "grown", size, se3.make(grown * np.eye(3), (1.0 - grown) * case.centre), joint
        if joint.turns:
            moved = joint.origin + SHIFT * size * diag * across(joint.axis, rng)
            yield "pivot moved", size, still, replace(joint, origin=moved)
        else:
            end = joint.value + rng.choice([-1.0, 1.0]) * SHIFT * size * diag
            yield "end moved", size, still, replace(joint, value=end)


def measured(case: Case, move: F64, joint: Joint) -> dict[str, float]:
    """Return losses and physics of one broken twin; lengths in diagonals."""
    diag, true = case.base.diag, case.joint.transform(case.joint.value)
    zero, end = se3.apply(move, case.zero), joint.transform(joint.value)
    off = (se3.apply(end, zero) - se3.apply(true, case.zero)) / diag
    solid, volumes, depths = place(case.solids[1], move), [], []
    for share in PLACES:
        at = place(solid, joint.transform(share * joint.value)).as_original()
        found = overlap(at, case.solids[0])
        volumes.append(found.volume / diag**3)
        depths.append(0.0 if found.solid is None else depth(found.solid) / diag)
    physics = {"overlap_volume": float(np.mean(volumes)), "overlap_depth": max(depths),
               "motion": round(float(np.linalg.norm(off, axis=1).mean()), ROUNDING),
               "turn": round(float(np.sqrt(np.square(off - off.mean(0)).sum(1).mean())), ROUNDING)}
    return {key: float(f"{value:.6g}") for key, value in
            (physics | losses_of(case, zero, end, joint)).items()}


def losses_of(case: Case, zero: F64, end: F64, joint: Joint) -> dict[str, float]:
    """Return the three losses in both forms, lengths in diagonals.

    The corrected velocity loss compares pairs that were matched once, under the motion that was
    decided; the corrected vector field matches anew; the printed one takes the pairs of eq. 2.
    """
    diag = case.base.diag
    path = np.stack([se3.apply(joint.transform(s * joint.value), zero) for s in SWEEP])
    x, there, one, partners, still = (torch.from_numpy(p / diag) for p in (
        zero, path[-1], case.one, case.partners, case.base.points))
    index, mates = case.pairs
    rot, trans = torch.from_numpy(end[None, :3, :3].copy()), torch.from_numpy(end[None, :3, 3])
    ones, printed = torch.ones(len(x), 1).double(), losses.Form(paper=True)
    values = {
        "contact": losses.contact_loss(torch.from_numpy(path), sdf=case.base) / diag**2,
        "contact_printed": losses.contact_loss(there, still, paper=True),
        "velocity": losses.velocity_loss(x, partners, ones, rotations=rot),
        "velocity_printed": losses.velocity_loss(x, there, ones, paper=True),
        "vector_field": losses.vector_field_loss(x, one, rot, trans / diag, ones,
                                                 losses.Form(sigma=0.015)),
        "vector_field_printed": losses.vector_field_loss(
            x[index], torch.from_numpy(mates / diag), rot, trans / diag, ones[index], printed),
    }
    return {key: float(value) for key, value in values.items()}


def across(axis: F64, rng: np.random.Generator) -> F64:
    """Return a random unit vector at right angles to an axis."""
    side = rng.normal(size=3)
    side -= side @ axis * axis
    return np.asarray(side / np.linalg.norm(side))


def sampled(mesh: PartMesh, count: int, seed: int) -> tuple[F64, F64]:
    """Return [n, 3] points evenly spread over a surface, and their normals."""
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(solid, count, seed=seed)
    return np.asarray(points), np.asarray(solid.face_normals[faces])


if __name__ == "__main__":
    main()
