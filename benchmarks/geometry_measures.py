"""How good the shape of an exported twin is: surfaces against the truth, pieces against parts."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from geometry_kit import Case, Surface, attempt, joined, module, sampled

FAR = 0.03  # of the size: surface farther from every true one is made up
SEEN = 0.015  # of the size: the kit thins what photos saw to points as far apart as that
POINTS = 60_000  # per state: a share is known to 0.1 %
ROUND = 40_000  # points of a part in a Hausdorff distance: 0.3 % of the size apart
OWN_STAGES = ("mesh", "texture", "separate")  # of a build: what is done after joints are known


def looks(case: Case, picture: Path | None = None) -> dict[str, Any]:
    """Return what look.py says of the twin, and its roughness of the true mesh."""
    look = module(case.kit, "look")
    found = dict(look.look(case.scene, case.folder / "twin.xml", case.truth, picture))
    found["rough_perfect"] = attempt(f"{case.name}: rough of the true mesh",
                                     lambda: perfect_rough(case))
    return found


def perfect_rough(case: Case) -> float:
    """Return look.py's roughness of a twin that is the true mesh."""
    with tempfile.TemporaryDirectory() as folder:
        perfect = Path(folder) / "twin.xml"
        module(case.kit, "oracle").write_oracle(case.truth, perfect)
        return float(module(case.kit, "look").crispness(case.truth, perfect)["rough"])


def made_up(case: Case) -> dict[str, float]:
    """Return the share of the twin's surface that is far from every true one, in both states.

    `far_all`: of the whole surface. `far_seen`: of the surface whose nearest true place was seen by
    some photo; what stands nearest to a place that no photo shows is left out of it.
    """
    shown = module(case.kit, "score").Twin(case.folder / "twin.xml")
    counts = np.zeros(4)
    for state in shown.states:
        own = joined([shown.mesh(k, state) for k in range(len(shown.parts) + 1)])
        kinds = range(len(case.true.parts) + 1)
        true = joined([case.true.mesh(k, state) for k in kinds])
        seen = np.concatenate([case.true.visible(k, state) for k in kinds])
        counts += far_counts(own, true, seen, case.true.diag)
    return {"far_all": counts[1] / counts[0], "far_seen": counts[3] / max(counts[2], 1.0)}


def far_counts(own: tuple[np.ndarray, np.ndarray], true: tuple[np.ndarray, np.ndarray],
               seen: np.ndarray, size: float) -> np.ndarray:
    """Return counts of points of a surface: all, far; with the nearest place seen, far of these."""
    from scipy.spatial import cKDTree

    points, _ = sampled(*own, POINTS)
    ground, _ = sampled(*true, 4 * POINTS, 1)
    distance, nearest = cKDTree(ground).query(points)
    place = ground[nearest]
    known = cKDTree(seen).query(place)[0] < SEEN * size
    far = distance > FAR * size
    return np.array([len(points), far.sum(), known.sum(), (far & known).sum()], float)


def pieces(case: Case) -> dict[str, Any]:
    """Return how the collision pieces of a twin stand for its parts."""
    from part2gs_robotics.model.solids import size_of

    parts = case.twin.parts
    size = size_of(tuple(part.mesh for part in parts))
    rows = [row for part in parts
            if (row := attempt(f"{case.name}: pieces of {part.name}",
                               lambda part=part: piece_row(part, size))) is not None]
    whole, out = sum(r["volume"] for r in rows), {
        "triangles": sum(len(part.mesh.faces) for part in parts),
        "most_pieces": max(len(part.pieces) for part in parts),
        "most_vertices": max(len(p.vertices) for part in parts for p in part.pieces),
        "all_pieces": sum(len(part.pieces) for part in parts)}
    if len(rows) < len(parts):  # of all parts or of none
        return out
    return out | {
        "phantom": sum(r["phantom"] for r in rows) / whole,
        "missing": sum(r["missing"] for r in rows) / whole,
        "most_missing": max(r["missing"] / r["volume"] for r in rows),
        "out": max(r["out"] for r in rows), "in": max(r["in"] for r in rows)}


def piece_row(part: Any, size: float) -> dict[str, float]:
    """Return volumes and distances of one part's pieces.

    `out`: farthest point of the pieces from the part; `in`: farthest of the part from them; both
    in shares of the size.
    """
    import manifold3d

    from part2gs_robotics.model.solids import bound, hull_of, to_mesh

    found = bound(part.mesh, part.pieces)
    hulls = [hull_of(piece.vertices) for piece in part.pieces]
    union = to_mesh(manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add))
    ways = [float(Surface(to.vertices, to.faces).distances(on_mesh(of)).max()) / size
            for of, to in ((union, part.mesh), (part.mesh, union))]
    return {"phantom": found.phantom, "missing": found.missing, "volume": found.volume,
            "out": ways[0], "in": ways[1]}


def on_mesh(mesh: Any) -> np.ndarray:
    """Return the corners of a mesh and points spread over it."""
    return np.concatenate([mesh.vertices, sampled(mesh.vertices, mesh.faces, ROUND)[0]])


def checked(case: Case) -> dict[str, Any]:
    """Return the deepest overlap, of the size, and the least reach that `check` reports."""
    report = case.report.get("checks") or {}
    if not report.get("checks"):
        from part2gs_robotics.sim_checks import check

        report = check(case.folder, only=("actuation", "overlap")).to_dict()
    rows = report["checks"]
    depths = [r["value"] for r in rows if r["check"] == "overlap" and r["value"] is not None]
    ways = [r["value"] for r in rows if r["check"] == "reach" and r["value"] is not None]
    return {"overlap": max(depths, default=0.0) / report["size"], "reach": min(ways, default=None),
            "check": bool(report["ok"])}


def bullet(case: Case) -> float | None:
    """Return the least reach in PyBullet with links of the twin that collide with each other."""
    from judges import bullet_reach

    return min(bullet_reach(case.folder / "twin.urdf").values(), default=None)


def seconds(case: Case) -> float:
    """Return what meshes, textures and files of the build took, by its report."""
    stages = case.report["stage_seconds"]
    return float(sum(stages.get(name, 0.0) for name in (*OWN_STAGES, "export")))


def chamfers(case: Case) -> dict[str, float | None]:
    """Return CD-s and CD-w of score.py."""
    found = {key: case.score.get(name) or {} for key, name in
             (("cd_s", "static"), ("cd_w", "whole"))}
    return {key: row.get("cd") for key, row in found.items()}


def measured(case: Case, stops: Any, picture: Path | None = None) -> dict[str, Any]:
    """Return all figures of one twin; a figure whose measure fails is left out."""
    row: dict[str, Any] = {"object": case.name}
    groups = {"look": lambda: looks(case, picture), "surface": lambda: made_up(case),
              "score": lambda: chamfers(case), "pieces": lambda: pieces(case),
              "check": lambda: checked(case), "stops": lambda: stops(case)}
    for name, group in groups.items():
        row |= attempt(f"{case.name}: {name}", group) or {}
        sys.stderr.write(f"{case.name}: {name} done\n")
    row["bullet"] = attempt(f"{case.name}: PyBullet", lambda: bullet(case))
    row["seconds"] = attempt(f"{case.name}: seconds", lambda: seconds(case))
    return row
