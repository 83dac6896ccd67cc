"""Labels by part identities or by landing alone, and switches that change the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.articulate import Clock, settled_motion
from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.joints.labels import labels_under, landing_costs, part_probs, start_labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.paper.identity import PAPER, IdentityConfig

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")

PLAIN = ArticulateConfig(identity=False, contact=False, vector_field=False, alignment=False)


@pytest.fixture(scope="module")
def verdict(judge, look_alikes):
    """The true motions, a little too long: look-alikes hold some of each other's surfels."""
    return judge.judge([replace(h, value=h.value + 0.02) for h in look_alikes.truth])


@pytest.fixture(scope="module")
def true_joints(look_alikes):
    return [Joint("prismatic", h.axis, h.origin, h.value) for h in look_alikes.truth]


def accuracy(probs, owners, state):
    return float((probs[state].argmax(1) == owners[state]).mean())


def test_without_identities_every_surfel_takes_the_motion_that_lands_it_best(
    judge, verdict, true_joints
):
    costs = landing_costs(judge, [j.transform(j.value) for j in true_joints])
    hard, same = labels_under(judge, true_joints, verdict.hard, PLAIN)
    np.testing.assert_array_equal(costs, same)
    np.testing.assert_array_equal(costs[np.arange(len(hard)), hard], costs.min(1))
    ties = (costs == costs.min(1, keepdims=True))[:, 0]
    assert not hard[ties].any(), "what no motion explains better stands still"


def test_identities_are_nearer_the_truth_than_landing_alone(
    judge, verdict, true_joints, look_alikes
):
    found = {}
    for config in (PLAIN, replace(PLAIN, identity=True)):
        hard, costs = labels_under(judge, true_joints, verdict.hard, config)
        found[config.identity] = part_probs(judge.study, true_joints, costs, hard, config)
    for state in (0, 1):
        with_them, without = (accuracy(found[k], look_alikes.owners, state) for k in (True, False))
        assert with_them > without + 0.05
    assert set(np.unique(found[False][0])) == {0.0, 1.0}, "one-hot: landing knows no doubt"


def test_printed_identities_differ_from_corrected_and_from_none(judge, verdict, true_joints):
    printed = replace(PLAIN, identity=True, paper_mode=True)
    labels = [labels_under(judge, true_joints, verdict.hard, config)[0]
              for config in (printed, replace(PLAIN, identity=True), PLAIN)]
    assert (labels[0] != labels[1]).any()
    assert (labels[0] != labels[2]).any()
    assert (PAPER.cross_weight, PAPER.normal_weight, PAPER.color_weight) == (0, 0, 0)
    assert not PAPER.annealed
    assert IdentityConfig().annealed


def test_start_labels_keep_the_decision_where_landing_leaves_a_motion_nothing(judge, verdict):
    assert start_labels(judge, verdict, ArticulateConfig()) is verdict.hard
    twice = replace(verdict, motions=(verdict.motions[0], verdict.motions[0]))
    hard = start_labels(judge, twice, PLAIN)  # ties go to the first, so the second has no surfel
    kept = verdict.hard == 2
    assert kept.any()
    np.testing.assert_array_equal(hard == 2, kept)


def test_identity_and_alignment_switches_change_the_motion(look_alikes, judge, verdict):
    motions = {
        name: settled_motion(look_alikes.scene, look_alikes.study, verdict, config, Clock(None))
        for name, config in {
            "none": PLAIN, "identity": replace(PLAIN, identity=True),
            "printed": replace(PLAIN, identity=True, paper_mode=True, alignment=True),
            "aligned": replace(PLAIN, identity=True, alignment=True),
        }.items()}  # fmt: skip
    way = {name: [j.value for j in m.joints] for name, m in motions.items()}
    probs = {name: m.part_probs[0].argmax(1) for name, m in motions.items()}
    assert (probs["none"] != probs["identity"]).any()
    assert (probs["printed"] != probs["identity"]).any()
    truth = [h.value for h in look_alikes.truth]
    error = {name: np.abs(np.subtract(w, truth)).max() for name, w in way.items()}
    assert error["aligned"] < 0.005 < error["identity"]
    assert way["printed"] == way["identity"], "paper mode never aligns"
    assert all(row["physics_kept"] == 0.0 for m in motions.values() for row in m.diagnostics)


def test_the_pull_is_kept_joint_by_joint_where_images_agree(look_alikes, judge):
    """Half a per cent of the diagonal too long: within the reach of the robust scale."""
    near = judge.judge([replace(h, value=h.value + 0.006) for h in look_alikes.truth])
    motions = []
    for config in (PLAIN, replace(PLAIN, vector_field=True)):
        config = replace(config, identity=True)
        motions.append(settled_motion(look_alikes.scene, look_alikes.study, near, config,
                                      Clock(None)))
    still, pulled = motions
    same = [a.value == b.value for a, b in zip(*(m.joints for m in motions), strict=True)]
    assert [row["physics_kept"] for row in pulled.diagnostics] == [float(not s) for s in same]
    assert not all(same)
    truth = [h.value for h in look_alikes.truth]
    error = [np.abs(np.subtract([j.value for j in m.joints], truth)).sum() for m in motions]
    assert error[1] < error[0]
    assert still.diagnostics[0]["physics_kept"] == 0.0
