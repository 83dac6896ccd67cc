"""Physical terms of Part2GS on the joints: contact, velocity, vector field and repel points.

Part identities and matches are those of the articulation room; the joint's few parameters are
moved by the gradient of the losses, and the losses are reported for every part.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from part2gs_robotics import losses, se3
from part2gs_robotics.fit_step import require_finite
from part2gs_robotics.joint_fit import move_of
from part2gs_robotics.joints import Joint
from part2gs_robotics.repel import joint_gradient, repel_forces, repel_points

if TYPE_CHECKING:
    from part2gs_robotics.study import Study

F64 = NDArray[np.float64]
SAMPLE = 1500  # points per part and state: the losses are means, 3 % noise, 20 ms a step
STEPS = 25  # the start is within a degree; Adam moves at most STEPS * RATE
RATE = 2e-3  # rad and diagonals per step
PHYS_WEIGHT = 0.1  # method.md 1.5: start value of lambda_phys
BESIDE = 0.01  # of the diagonal: a surfel speaks for the surface this far beside it
SWEEP = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the joint value at which contact is asked


class _Base:
    """Signed distance to the static part: offset from the nearest surfel along its normal."""

    def __init__(self, points: F64, normals: F64, diag: float) -> None:
        self.points, self.normals, self.diag = points, normals, diag
        self.tree = cKDTree(points)

    def __call__(self, points: torch.Tensor) -> torch.Tensor:
        if len(self.points) == 0:  # no static surface was seen: nothing to touch
            return torch.full_like(points[..., 0], torch.inf)
        _, index = self.tree.query(points.detach().numpy())
        gap = points - torch.from_numpy(self.points[index])
        along = (gap * torch.from_numpy(self.normals[index])).sum(-1)
        # Far along the tangent the plane of one surfel says nothing: call it free.
        near = 3.0 * along.detach().abs() + BESIDE * self.diag
        far = gap.detach().norm(dim=-1) > near
        return torch.where(far, along.abs(), along)


def physical_steps(
    study: Study, joints: list[Joint], hard: NDArray[np.int64], paper: bool
) -> list[Joint]:
    """Return the joints after gradient steps on the articulation, vector-field and physical losses.

    Args:
        study: both states.
        joints: of parts 1..K.
        hard: [N0 + N1] surfel labels.
        paper: losses as printed.

    Raises:
        FitError: a loss is NaN or infinite.
    """
    return [_descend(study, joint, k + 1, hard, paper) for k, joint in enumerate(joints)]


def _clouds(study: Study, part: int, hard: NDArray[np.int64]) -> tuple[F64, F64, _Base]:
    n0 = len(study.surfels[0])
    labels = hard[:n0], hard[n0:]
    clouds = []
    for s in (0, 1):
        own = study.surfels[s].points[labels[s] == part]
        clouds.append(own[:: max(1, len(own) // SAMPLE)])
    base = study.surfels[0].select(labels[0] == 0)
    return clouds[0], clouds[1], _Base(base.points, base.normals, study.diag)


def _descend(study: Study, joint: Joint, part: int, hard: NDArray[np.int64], paper: bool) -> Joint:
    zero, one, base = _clouds(study, part, hard)
    if len(zero) < 20 or len(one) < 20:  # too little seen of the part in one state to pull on it
        return joint
    start = torch.from_numpy(np.concatenate([joint.axis, joint.origin / study.diag]))
    scale = 1.0 if joint.kind == "revolute" else study.diag
    free = start.clone().requires_grad_(True)
    value = torch.tensor(joint.value / scale, dtype=torch.float64, requires_grad=True)
    adam = torch.optim.Adam([free, value], lr=RATE)
    first, best, kept = np.inf, np.inf, joint
    for step in range(1, STEPS + 1):
        numbers = np.append(free.detach().numpy(), value.detach().numpy())
        require_finite({"joint": numbers}, f"part {part}", step)
        loss = _loss(joint, free, value * scale, (zero, one), base, study, paper)
        score = float(loss.detach())
        require_finite({"vector field and contact": score}, f"part {part}", step)
        first = min(first, score)
        if score < best:
            best, kept = score, _joint_of(joint, free, value, scale, study.diag)
        adam.zero_grad()
        loss.backward()
        adam.step()
    return kept


def _joint_of(
    joint: Joint, free: torch.Tensor, value: torch.Tensor, scale: float, diag: float
) -> Joint:
    numbers = free.detach().numpy()
    axis = numbers[:3] / np.linalg.norm(numbers[:3])
    origin = numbers[3:] * diag if joint.kind == "revolute" else joint.origin
    return replace(joint, axis=axis, origin=origin, value=float(value.detach()) * scale)


def _loss(
    joint: Joint,
    free: torch.Tensor,
    value: torch.Tensor,
    clouds: tuple[F64, F64],
    base: _Base,
    study: Study,
    paper: bool,
) -> torch.Tensor:
    zero, one = (torch.from_numpy(c) for c in clouds)
    steps = torch.tensor(SWEEP, dtype=torch.float64) * value
    still = torch.zeros_like(steps)
    turns, slides = (steps, still) if joint.kind == "revolute" else (still, steps)
    path = losses.moved_points(zero, free[:3], free[3:] * study.diag, turns, slides)
    sigma = 0.5 * study.tau
    if paper:
        matches = one[torch.from_numpy(cKDTree(clouds[1]).query(path[-1].detach().numpy())[1])]
        fit = (path[-1] - matches).square().sum(-1).mean()
        contact = losses.contact_loss(
            path[-1], static_points=torch.from_numpy(base.points), paper=True
        )
    else:
        identity = torch.eye(3, dtype=torch.float64)[None]
        fit = losses.vector_field_loss(
            path[-1],
            one,
            identity,
            torch.zeros(1, 3, dtype=torch.float64),
            torch.ones(len(zero), 1, dtype=torch.float64),
            sigma=sigma,
        )
        contact = losses.contact_loss(path, sdf=base, margin=sigma) / sigma**2
    return fit + PHYS_WEIGHT * contact


def part_diagnostics(
    study: Study, joints: list[Joint], hard: NDArray[np.int64], paper: bool
) -> tuple[tuple[dict[str, float], ...], tuple[str, ...]]:
    """Return the losses and residuals of every part, and notes on terms that were left out."""
    rows, notes = [], []
    for k, joint in enumerate(joints):
        zero, one, base = _clouds(study, k + 1, hard)
        row = _measure(study, joint, zero, one, base, paper)
        if not row["repel_points"]:
            notes.append(f"part_{k + 1}: no seam within reach of the base, repel points left out")
        rows.append(row)
    return tuple(rows), tuple(notes)


def _measure(
    study: Study, joint: Joint, zero: F64, one: F64, base: _Base, paper: bool
) -> dict[str, float]:
    move = move_of(joint)
    repels = repel_points([(base.points, zero), (base.points, one)])
    if min(len(zero), len(one)) == 0:
        return {"motion_residual": float("nan"), "repel_points": float(len(repels))}
    there = se3.apply(move, zero)
    gap, index = cKDTree(one).query(there)
    close = gap < study.tau
    weights = torch.ones(int(close.sum()), 1, dtype=torch.float64)
    rot, trans = (
        torch.from_numpy(move[None, :3, :3].copy()),
        torch.from_numpy(move[None, :3, 3].copy()),
    )
    zero_t = torch.from_numpy(zero)
    path = np.stack([se3.apply(joint.transform(s * joint.value), zero) for s in SWEEP])
    velocity = losses.velocity_loss(
        zero_t[close], torch.from_numpy(one[index[close]]), weights, paper=paper
    )
    # In diagonals: the paper's strength, a volume, is meant for an object of about one unit.
    forces = study.diag * repel_forces(zero / study.diag, repels / study.diag, 0.01, paper=paper)
    return {
        "contact_loss": float(
            losses.contact_loss(
                torch.from_numpy(path), torch.from_numpy(base.points), base, 0.5 * study.tau, paper
            )
        ),
        "velocity_loss": float(velocity),
        "vector_field_loss": float(
            losses.vector_field_loss(
                zero_t,
                torch.from_numpy(one[index] if paper else one),
                rot,
                trans,
                torch.ones(len(zero), 1, dtype=torch.float64),
                sigma=study.tau,
                paper=paper,
            )
        ),
        "motion_residual": float(np.median(gap)),
        "repel_points": float(len(repels)),
        "repel_gradient": joint_gradient(zero, forces, joint) if len(repels) else 0.0,
    }
