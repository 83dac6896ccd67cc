from types import SimpleNamespace

import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import (
    FEWEST_POSES,
    MOST_POSES,
    chain,
    part_transforms,
    sweep,
)
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.volume.carve import Solid, carve
from part2gs_robotics.volume.fuse import TRUNCATION
from part2gs_robotics.volume.grid_solids import CROSSING, _yield_to

VOXEL = 0.02
Z = np.array([0.0, 0, 1.0])


def box_solid(lo, hi, margin=5) -> Solid:
    lo, hi = np.array(lo, float), np.array(hi, float)
    grid = Grid.around(lo - (margin + 0.5) * VOXEL, hi + margin * VOXEL, VOXEL)
    points = grid.centers(np.stack(np.indices(grid.shape), -1))
    outside = np.maximum(lo - points, points - hi)
    distance = -np.where((outside > 0).any(-1), np.linalg.norm(np.maximum(outside, 0), axis=-1),
                         outside.max(-1)) / VOXEL
    return Solid(grid, np.clip(distance, -TRUNCATION, TRUNCATION).astype(np.float32))


def overlap(solid: Solid, rival_lo, rival_hi, moves) -> float:
    """Return how deep, in voxels, the deepest inner voxel lies inside a moved box."""
    points = solid.grid.centers(np.argwhere(solid.values > 0))
    deepest = -np.inf
    for move in moves:
        p = apply(move, points)
        out = np.maximum(rival_lo - p, p - rival_hi)
        depth = np.where((out > 0).any(1), -np.linalg.norm(np.maximum(out, 0), axis=1), -out.max(1))
        deepest = max(deepest, depth.max())
    return deepest / VOXEL


def test_chain_agrees_with_the_kinematics_of_the_twin():
    twin = toy_cabinet_twin(4)
    joints, parents = [p.joint for p in twin.parts[1:]], [p.parent for p in twin.parts[1:]]
    q = [0.1, 0.7, 0.3, 1.2]
    for part, expected in enumerate(part_transforms(twin, q)):
        np.testing.assert_allclose(chain(part, joints, parents, q), expected, atol=1e-14)


@pytest.mark.parametrize("clearance", [0.0, 1.0, 2.0])
def test_carving_leaves_the_clearance(clearance):
    lo, hi = np.array([0.2, 0.2, 0.0]), np.array([0.4, 0.4, 0.2])
    base, rival = box_solid([0, 0, 0], [0.6, 0.6, 0.3]), box_solid(lo, hi)
    out = carve(base, rival, np.eye(4)[None], clearance)
    assert overlap(out, lo, hi, [np.eye(4)]) <= -clearance + 0.01
    gap = clearance * VOXEL
    pocket = np.minimum(hi + gap, [0.6, 0.6, 0.3]) - np.maximum(lo - gap, 0)
    expected = 0.6 * 0.6 * 0.3 - pocket.prod()
    assert out.volume == pytest.approx(expected, rel=0.02)


def test_sweep_of_a_slide_clears_the_whole_way():
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3)
    lo, hi = np.array([0.1, 0.2, 0.1]), np.array([0.16, 0.4, 0.2])
    base, rival = box_solid([0, 0, 0], [0.6, 0.6, 0.3]), box_solid(lo, hi)
    poses = sweep(1, 0, [joint], [0], rival.corners(), VOXEL)
    out = carve(base, rival, poses, 0.5)
    fine = [np.linalg.inv(joint.transform(q)) for q in np.linspace(0, 0.3, 101)]
    assert overlap(out, lo, hi, fine) < 0


@pytest.mark.parametrize("value", [0.001, 0.5, 3.0])
def test_poses_of_a_sweep_are_close_and_bounded(value):
    joint = Joint("revolute", Z, np.zeros(3), value)
    corners = box_solid([0, 0, 0], [0.5, 0.1, 0.1]).corners()
    poses = sweep(1, 0, [joint], [0], corners, VOXEL)
    assert FEWEST_POSES <= len(poses) <= MOST_POSES
    moved = np.stack([apply(np.linalg.inv(p), corners) for p in poses])
    steps = np.linalg.norm(np.diff(moved, axis=0), axis=2).max()
    assert steps <= VOXEL * 1.01
    np.testing.assert_allclose(poses[-1], np.linalg.inv(joint.transform(value)), atol=1e-12)


def test_nested_part_is_swept_with_its_carrier_at_both_ends():
    joints = [Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3),
              Joint("revolute", Z, np.zeros(3), 1.0)]
    poses = sweep(2, 0, joints, [0, 1], box_solid([0, 0, 0], [0.2, 0.1, 0.1]).corners(), VOXEL)
    for q in ([0, 0], [0.3, 0], [0, 1.0], [0.3, 1.0]):
        wanted = np.linalg.inv(chain(2, joints, [0, 1], q))
        assert np.abs(poses - wanted).max((1, 2)).min() < 1e-12
    # Relative to its carrier only its own joint counts.
    own = sweep(2, 1, joints, [0, 1], box_solid([0, 0, 0], [0.2, 0.1, 0.1]).corners(), VOXEL)
    np.testing.assert_allclose(own[-1], np.linalg.inv(joints[1].transform(1.0)), atol=1e-12)


def test_the_better_observed_solid_stays():
    a, b = box_solid([0, 0, 0], [0.4, 0.4, 0.4]), box_solid([0.2, 0, 0], [0.6, 0.4, 0.4])
    strong, weak = np.full_like(a.values, 5.0), np.full_like(b.values, 1.0)
    kept = carve(a, b, np.eye(4)[None], 0.0, (strong, weak))
    assert (kept.values == np.maximum(a.values, -TRUNCATION)).all()
    lost = carve(a, b, np.eye(4)[None], 0.0, (np.full_like(a.values, 0.5), weak))
    assert lost.volume == pytest.approx(0.5 * a.volume, rel=0.08)


def test_parts_that_cross_on_one_way_are_parted_on_the_other():
    """A bar passes under a block that comes down: it grazes the raised one, hits the lowered."""
    lo, hi = np.array([0.0, 0.0, -0.06]), np.array([0.1, 0.3, 0.1])
    block = box_solid([0.25, 0.0, 0.1 - 0.5 * VOXEL], [0.85, 0.3, 1.5])
    place = SimpleNamespace(joints=(Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 1.1),
                                    Joint("prismatic", -Z, np.zeros(3), 0.2)), parents=(0, 0))
    out = _yield_to(block, box_solid(lo, hi), 2, 1, place, 1.0)
    assert block.volume > out.volume > (1 - CROSSING) * block.volume

    def way(lowered):
        ends = np.stack([np.linspace(0, 1.1, 56), np.full(56, lowered)], 1)
        return [np.linalg.inv(chain(1, place.joints, place.parents, q))
                @ chain(2, place.joints, place.parents, q) for q in ends]

    assert overlap(block, lo, hi, way(0.0)) > -0.1  # less than the clearance
    assert overlap(out, lo, hi, way(0.0)) < -0.9
    assert overlap(out, lo, hi, way(0.2)) > 1.0  # they really meet there
