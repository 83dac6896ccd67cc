"""Boxes seen in two states: depths in photos, Gaussians on their faces, and how parts move."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from synth_photos import box_depth, viewmats_around

from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.se3 import apply, inverse

SIZE, FOCAL, DISTANCE, VIEWS = 128, 210.0, 2.0, 26
RED, BLUE = (0.8, 0.1, 0.1), (0.1, 0.2, 0.9)
# A chest with a lid hinged at its back edge, 60 degrees open at state 1.
CHEST = (np.array([-0.2, -0.25, -0.15]), np.array([0.2, 0.25, 0.1]))
LID = (np.array([-0.2, -0.25, 0.1]), np.array([0.2, 0.25, 0.15]))
HINGE = Joint("revolute", np.array([0.0, 1.0, 0.0]), np.array([-0.2, 0.0, 0.1]), -np.pi / 3)
EYE = np.eye(4)


def surface_points(box, n=1500) -> np.ndarray:
    rng = np.random.default_rng(1)
    points = rng.uniform(0, 1, (n, 3))
    points[np.arange(n), np.arange(n) % 3] = rng.integers(0, 2, n)
    return box[0] + points * (box[1] - box[0])


def two_states(boxes, joints, world=EYE, parents=None):
    """Return (scene, gaussians, motion) of boxes, the first of them the base."""
    states, clouds, probs = [], [], []
    for s in (0, 1):
        moves = [world, *(world @ j.transform(s * j.value) for j in joints)]
        viewmats = viewmats_around(VIEWS, DISTANCE) @ inverse(world)
        depth = np.min([[box_depth(m @ w, *b, SIZE, FOCAL) for m in viewmats]
                        for b, w in zip(boxes, moves, strict=True)], axis=0)
        seen = np.isfinite(depth)
        K = np.array([[FOCAL, 0, SIZE / 2], [0, FOCAL, SIZE / 2], [0, 0, 1.0]])
        states.append(StateViews(
            np.zeros((VIEWS, SIZE, SIZE, 3), np.uint8), np.where(seen, 255, 0).astype(np.uint8),
            np.repeat(K[None], VIEWS, 0), viewmats, np.where(seen, depth, 0).astype(np.float32),
            tuple(map(str, range(VIEWS))), np.arange(VIEWS) % 13 == 12))
        points = [apply(m, surface_points(b)) for b, m in zip(boxes, moves, strict=True)]
        label = np.repeat(np.arange(len(boxes)), [len(p) for p in points])
        means = np.concatenate(points).astype(np.float32)
        n = len(means)
        colors = np.where(label[:, None] == 0, RED, BLUE)
        clouds.append(Gaussians(
            means, np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
            np.full((n, 3), np.log(0.012), np.float32), np.full(n, 4.0, np.float32),
            ((colors - 0.5) / SH_C0).astype(np.float32), np.zeros((n, 0, 3), np.float32)))
        probs.append(np.eye(len(boxes), dtype=np.float32)[label])
    joints = tuple(moved_joint(j, world) for j in joints)
    motion = Motion((probs[0], probs[1]), joints, parents or (0,) * len(joints),
                    tuple({"contact_loss": 0.5} for _ in joints))
    return Scene(Path("toy"), "toy", (states[0], states[1])), (clouds[0], clouds[1]), motion


def moved_joint(joint: Joint, world) -> Joint:
    return Joint(joint.kind, world[:3, :3] @ joint.axis, apply(world, joint.origin), joint.value)
