"""Parts that shared one motion get one each, as far as photos tell them apart."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.config import SearchConfig, resolve
from part2gs_robotics.joints.alike import each_aligned
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion

CONFIG = replace(resolve({}), search=SearchConfig(align_views=16, sharp_side=96))
SLIDE = Joint("prismatic", np.array([1.0, 0, 0]), np.array([0.2, 0.4, 0.4]), 0.2)


@pytest.fixture(scope="module")
def drawers(toy):
    """Two blocks on a base, slid along x by 0.21 and 0.19: photos, Gaussians, labels."""
    base = toy.Box((0, 0, 0), (0.9, 0.8, 0.25), 1)
    places = [((0.05, 0.06, 0.25), (0.4, 0.36, 0.5)), ((0.05, 0.44, 0.25), (0.4, 0.74, 0.5))]
    moved = [replace(SLIDE, value=way).state1_from_0 for way in (0.21, 0.19)]
    before = [base, *(toy.Box(*place, 2) for place in places)]
    after = [base, *(toy.Box(*place, 2, move) for place, move in zip(places, moved, strict=True))]
    (one, owners), (two, later) = (toy.gaussians_of(boxes, 0.03) for boxes in (before, after))
    eyes = toy.cameras(16, 96, np.array([0.45, 0.4, 0.25]), 1.1)
    scene = toy.scene_of(tuple(toy.drawn(g, *eyes, 96) for g in (one, two)))
    both = SimpleNamespace(scene=scene, gaussians=(one, two), surfaces=SimpleNamespace(diag=1.3))
    probs = tuple(np.eye(3, dtype=np.float32)[labels] for labels in (owners, later))
    return both, Motion((probs[0], probs[1]), (SLIDE, SLIDE), (0, 0))


def test_each_of_two_drawers_slides_as_far_as_photos_show(drawers):
    both, motion = drawers
    found = each_aligned(both, motion, CONFIG)
    assert [j.value for j in found.joints] == pytest.approx([0.21, 0.19], abs=0.002)
    assert all(j.carrier is None and 0 < j.sigma_value < 0.01 for j in found.joints)
    assert found.parents == motion.parents


def test_a_joint_of_its_own_stays_as_it_is(drawers):
    both, motion = drawers
    other = replace(SLIDE, value=0.19)
    found = each_aligned(both, replace(motion, joints=(SLIDE, other)), CONFIG)
    assert [j.value for j in found.joints] == [0.2, 0.19]


def test_a_part_that_carries_another_keeps_its_joint(drawers):
    both, motion = drawers
    found = each_aligned(both, replace(motion, parents=(0, 1)), CONFIG)
    assert found.joints[0].value == 0.2


@pytest.mark.parametrize("off", [{"alignment": False}, {"paper_mode": True}])
def test_where_joints_are_not_aligned_they_stay_one(drawers, off):
    both, motion = drawers
    config = replace(CONFIG, articulate=replace(CONFIG.articulate, **off))
    assert each_aligned(both, motion, config) is motion
