"""Snapping adds motions along the object's own directions, and copies are left out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.evidence.guides import Guides
from part2gs_robotics.evidence.surfaces import Evidence
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.snap import distinct, slide_families, snapped


@pytest.fixture(scope="module")
def study(slid):
    """What snapping reads of a study: surfels, grids, evidence, box and diagonal."""
    states = tuple(s.surfels for s in slid.states)
    lo, hi = np.array(slid.block.lo), np.array(slid.block.hi)
    sets = []
    for s, shift in zip(states, (0.0, slid.value), strict=True):
        points = s.points - slid.axis * shift
        own = ((points > lo - 0.005) & (points < hi + 0.005)).all(1)
        sets.append(s.select(own & (points[:, 2] > lo[2] + 0.03)))
    points = np.concatenate([s.points for s in states])
    box = points.min(0), points.max(0)
    return SimpleNamespace(surfels=states, lands=tuple(s.land for s in slid.states),
                           evidence=Evidence(*sets), box=box,
                           diag=float(np.linalg.norm(box[1] - box[0])),
                           straight=Guides(np.zeros((0, 3)), np.zeros((0, 3, 3))))


def replace_straight(study, edge):
    return SimpleNamespace(**{**vars(study), "straight": Guides(edge[None], np.zeros((1, 3, 3)))})


def tilted(axis, degrees):
    side = np.cross(axis, [0.3, 0.5, 0.8])
    return se3.rotation_from_rotvec(np.deg2rad(degrees) * side / np.linalg.norm(side)) @ axis


def test_a_tilted_slide_is_also_tried_straight(study):
    rough = Joint("prismatic", tilted(np.array([1.0, 0, 0]), 15.0), np.zeros(3), 0.3)
    axes = [h.axis for h in snapped([rough], study, np.random.default_rng(0))]
    best = max(abs(a[0]) for a in axes)
    assert best > np.cos(np.deg2rad(0.5))
    for h in snapped([rough], study, np.random.default_rng(0)):
        assert h.kind == "prismatic"
        assert h.axis @ rough.axis > 0  # the same way, not its opposite
        assert h.value == pytest.approx(0.3 * (h.axis @ rough.axis))


def test_a_motion_on_an_edge_is_held_there(study):
    """Edges come before faces: exactly their direction, and marked so that it stays."""
    edge = tilted(np.array([1.0, 0, 0]), 1.0)
    known = replace_straight(study, edge)
    rough = Joint("prismatic", tilted(np.array([1.0, 0, 0]), 15.0), np.zeros(3), 0.3)
    found = snapped([rough], known, np.random.default_rng(0))
    on = [h for h in found if abs(h.axis @ edge) > 1 - 1e-12]
    assert len(on) == 1
    assert [h.held for h in found] == [h is on[0] for h in found]
    family = slide_families([on[0]], known, 20.0, np.random.default_rng(0))
    assert family
    assert all(h.held for h in family)


def test_a_hinge_is_snapped_within_its_own_narrower_limit(study):
    rng = np.random.default_rng(0)
    near = Joint("revolute", tilted(np.array([0.0, 0, 1]), 8.0), np.ones(3), 1.0)
    far = Joint("revolute", tilted(np.array([0.0, 0, 1]), 25.0), np.ones(3), 1.0)
    assert any(h.axis[2] > 0.9999 for h in snapped([near], study, rng))
    assert not any(h.axis[2] > 0.9999 for h in snapped([far], study, rng))
    assert all(np.array_equal(h.origin, near.origin) for h in snapped([near], study, rng))


def test_the_family_of_a_direction_holds_the_true_distance(study, slid):
    wrong_length = Joint("prismatic", slid.axis, np.zeros(3), 0.1)
    turn = Joint("revolute", np.array([0.0, 0, 1]), np.zeros(3), 0.5)
    rng = np.random.default_rng(0)
    family = slide_families([turn, wrong_length], study, 20.0, rng)
    assert family
    assert all(np.array_equal(h.axis, slid.axis) and h.kind == "prismatic" for h in family)
    step = 0.01 * study.diag
    assert min(abs(h.value - slid.value) for h in family) <= 0.51 * step
    # without any slide the object's own directions are tried
    own = slide_families([turn], study, 20.0, rng)
    assert min(np.linalg.norm(h.axis * h.value - slid.axis * slid.value) for h in own) <= 2 * step
    assert slide_families([turn], study, 1e9, rng) == []  # none explains as much as that


@pytest.mark.parametrize("held", [False, True])
def test_an_edge_has_its_family_however_many_slides_lean_elsewhere(study, slid, held):
    leaning = [np.array(a) for a in ([0.0, 1, 0], [0.0, 0, 1], [0.0, 0.6, 0.8])]
    last = Joint("prismatic", slid.axis, np.zeros(3), 0.1, held=held)
    found = [*(Joint("prismatic", a, np.zeros(3), 0.2) for a in leaning), last]
    family = slide_families(found, study, 20.0, np.random.default_rng(0))
    along = [h for h in family if np.array_equal(h.axis, slid.axis)]
    assert bool(along) == held
    assert not along or min(abs(h.value - slid.value) for h in along) <= 0.51 * 0.01 * study.diag


def test_distinct_keeps_the_first_of_motions_that_act_alike(study):
    a = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3)
    same = Joint("prismatic", np.array([-1.0, 0, 0]), np.ones(3), -0.3)
    near = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3 + 0.002 * study.diag)
    other = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3 + 0.02 * study.diag)
    assert distinct([a, same, near, other, a], study) == [a, other]
