"""The optimiser at the ends of its range: finite, bounded, and a NaN that says where it is."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from part2gs_robotics.errors import FitError
from part2gs_robotics.fit.fit_state import RATES, FitConfig, FitRun
from part2gs_robotics.fit.step import gaussians_of, opacity_term
from part2gs_robotics.fit.tones import tones_of
from part2gs_robotics.model import se3
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.points import tree_of
from part2gs_robotics.paper import losses
from part2gs_robotics.paper.identity import refine_identities
from part2gs_robotics.paper.neighbourhood import part_neighbors
from part2gs_robotics.paper.repel import repel_forces, repel_points
from part2gs_robotics.runtime.adam import Adam

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")
MANY = 100_000
VOXEL = 0.01
BETA1, BETA2 = Adam({}).betas
# Cauchy-Schwarz on the moments: |m| / sqrt(v) of any gradients, in rates; 7.27.
LONGEST = (1 - BETA1) / np.sqrt((1 - BETA2) * (1 - BETA1**2 / BETA2))
SLIDER = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.5)
CONFIG = FitConfig(steps=100, half_steps=0, start_gaussians=100, max_gaussians=200,
                   hull_resolution=24)


def heap(count, spread=0.0, logit=-2.0):
    """Gaussians in a cube of side `spread`, all at one place when it is 0."""
    rng, f32 = np.random.default_rng(0), np.float32
    return Gaussians(
        (0.2 + spread * rng.random((count, 3))).astype(f32), np.tile([1, 0, 0, 0], (count, 1))
        .astype(f32), np.full((count, 3), np.log(VOXEL), f32), np.full(count, logit, f32),
        np.zeros((count, 3), f32), np.zeros((count, 0, 3), f32))


@pytest.fixture(scope="module")
def photos(toy):
    """Eight small photos of a box, without depth images."""
    state = toy.cast([toy.Box((0, 0, 0), (0.4, 0.4, 0.4), 1)],
                     *toy.cameras(8, 24, np.full(3, 0.2), 0.8), 24)
    return replace(state, depths=None)


def one_color(state, level):
    return replace(state, images=np.full_like(state.images, level))


def run_of(state, first, config=CONFIG):
    return FitRun(state, tones_of(state), first, None, config, "state 1")


def assert_finite(run):
    for name, value in run.params.items():
        assert np.isfinite(value).all(), name


def test_no_step_of_adam_exceeds_its_bound_and_the_bound_is_reached():
    adam, params = Adam({"x": 0.1}), {"x": np.zeros(1)}
    adam.step(params, {"x": np.ones(1)})
    adam.steps = 20_000  # bias terms have gone when the row comes
    adam.select(np.array([False]))
    adam.append(1)
    params, steps = {"x": np.zeros(1)}, []
    for k in range(60):  # where Cauchy-Schwarz is an equality
        before = params["x"].copy()
        adam.step(params, {"x": np.array([(BETA2 / BETA1) ** k])})
        steps.append(float(np.abs(params["x"] - before)[0]) / 0.1)
    assert 0.99 * LONGEST < max(steps) <= LONGEST
    assert LONGEST == pytest.approx(7.27, abs=0.01)


@pytest.mark.parametrize("size", [0.0, 1e-38, 1e-20, 1.0, 1e15, 1e25, 3e38])
def test_gradients_of_any_size_give_finite_bounded_steps(size):
    adam, rng = Adam({"x": 0.1}), np.random.default_rng(0)
    params = {"x": np.zeros(50, np.float32)}
    for _ in range(20):
        before = params["x"].copy()
        adam.step(params, {"x": (size * rng.uniform(-1, 1, 50)).astype(np.float32)})
        assert np.abs(params["x"] - before).max() <= 0.1 * LONGEST
    later = params["x"].copy()
    for _ in range(20000 if size < 1e16 else 1):  # and the row is not stuck for ever
        adam.step(params, {"x": np.ones(50, np.float32)})
        if np.abs(params["x"] - later).max() > 0.01:
            break
    assert np.isfinite(params["x"]).all()


@pytest.mark.parametrize("spread", [0.0, VOXEL])
def test_a_hundred_thousand_gaussians_on_one_voxel_are_fitted(photos, spread):
    run = run_of(photos, heap(MANY, spread))
    rates = {**RATES, "means": RATES["means"] * run.diagonal}
    tracemalloc.start()
    for step in (1, 2, 3):
        before = {k: v.copy() for k, v in run.params.items()}
        run.step(step)
        for name, value in run.params.items():
            slack = 1e-6 * np.abs(value).max()  # rounding of the sum
            assert np.abs(value - before[name]).max() <= LONGEST * rates[name] + slack, name
    run.step(50)  # prunes and splits
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert_finite(run)
    assert run.count <= MANY  # above the cap nothing is split
    assert peak < 400e6


def test_coincident_gaussians_split_up_to_the_cap(photos):
    run = run_of(photos, heap(100, logit=0.0), replace(CONFIG, max_gaussians=130))
    for step in range(48, 62):
        run.step(step)
    assert_finite(run)
    assert 100 < run.count <= 130
    assert np.ptp(run.params["means"], axis=0).max() > 0  # halves lie beside each other


@pytest.mark.parametrize("paper_mode", [False, True])
def test_states_of_one_place_have_a_field(load, paper_mode):
    one, other = heap(MANY), replace(heap(MANY), means=heap(MANY).means + np.float32(0.5))
    for pair, moved in (((one, one), 0.0), ((one, other), 0.5 * 3**0.5)):
        field = load("averaged_field").canonical_field(*pair, paper_mode, 100)
        assert field.richness == pytest.approx((moved, moved), rel=1e-6)
        assert field.richness_weight == pytest.approx(0.5)
        assert all(np.isfinite(g.means).all() for g in field.gaussians)


@pytest.mark.parametrize("copies", [1, 3])
def test_thinned_trees_know_the_true_distances(copies):
    rng = np.random.default_rng(0)
    points = rng.integers(0, 4, (400, 3)).astype(float)
    queries = rng.uniform(-1, 5, (50, 3))
    tree, kept = tree_of(points, copies)
    found, index = tree.query(queries, k=copies)
    np.testing.assert_array_equal(found, cKDTree(points).query(queries, k=copies)[0])
    gaps = np.linalg.norm(points[kept[index]].reshape(50, -1, 3) - queries[:, None], axis=2)
    np.testing.assert_allclose(gaps, np.reshape(found, gaps.shape))
    assert np.unique(points[kept], axis=0, return_counts=True)[1].max() == copies
    np.testing.assert_array_equal(tree_of(queries, copies)[1], np.arange(50))


def test_identities_of_coincident_gaussians_are_finite_and_follow_their_evidence():
    neighbors = part_neighbors(heap(MANY).means)
    assert neighbors.shape == (MANY, 8)
    assert (neighbors != np.arange(MANY)[:, None]).all()
    g = heap(4000)
    g.means[::50] += np.float32(0.3)  # some elsewhere: nine coincide, the next is far
    known = np.zeros((4000, 2))
    known[:, 0] = 2.0
    for probs in refine_identities(known, known, (g, g), [SLIDER]):
        assert np.isfinite(probs).all()
        assert (probs.argmax(1) == 1).all()
    for probs in refine_identities(0 * known, 0 * known, (g, g), [SLIDER]):
        np.testing.assert_allclose(probs.sum(1), 1, rtol=1e-5)


@pytest.mark.parametrize("paper", [False, True])
def test_repel_points_at_no_distance_push_by_no_more_than_half_a_voxel(paper):
    points = heap(MANY).means.astype(float)
    seam = repel_points([(points, points)], max_points=50)
    assert len(seam) == 50
    for off in (0.0, 1e-300, 1e-12, 1e-6, 1e-3):
        force = repel_forces(points[:3] + off, seam, VOXEL, paper=paper)
        assert np.isfinite(force).all()
        assert paper or np.linalg.norm(force, axis=1).max() <= 0.5 * VOXEL * (1 + 1e-12)
        assert off > 0 or not force.any()


@pytest.mark.parametrize("paper", [False, True])
def test_physical_losses_of_coincident_points_are_finite(paper):
    def leaf(values):
        return torch.tensor(values, dtype=torch.float64, requires_grad=True)

    points = leaf(np.full((MANY, 3), 0.2))
    cloud, weights = points.detach().clone(), torch.ones(MANY, 1, dtype=torch.float64)
    turn, way = leaf(np.eye(3)[None]), leaf(np.zeros((1, 3)))
    found = (
        losses.contact_loss(points, cloud, lambda p: p[..., 0] - 0.3, paper=paper),
        losses.velocity_loss(points, cloud, weights, paper=paper),
        losses.vector_field_loss(points, cloud, turn, way, weights, losses.Form(paper)),
        losses.articulation_loss(turn[0], way[0], (points, cloud), form=losses.Form(paper)))
    sum(found).backward()
    assert all(torch.isfinite(one) for one in found)
    assert all(torch.isfinite(x.grad).all() for x in (points, turn, way))


def test_quaternions_of_any_length_turn_into_rotations():
    ways = np.random.default_rng(0).normal(size=(6, 4)).astype(np.float32)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for length in (0.0, 1e-45, 1e-30, 1e-17, 1e-12, 1.0, 1e12, 1e18):
        for dtype in (np.float32, np.float64):
            rots = se3.rotation_from_quats((ways * length).astype(dtype)).astype(float)
            eye = np.broadcast_to(np.eye(3), rots.shape)
            np.testing.assert_allclose(rots @ rots.swapaxes(1, 2), eye, atol=1e-6)
            expected = se3.rotation_from_quats(ways) if length > 1e-16 else eye
            np.testing.assert_allclose(rots, expected, atol=1e-6)


def test_a_step_with_degenerate_gaussians_is_finite(photos):
    g = replace(heap(60, 0.3), logit_opacities=np.resize([0, 100, -100], 60).astype(np.float32))
    g.log_scales[:20] = np.log([1e-30, 1e20, 1e-2]).astype(np.float32)  # needles and walls
    g.log_scales[20:30] = np.float32(np.log(1e-30))
    g.quats[::3] *= np.resize([0, 1e-30, 1e-15, 1e15], 20).astype(np.float32)[:, None]
    run = run_of(photos, g)
    run.step(1)
    assert_finite(run)
    assert np.linalg.norm(gaussians_of(run.params).quats, axis=1) == pytest.approx(1, abs=1e-5)
    loss, grad = opacity_term(np.array([-1e30, -100, 0, 100, 1e30], np.float32), 1.0)
    assert loss == pytest.approx(0.25 / 5)
    assert np.abs(grad).max() < 1e-30
    g.log_scales[0] = np.log([1e-30, 1e30, 1e-2]).astype(np.float32)
    with pytest.raises(FitError, match=r"state 1, step 1: .* 'gradient of means'"):
        run_of(photos, g).step(1)
    g.log_scales[5] = -np.inf  # a scale of exactly 0 has no logarithm
    with pytest.raises(FitError, match="state 1, step 1: 3 of 180 values of 'log_scales'"):
        run_of(photos, g).step(1)
