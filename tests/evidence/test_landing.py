"""Landing costs in closed form: a match, a contradiction, an unseen place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.landing import (
    CLAIMED_COST,
    COLOR_SCALE,
    FREE_COST,
    HIDDEN_COST,
    land,
    score_moves,
    score_turns,
    unclaimed,
)
from part2gs_robotics.model import se3

TAU = 0.05


def on_block(world, state=0):
    """Surfels of the moving box in state 0, off its lower edges."""
    s = world.states[state].surfels
    lo, hi = np.array(world.block.lo), np.array(world.block.hi)
    inside = ((s.points > lo - 0.01) & (s.points < hi + 0.01)).all(1)
    return s.select(inside & (s.points[:, 2] > lo[2] + 0.04))


def test_the_true_slide_costs_almost_nothing_and_staying_costs_more(slid):
    patch, target = on_block(slid), slid.states[1].land
    moves = np.stack([se3.make(np.eye(3), slid.axis * d) for d in (slid.value, 0.0, 0.15)])
    truth, still, half = score_moves(moves, patch, target, TAU)
    assert truth < 0.08
    assert min(still, half) > 0.3


def test_the_true_turn_costs_less_than_half_of_it_and_than_its_opposite(turned):
    patch, target = on_block(turned), turned.states[1].land
    moves = np.stack([se3.screw_motion(turned.axis, turned.origin, turned.value * f, 0.0)
                      for f in (1.0, 0.5, -1.0)])
    truth, half, opposite = score_moves(moves, patch, target, TAU)
    assert truth < 0.12
    assert half > truth + 0.3
    assert opposite > truth + 0.15


def turned_and_shifted(turned, angles, shifts):
    """Rotations [A, 3, 3], shifts [P, A, 3] and motions [P * A, 4, 4] about the true axis."""
    about = [se3.screw_motion(turned.axis, turned.origin, v, 0.0) for v in angles]
    rots = np.stack([m[:3, :3] for m in about])
    steps = np.stack([m[:3, 3] for m in about]) + np.asarray(shifts)[:, None]
    moves = np.stack([se3.make(r, t) for row in steps for r, t in zip(rots, row, strict=True)])
    return rots, steps, moves


def test_promising_turns_are_scored_in_full_and_the_best_is_among_them(turned):
    patch, target = on_block(turned), turned.states[1].land
    rng = np.random.default_rng(0)
    patch = patch.select(rng.permutation(len(patch))[:80])
    values = turned.value * np.linspace(-1.0, 2.0, 301)
    rots, shifts, moves = turned_and_shifted(turned, values, rng.normal(0, 0.02, (10, 3)))
    full = score_moves(moves, patch, target, TAU)
    some = score_turns(rots, shifts, patch, target, TAU)
    scored = np.isfinite(some)
    assert scored.sum() == len(moves) // 10
    np.testing.assert_array_equal(some[scored], full[scored])
    assert some.argmin() == full.argmin()
    assert set(np.argsort(some)[:12]) == set(np.argsort(full)[:12])


@pytest.mark.parametrize("count", [1, 5, 40])
def test_short_lists_and_small_patches_are_scored_in_full(turned, count):
    patch, target = on_block(turned).select(np.arange(count)), turned.states[1].land
    lifts = np.linspace(0, 1, 7)[:, None] * [0.0, 0.0, 1.0]
    rots, shifts, moves = turned_and_shifted(turned, [0.3, 0.6], lifts)
    np.testing.assert_array_equal(score_turns(rots, shifts, patch, target, TAU),
                                  score_moves(moves, patch, target, TAU))


def test_seen_free_space_costs_the_full_price_and_the_inside_the_neutral_one(slid):
    target = slid.states[0].land
    patch = on_block(slid)
    up = se3.make(np.eye(3), np.array([0.0, 0, 0.5]))  # into the air above the block
    cost, met, miss = land(up, patch, target, TAU)
    assert (met == -1).all()
    assert (cost == FREE_COST).all()
    assert (miss == FREE_COST).all()
    centre = se3.make(np.eye(3), np.array([0.4, 0.3, 0.12]) - patch.points[0])
    cost, met, _ = land(centre, patch.select(np.array([0])), target, TAU)  # inside the base
    assert met[0] == -1
    assert cost[0] == HIDDEN_COST


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("tint", [0.0, 0.1, 0.9])
def test_depth_alone_contradicts_as_far_as_photos_show_another_colour(slid, share, tint):
    """In the air: nothing of the cost of an empty place is left where the same colour shows."""
    patch, up = on_block(slid).select(np.array([0])), se3.make(np.eye(3), np.array([0.0, 0, 0.5]))
    behind = slid.states[0].land.behind.copy()
    behind[..., :3], behind[..., 3] = patch.colors[0] + tint, share
    cost, met, miss = land(up, patch, replace(slid.states[0].land, behind=behind), TAU)
    sure = share + (1.0 - share) * min(tint / COLOR_SCALE, 1.0)
    assert met[0] == -1
    assert cost[0] == miss[0] == pytest.approx(HIDDEN_COST + sure * (FREE_COST - HIDDEN_COST),
                                               abs=1e-6)


def test_what_moves_is_compared_as_it_would_look_in_the_light_there(slid):
    """Light along x: the top of the block turned to look there is brighter than its paint."""
    block = on_block(slid)
    patch = block.select(block.normals[:, 2] > 0.9).select(np.array([0]))
    turn, shades = se3.screw_motion(np.array([0.0, 1, 0]), np.zeros(3), np.pi / 2, 0.0), np.zeros(8)
    shades[0] = np.log(2.0)
    land_, x = slid.states[0].land, (patch.normals @ turn[:3, :3].T)[0, 0]
    turn[:3, 3] = np.array([0.4, 0.3, 0.7]) - turn[:3, :3] @ patch.points[0]  # in the air
    sure = {}
    for gain in (1.0, 2.0**x):
        behind = land_.behind.copy()
        behind[..., :3], behind[..., 3] = gain * patch.colors[0], 0.0
        cost, _, _ = land(turn, patch, replace(land_, behind=behind, shades=shades), TAU)
        sure[gain] = (cost[0] - HIDDEN_COST) / (FREE_COST - HIDDEN_COST)
    assert x > 0.9
    assert sure[2.0**x] == pytest.approx(0.0, abs=1e-6), "as bright as it would be there"
    paint = abs(2.0**x - 1.0) * patch.colors[0].mean()
    assert sure[1.0] == pytest.approx(min(paint / COLOR_SCALE, 1.0), abs=1e-6), "paint alone"


def test_beyond_the_grid_is_free(slid):
    far = se3.make(np.eye(3), np.array([50.0, 0, 0]))
    cost, met, _ = land(far, on_block(slid), slid.states[0].land, TAU)
    assert (cost == FREE_COST).all()
    assert (met == -1).all()


def test_a_surfel_meets_itself_for_nothing_and_a_claimed_one_for_its_price(slid):
    seen = slid.states[0]
    cost, met, _ = land(np.eye(4), seen.surfels, seen.land, TAU)
    same = met == np.arange(len(met))
    assert same.mean() > 0.5  # the cell's nearest surfel is the surfel itself or a neighbour
    assert cost[same] == pytest.approx(0.0, abs=1e-6)
    claimed = replace(seen.land, claimed=np.ones(len(seen.surfels)))
    cost = land(np.eye(4), seen.surfels, claimed, TAU)[0]
    assert cost[same] == pytest.approx(CLAIMED_COST, abs=1e-6)
    assert land(np.eye(4), seen.surfels, unclaimed(claimed), TAU)[0][same] == pytest.approx(
        0.0, abs=1e-6)


def test_scores_are_the_means_of_the_landing_costs(turned):
    patch, target = on_block(turned), turned.states[1].land
    move = se3.screw_motion(turned.axis, turned.origin, 0.7 * turned.value, 0.01)
    assert score_moves(move[None], patch, target, TAU)[0] == pytest.approx(
        land(move, patch, target, TAU)[0].mean(), rel=1e-9)
