"""Score a motion without meshing, with the surface metrics of an external benchmark kit.

A part's surface is what its opaque Gaussians cover: a rectangle per Gaussian, one standard
deviation to each side along its two longest axes. Gaussians of both states are brought together by
the part's joint, as meshing does, so an error of the joint shows as a doubled surface.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from averaged_field import canonical_field
from numpy.typing import NDArray

from part2gs_robotics.model import se3
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.kinematics import part_motions
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.se3 import rotation_from_quats

F64 = NDArray[np.float64]
Mesh = tuple[F64, NDArray[np.int64]]
OPAQUE = 0.5  # as in the study: fainter Gaussians are haze
SAMPLES = 10_000  # per surface, as in the kit's Chamfer distance
# name -> (label, larger is better)
METRICS = {
    "axis_deg": ("axis, deg", False), "motion_pct": ("motion, % of diagonal", False),
    "cd_m": ("CD-m x 1000", False), "miou": ("mIoU", True),
}  # fmt: skip


def kit_of(folder: Path) -> ModuleType:
    """Return the kit's `score` module; the kit may be read-only."""
    sys.dont_write_bytecode = True
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))
    return importlib.import_module("score")


class GaussianTwin:
    """A motion and its Gaussians with the face of the kit's twins: parts, states, mesh(k, s)."""

    states = (0, 1)

    def __init__(self, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                 sources: tuple[int, ...] = (0, 1)) -> None:
        self.parts = [{"name": f"part_{k}", "type": joint.kind, "axis": joint.axis,
                       "point": joint.origin, "motion": joint.value}
                      for k, joint in enumerate(motion.joints, 1)]
        moves = part_motions(motion.joints, motion.parents)
        labels = [motion.labels(s) for s in (0, 1)]
        self._meshes = {}
        for k, move in enumerate(moves):
            own = [_rectangles(gaussians[s], (labels[s] == k) & (s in sources)) for s in (0, 1)]
            self._meshes[k, 0] = np.concatenate([own[0], _moved(se3.inverse(move), own[1])])
            self._meshes[k, 1] = np.concatenate([_moved(move, own[0]), own[1]])

    def mesh(self, k: int, s: int) -> Mesh:
        """Return vertices [4 n, 3] and faces [2 n, 3] of part k (0 = base) in state s."""
        corners = self._meshes[k, s]
        halves = np.array([[0, 1, 2], [0, 2, 3]])
        faces = 4 * np.arange(len(corners))[:, None, None] + halves
        return corners.reshape(-1, 3), faces.reshape(-1, 3)


def _rectangles(gaussians: Gaussians, chosen: NDArray[np.bool_]) -> F64:
    """Return [n, 4, 3] corners of the chosen opaque Gaussians' rectangles."""
    rows = np.flatnonzero(chosen & (gaussians.opacities > OPAQUE))
    axes = rotation_from_quats(gaussians.quats[rows].astype(np.float64))
    scales = gaussians.scales[rows].astype(np.float64)
    order = np.argsort(-scales, axis=1)
    side = [np.take_along_axis(axes, order[:, None, i : i + 1], 2)[..., 0]
            * np.take_along_axis(scales, order[:, i : i + 1], 1) for i in (0, 1)]
    centre = gaussians.means[rows].astype(np.float64)
    return np.stack([centre - side[0] - side[1], centre + side[0] - side[1],
                     centre + side[0] + side[1], centre - side[0] + side[1]], 1)


def _moved(move: F64, corners: F64) -> F64:
    return np.asarray(se3.apply(move, corners.reshape(-1, 3))).reshape(corners.shape)


def scored(kit: ModuleType, truth: Any, gaussians: tuple[Gaussians, Gaussians],
           motion: Motion, sources: tuple[int, ...] = (0, 1)) -> dict[str, Any]:
    """Return the errors of a motion: one row per true part, and mIoU of the Gaussians' labels.

    Args:
        kit: the kit's `score` module.
        truth: its `GroundTruth` of the scene.
        gaussians: of both states.
        motion: joints and part identities.
        sources: states whose Gaussians are the surface.
    """
    twin = GaussianTwin(gaussians, motion, sources)
    pairs = kit.match(twin, truth)
    rows = []
    for k, true in enumerate(truth.parts, 1):
        row: dict[str, Any] = {"part": true["name"], "found": k in pairs}
        if k in pairs:
            centroid = kit.sample_surface(*truth.mesh(k, 0), 5000, 0).mean(0)
            errors = kit.joint_errors(twin.parts[pairs[k] - 1], true, centroid, truth.diag)
            move = part_motions(motion.joints, motion.parents)[pairs[k]]
            row |= {"type_ok": errors["type_ok"], "axis_deg": errors["angle_deg"],
                    "line_pct": errors["line_pct"], "motion_deg": errors["motion_deg"],
                    "motion_units": errors["motion_units"],
                    "motion_pct": motion_error(kit, truth, k, move),
                    "cd_m": chamfer_seen(kit, truth, k, twin, pairs[k])}
        rows.append(row)
    return {"parts": rows, "parts_found": len(pairs), "parts_extra": len(twin.parts) - len(pairs),
            "miou": kit.segmentation(twin, truth, pairs)["miou"]}


def averaged(gaussians: tuple[Gaussians, Gaussians],
             ) -> tuple[tuple[Gaussians, Gaussians], tuple[int, ...]]:
    """Return Gaussians with the leading state's centres averaged (eq. 3), and that state."""
    field = canonical_field(*gaussians, paper_mode=True)
    both = list(gaussians)
    both[field.reference_state] = field.gaussians[0]
    return (both[0], both[1]), (field.reference_state,)


def motion_error(kit: ModuleType, truth: Any, part: int, move: F64) -> float:
    """Return how far beside its true place a motion carries the part's surface, % of diagonal.

    Mean over the true surface; turns and slides, axis, position and value in one number.

    Args:
        kit: the kit's `score` module.
        truth: its `GroundTruth` of the scene.
        part: true part.
        move: [4, 4] from state 0 to state 1 in the world, parents' motions included.
    """
    zero, one = truth.mesh(part, 0)[0], truth.mesh(part, 1)[0]
    points = kit.sample_surface(*truth.mesh(part, 0), SAMPLES, 0)
    there = se3.apply(best_motion(zero, one), points)
    found = se3.apply(move, points)
    return float(100 * np.linalg.norm(found - there, axis=1).mean() / truth.diag)


def best_motion(zero: F64, one: F64) -> F64:
    """Return the [4, 4] rigid motion that carries points [n, 3] onto theirs (Kabsch)."""
    c0, c1 = zero.mean(0), one.mean(0)
    u, _, vt = np.linalg.svd((one - c1).T @ (zero - c0))
    turn = (u * [1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return se3.make(turn, c1 - turn @ c0)


def chamfer_seen(kit: ModuleType, truth: Any, part: int, twin: GaussianTwin, own: int) -> float:
    """Return the kit's Chamfer distance against what cameras saw of the part, mean of both states.

    Hidden faces are left out: splats do not show them, and meshing is not part of this.
    """
    values = []
    for s in (0, 1):
        seen = truth.visible(part, s)
        seen = seen[np.random.default_rng(0).permutation(len(seen))[:SAMPLES]]
        values.append(sum(kit.chamfer(kit.sample_surface(*twin.mesh(own, s), SAMPLES, 0), seen)))
    return float(np.mean(values))
