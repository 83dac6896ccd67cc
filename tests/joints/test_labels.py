"""Labels by part identities or by landing alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.claim import STAYS, claim
from part2gs_robotics.joints.labels import (
    final_labels,
    labels_under,
    landing_costs,
    part_probs,
    start_labels,
)
from part2gs_robotics.paper.identity import PAPER, IdentityConfig

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")

PLAIN = ArticulateConfig(identity=False, contact=False, vector_field=False, alignment=False)


@pytest.fixture(scope="module")
def decided(judge, look_alikes):
    """The true motions, a little too long: look-alikes hold some of each other's surfels."""
    return judge.judge(on_base(replace(h, value=h.value + 0.02) for h in look_alikes.truth))


@pytest.fixture(scope="module")
def true(decided, look_alikes):
    """The true joints, with the labels of those that are too long."""
    return on_base(look_alikes.truth, decided.labels)


def accuracy(probs, owners, state):
    return float((probs[state].argmax(1) == owners[state]).mean())


def test_without_identities_every_surfel_takes_the_motion_that_lands_it_best(
    judge, true
):
    costs = landing_costs(judge, [j.transform(j.value) for j in true.motions])
    hard = labels_under(judge, true, PLAIN)
    np.testing.assert_array_equal(costs[np.arange(len(hard)), hard], costs.min(1))
    ties = (costs == costs.min(1, keepdims=True))[:, 0]
    assert not hard[ties].any(), "what no motion explains better stands still"


def test_identities_are_nearer_the_truth_than_landing_alone(
    judge, true, look_alikes
):
    found = {}
    for config in (PLAIN, replace(PLAIN, identity=True)):
        hard = labels_under(judge, true, config)
        found[config.identity] = part_probs(judge.study, replace(true, labels=hard), config)
    for state in (0, 1):
        with_them, without = (accuracy(found[k], look_alikes.owners, state) for k in (True, False))
        assert with_them > max(0.9, without + 0.02)
    assert set(np.unique(found[False][0])) == {0.0, 1.0}, "one-hot: landing knows no doubt"


def test_printed_identities_differ_from_corrected_and_from_none(judge, true):
    printed = replace(PLAIN, identity=True, paper_mode=True)
    labels = [labels_under(judge, true, config)
              for config in (printed, replace(PLAIN, identity=True), PLAIN)]
    assert (labels[0] != labels[1]).any()
    assert (labels[0] != labels[2]).any()
    assert (PAPER.cross_weight, PAPER.normal_weight, PAPER.color_weight) == (0, 0, 0)
    assert not PAPER.annealed
    assert IdentityConfig().annealed


def test_start_labels_keep_the_decision_where_landing_leaves_a_motion_nothing(judge, decided):
    assert start_labels(judge, decided, ArticulateConfig()) is decided.labels
    twice = replace(decided, motions=(decided.motions[0], decided.motions[0]))
    hard = start_labels(judge, twice, PLAIN)  # ties go to the first, so the second has no surfel
    kept = decided.labels == 2
    assert kept.any()
    np.testing.assert_array_equal(hard == 2, kept)


def test_final_labels_are_claimed_from_those_that_were_judged(judge, true, monkeypatch):
    config = replace(PLAIN, identity=True)
    hard = final_labels(judge, true, config)
    known = judge.judge(true)
    np.testing.assert_array_equal(hard, claim(judge.study, judge.lands, known, STAYS))
    astray = replace(true, labels=np.zeros_like(hard))
    np.testing.assert_array_equal(final_labels(judge, astray, config), hard)


def test_final_labels_without_identities_are_those_that_land_best(judge, true):
    found = [ask(judge, true, PLAIN) for ask in (final_labels, labels_under)]
    np.testing.assert_array_equal(*found)
