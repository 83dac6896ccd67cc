"""Physical terms of Part2GS on the joints: their pull by gradient steps, and their report.

Part identities are those of the articulation room; the joint's few parameters are moved by the
gradient of the terms that are on, and the losses are reported for every part.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.paper import losses
from part2gs_robotics.paper.joint_terms import REPEL_VOXEL, SWEEP, Part, Pull, parts_of, terms_on
from part2gs_robotics.paper.repel import joint_gradient, repel_forces
from part2gs_robotics.runtime.adam import Adam, require_finite
from part2gs_robotics.runtime.side_by_side import side_by_side

if TYPE_CHECKING:
    from part2gs_robotics.evidence.study import Study

STEPS = 25  # the start is within a degree; Adam moves at most STEPS * RATE
RATE = 2e-3  # rad and diagonals per step
EPSILON = 1e-8  # Adam's own; a gradient of rounding alone moves nothing
FEWEST = 20  # points of a part per state that may pull on its joint


def physical_steps(
    study: Study, joints: list[Joint], hard: NDArray[np.int64], config: ArticulateConfig
) -> list[Joint]:
    """Return the joints after gradient steps on the terms that are on; themselves if none is.

    Args:
        study: both states.
        joints: of parts 1..K.
        hard: [N0 + N1] surfel labels.
        config: the terms, and whether as printed.

    Raises:
        FitError: a loss is NaN or infinite.
    """
    if not terms_on(config):
        return joints
    parts = parts_of(study, hard, len(joints), config.paper_mode)
    with _one_thread():
        return side_by_side([partial(_descend, *pair, k + 1, config)
                             for k, pair in enumerate(zip(parts, joints, strict=True))])


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch use one thread: handing it arrays of this size costs three times their sums."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _descend(part: Part, joint: Joint, number: int, config: ArticulateConfig) -> Joint:
    if min(len(part.zero), len(part.one)) < FEWEST:
        return joint
    scale = part.diag if joint.kind == "prismatic" else 1.0
    numbers = np.concatenate([joint.axis, joint.origin / part.diag, [joint.value / scale]])
    require_finite({"joint": numbers}, f"part {number}", 1)
    pull = Pull(part, joint, config)
    said = " and ".join(pull.terms).replace("_", " ")
    adam, best, kept = Adam({"joint": RATE}, EPSILON), np.inf, joint
    for step in range(1, STEPS + 1):
        require_finite({"joint": numbers}, f"part {number}", step)
        free = torch.tensor(numbers, requires_grad=True)
        loss = pull(free[:3], free[3:6] * part.diag, free[6] * scale)
        score = float(loss.detach())
        require_finite({said: score}, f"part {number}", step)
        if score < best:
            best, kept = score, _joint_of(joint, numbers, scale, part.diag)
        slope = torch.autograd.grad(loss, free)[0].numpy()
        adam.step({"joint": numbers}, {"joint": slope})
    return kept


def _joint_of(joint: Joint, numbers: F64, scale: float, diag: float) -> Joint:
    axis = numbers[:3] / np.linalg.norm(numbers[:3])
    origin = joint.origin if joint.kind == "prismatic" else numbers[3:6] * diag
    return replace(joint, axis=axis, origin=origin, value=float(numbers[6]) * scale)


def part_diagnostics(
    study: Study, joints: Sequence[Joint], hard: NDArray[np.int64], paper: bool
) -> tuple[tuple[dict[str, float], ...], tuple[str, ...]]:
    """Return the losses and residuals of every part, and notes on terms that were left out."""
    rows, notes = [], []
    # Pairs of eq. 2 take seconds, and nearest neighbours tell as much of a joint that is settled.
    for k, part in enumerate(parts_of(study, hard, len(joints), paper=False)):
        row = _measure(part, joints[k], paper)
        if not row["repel_points"]:
            notes.append(f"part_{k + 1}: no seam within reach of the base, repel points left out")
        rows.append(row)
    return tuple(rows), tuple(notes)


def _measure(part: Part, joint: Joint, paper: bool) -> dict[str, float]:
    zero, one, repels = part.zero, part.one, part.repels
    if min(len(zero), len(one)) == 0:
        return {"motion_residual": float("nan"), "repel_points": float(len(repels))}
    gap, index = cKDTree(one).query(se3.apply(joint.state1_from_0, zero))
    close = gap < part.tau
    weights = torch.ones(int(close.sum()), 1, dtype=torch.float64)
    path = np.stack([se3.apply(joint.transform(s * joint.value), zero) for s in SWEEP])
    contact = losses.contact_loss(torch.from_numpy(path), torch.from_numpy(part.base.points),
                                  part.base, 0.5 * part.tau, paper)
    velocity = losses.velocity_loss(torch.from_numpy(zero[close]),
                                    torch.from_numpy(one[index[close]]), weights, paper=paper)
    forces = part.diag * repel_forces(zero / part.diag, repels / part.diag, REPEL_VOXEL,
                                      paper=paper)
    return {
        "contact_loss": float(contact),
        "velocity_loss": float(velocity),
        "vector_field_loss": _field_loss(part, joint, one[index] if paper else one, paper),
        "motion_residual": float(np.median(gap)),
        "repel_points": float(len(repels)),
        "repel_gradient": joint_gradient(zero, forces, joint) if len(repels) else 0.0,
    }


def _field_loss(part: Part, joint: Joint, target: F64, paper: bool) -> float:
    """Return the vector-field loss of a part's points under its joint, against target [M, 3]."""
    move = torch.from_numpy(joint.state1_from_0[None].copy())
    ones = torch.ones(len(part.zero), 1, dtype=torch.float64)
    return float(losses.vector_field_loss(
        torch.from_numpy(part.zero), torch.from_numpy(target), move[:, :3, :3], move[:, :3, 3],
        ones, losses.Form(paper, part.tau)))
