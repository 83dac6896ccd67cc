"""The images of the other state prefer the true motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.cross_render import (
    FAR_SIDE_COST,
    both_cost,
    cross_cost,
    floor_of,
    move_gaussians,
)
from part2gs_robotics.evidence.light import Light
from part2gs_robotics.model import se3
from part2gs_robotics.model.small_views import small_views

SIDE = 80


@pytest.fixture(scope="module")
def moved(toy):
    """A block slid over a base as Gaussians in both states, with photos of both."""
    base, block = toy.Box((0, 0, 0), (0.8, 0.6, 0.3), 1), toy.Box((0, 0, 0.3), (0.4, 0.6, 0.6), 2)
    move = se3.make(np.eye(3), np.array([0.35, 0, 0]))
    after = toy.Box(block.lo, block.hi, 2, move)
    Ks, views = toy.cameras(10, SIDE, np.array([0.4, 0.3, 0.3]), 1.3)
    pairs = [toy.gaussians_of([base, b], 0.025) for b in (block, after)]
    states = [toy.cast([base, b], Ks, views, SIDE) for b in (block, after)]
    return (pairs[0][0], pairs[1][0]), (pairs[0][1], pairs[1][1]), move, states


def test_the_cost_is_lower_at_the_truth_than_anywhere_off_it(moved):
    gaussians, labels, move, states = moved
    views = small_views(states[0], 6, SIDE), small_views(states[1], 6, SIDE)
    eye = np.eye(4)
    truth = both_cost(gaussians, labels, [eye, move], views, (0.5, 0.5))
    for scale in (0.0, 0.8, 1.2, -1.0):
        off = se3.make(np.eye(3), move[:3, 3] * scale)
        assert both_cost(gaussians, labels, [eye, off], views, (0.5, 0.5)) > truth + 0.02
    assert truth < 0.6 * both_cost(gaussians, labels, [eye, eye], views, (0.5, 0.5))


@pytest.fixture(scope="module")
def block(toy):
    """A block's Gaussians, the normals of its sides, and photos of it."""
    lo, hi = np.zeros(3), np.array([0.8, 0.6, 0.5])
    box = toy.Box(tuple(lo), tuple(hi), 1)
    Ks, views = toy.cameras(8, SIDE, 0.5 * hi, 1.3)
    gaussians = toy.gaussians_of([box], 0.025)[0]
    gaps = np.concatenate([gaussians.means - lo, hi - gaussians.means], 1)
    normals = np.concatenate([-np.eye(3), np.eye(3)])[gaps.argmin(1)]
    return gaussians, normals, small_views(toy.drawn(gaussians, Ks, views, SIDE), 6, SIDE)


def test_paint_of_a_side_that_was_not_seen_is_no_evidence(block):
    gaussians, normals, views = block
    labels, still = np.zeros(len(gaussians), np.int64), [np.eye(4)]
    wrong = 1.0 - gaussians.colors

    def cost(colors, normals):
        moved = move_gaussians(gaussians, labels, still)
        moved = moved if colors is None else replace(moved, colors=colors)
        return cross_cost(moved, views, normals)

    seen, plain = (cost(gaussians.colors, n) for n in (normals, None))
    assert seen == pytest.approx(plain, abs=0.03)  # edges show a little of the next side
    inside, told = cost(gaussians.colors, -normals), cost(wrong, normals) - seen
    assert told > 0.2
    assert cost(wrong, -normals) - inside < 0.2 * told  # at edges the inside of a face is seen
    assert inside == pytest.approx(FAR_SIDE_COST, abs=0.05)


def test_normals_turn_with_their_parts(block):
    gaussians, normals, _ = block
    labels = (gaussians.means[:, 0] > 0.4).astype(np.int64)
    turn = se3.screw_motion(np.array([0.0, 0.6, 0.8]), np.array([0.1, 0, 0]), 0.8, 0.1)
    there = Light(np.zeros(8), (normals, normals)).turned(1, labels, [np.eye(4), turn])
    np.testing.assert_array_equal(there[labels == 0], normals[labels == 0])
    np.testing.assert_allclose(there[labels == 1], normals[labels == 1] @ turn[:3, :3].T)


def test_both_directions_add_up_and_a_weightless_one_is_left_out(moved):
    gaussians, labels, move, states = moved
    views = small_views(states[0], 3, 48), small_views(states[1], 3, 48)
    moves, back = [np.eye(4), move], [np.eye(4), se3.inverse(move)]
    there = cross_cost(move_gaussians(gaussians[0], labels[0], moves), views[1])
    home = cross_cost(move_gaussians(gaussians[1], labels[1], back), views[0])
    both = both_cost(gaussians, labels, moves, views, (0.3, 0.7))
    assert both == pytest.approx(0.3 * there + 0.7 * home)
    assert both_cost(gaussians, labels, moves, views, (1.0, 0.0)) == pytest.approx(there)


def test_what_a_state_leaves_in_its_own_photos_is_charged_to_no_motion(moved):
    gaussians, labels, move, states = moved
    views = small_views(states[0], 6, SIDE), small_views(states[1], 6, SIDE)
    net = tuple(replace(v, floor=floor_of(g, v)) for g, v in zip(gaussians, views, strict=True))
    assert net[1].floor.shape == views[1].alphas.shape
    here = cross_cost(gaussians[1].splats, views[1])
    assert here == pytest.approx(float(net[1].floor.sum()) / float(views[1].alphas.sum()), rel=1e-5)
    assert cross_cost(gaussians[1].splats, net[1]) == 0.0

    def cost(scale, views):
        there = se3.make(np.eye(3), scale * move[:3, 3])
        return both_cost(gaussians, labels, [np.eye(4), there], views, (0.5, 0.5))

    assert 0.0 < cost(1.0, net) < 0.5 * cost(1.0, views), "most at the truth is a halo"
    worse = cost(0.8, views) - cost(1.0, views)
    assert cost(0.8, net) - cost(1.0, net) > 0.8 * worse
    assert net[1].select([2, 0]).floor.shape == (2, *net[1].floor.shape[1:])


def test_only_the_part_moves_and_it_turns_with_its_motion(moved):
    gaussians, labels, _, _ = moved
    turn = se3.screw_motion(np.array([0.0, 0.6, 0.8]), np.array([0.1, 0, 0]), 0.8, 0.1)
    drawn = move_gaussians(gaussians[0], labels[0], [np.eye(4), turn])
    base, own = labels[0] == 0, labels[0] == 1
    assert np.array_equal(drawn.means[base], gaussians[0].means[base])
    expected = se3.apply(turn, gaussians[0].means[own].astype(float))
    assert np.allclose(drawn.means[own], expected, atol=1e-6)
    there = turn[:3, :3] @ se3.rotation_from_quats(gaussians[0].quats[own])
    assert np.allclose(se3.rotation_from_quats(drawn.quats[own]), there, atol=1e-5)


def test_small_views_are_spread_training_views_with_scaled_cameras(moved):
    state = replace(moved[3][0], held_out=np.arange(10) == 0)
    small = small_views(state, 4, SIDE // 2)
    assert small.colors.shape == (4, SIDE // 2, SIDE // 2, 3)
    assert np.allclose(small.Ks[:, :2], state.Ks[:4, :2] / 2)
    assert not (small.viewmats == state.viewmats[0]).all((1, 2)).any()
    assert small_views(state, 99, SIDE).colors.shape[0] == 9
    assert (small.colors <= small.alphas[..., None] + 1e-6).all()  # premultiplied
