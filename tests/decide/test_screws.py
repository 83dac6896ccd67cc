"""Screws grow from turns where the evidence rises, and fall back to turns where images do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.decide.screws import plain, risen
from part2gs_robotics.model.joint import Joint

DIAG = 1.2


TURN = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.4, 0.3, 0.3]), 0.9)
SCREWED = replace(TURN, kind="screw", pitch=0.12 / 0.9)


@pytest.fixture(scope="module", params=[SCREWED, TURN], ids=["screw", "turn"])
def world(request, toy):
    """A block on a base that turns and may rise: the true motion and a judge."""
    truth, base = request.param, toy.Box((0, 0, 0), (0.8, 0.6, 0.25), 1)
    block = toy.Box((0.15, 0.1, 0.25), (0.6, 0.4, 0.5), 2)
    pair = [toy.gaussians_of([base, replace(block, move=move)], 0.03)[0]
            for move in (np.eye(4), truth.move)]
    eyes = toy.cameras(16, 64, np.array([0.4, 0.3, 0.3]), 1.2)
    scene = toy.scene_of(tuple(toy.drawn(g, *eyes, 64) for g in pair))
    return truth, Judge(toy.study_of(scene, pair))


def near(turn):
    """A turn as the search finds it."""
    return replace(turn, kind="revolute", pitch=0.0, value=0.95 * turn.value,
                   origin=turn.origin + np.array([0.02, -0.01, 0]))


def test_a_turn_that_rises_becomes_a_screw_and_one_that_does_not_stays(world, caplog):
    truth, judge = world
    slide = Joint("prismatic", truth.axis, truth.origin, 0.1)
    pool = [near(truth), slide]
    start = judge.polished(judge.judge(on_base(pool[:1])))
    with caplog.at_level("INFO", logger="part2gs_robotics"):
        found = risen(judge, start, pool)
    if truth.kind != "screw":
        assert found is start
        return
    assert len(caplog.messages) == 1
    motion, = found.motions
    assert motion.kind == "screw"
    assert motion.rise == pytest.approx(0.12, rel=0.05)
    assert motion.value == pytest.approx(truth.value, abs=0.03)
    assert found.cost < start.cost


@pytest.mark.parametrize("world", [SCREWED], indirect=True)
def test_one_screw_does_for_a_turn_and_a_slide(world):
    truth, judge = world
    pair = [near(truth), Joint("prismatic", truth.axis, truth.origin, 0.12)]
    found = risen(judge, judge.judge(on_base(pair)), pair)
    assert "screw" in [h.kind for h in found.motions]


@pytest.mark.parametrize(("rise", "sigma", "kind"), [
    (0.05, 0.001, "screw"),
    (0.05, 0.02, "revolute"),  # less than three deviations
    (0.005, 1e-5, "revolute"),  # less than depth bends
    (0.05, float("nan"), "revolute"),  # alignment told nothing
])
def test_a_rise_must_be_proven(rise, sigma, kind):
    joint = Joint("screw", np.array([0.0, 0, 1]), np.zeros(3), 0.8, rise / 0.8, sigma_rise=sigma)
    door = replace(joint, kind="revolute", pitch=0.0)
    found, other = plain([joint, door], DIAG)
    assert (found.kind, found.pitch) == (kind, joint.pitch if kind == "screw" else 0.0)
    assert other is door
