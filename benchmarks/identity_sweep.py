"""Sweep the weights of identity refinement on a door flush with its frame; prints a table.

Run: python benchmarks/identity_sweep.py   (about 10 s on one core)
"""

from __future__ import annotations

import sys

import numpy as np

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import apply, quat_from_rotation
from part2gs_robotics.paper.identity import IdentityConfig, refine_identities

STEP = 0.02
HINGE = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.2, 0, 0]), -np.deg2rad(70))
CASES = ((0.4, 0.2), (0.06, 0.2), (0.4, 0.35))  # door width, share of wrong evidence
WEIGHTS = ((1.0, 2.0), (2.0, 2.0), (3.0, 3.0), (4.0, 4.0), (20.0, 3.0))  # part_weight, cross_weight


def flush_door(width: float) -> tuple[tuple[Gaussians, Gaussians], np.ndarray]:
    """Return both states of a 1 x 1 plate whose door (label 1) opens by 70 deg in state 1."""
    x, z = (m.ravel() for m in np.meshgrid(np.arange(0, 1, STEP), np.arange(0, 1, STEP)))
    noise = np.random.default_rng(0).normal(scale=STEP / 8, size=(len(x), 3))
    points, labels = np.stack([x, 0 * x, z], 1) + noise, (x >= 0.2) & (x < 0.2 + width)
    zeros = np.zeros((len(x), 3), np.float32)
    log_scales = np.tile(np.float32([-4, -7, -4]), (len(x), 1))
    quats = np.tile(np.float32([1, 0, 0, 0]), (len(x), 1))
    no_sh = np.zeros((len(x), 0, 3), np.float32)
    motion = HINGE.transform(HINGE.value)
    moved = np.where(labels[:, None], apply(motion, points), points)
    turned = np.where(labels[:, None], quat_from_rotation(motion[:3, :3]), quats)
    states = (points, quats), (moved, turned)
    first, second = (
        Gaussians(np.float32(p), np.float32(q), log_scales, zeros[:, 0], zeros, no_sh)
        for p, q in states
    )
    return (first, second), labels.astype(int)


def worst_state_accuracy(width: float, wrong: float, config: IdentityConfig, seed: int) -> float:
    """Return the share of right labels in the worse of the two states."""
    pair, labels = flush_door(width)
    rng = np.random.default_rng(seed)
    named = [labels ^ (rng.random(len(labels)) < wrong) for _ in range(2)]
    unary = [np.where(np.arange(2) == n[:, None], 0.0, 4.0) for n in named]
    probs = refine_identities(unary[0], unary[1], pair, [HINGE], config)
    return min(float((p.argmax(1) == labels).mean()) for p in probs)


def main() -> None:
    """Write one row per pair of weights, one column per case, means of five seeds."""
    for part, cross in WEIGHTS:
        config = IdentityConfig(part_weight=part, cross_weight=cross)
        means = [np.mean([worst_state_accuracy(*c, config, s) for s in range(5)]) for c in CASES]
        sys.stdout.write(
            f"| {part:g} / {cross:g} | " + " | ".join(f"{m:.3f}" for m in means) + " |\n"
        )


if __name__ == "__main__":
    main()
