"""Standard deviations of aligned joints: calibrated, scaled by noise and views, honest if blind."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.joints.align import AlignmentProblem, align
from part2gs_robotics.model import se3


@pytest.fixture(scope="module")
def sim(load):
    return load("joint_sigma")


def sigmas(joint):
    found = [joint.sigma_axis, joint.sigma_value]
    return np.array([*found, joint.sigma_origin] if joint.kind == "revolute" else found)


@pytest.mark.slow
def test_the_truth_lies_inside_nine_of_ten_intervals(sim):
    rows = [sim.ratios(kind, "pixels", 30, first=5000) for kind in sim.KINDS]
    for quantity, width in sim.QUANTITIES.items():
        ratio = np.concatenate([r[quantity] for r in rows])
        ratio = ratio[~np.isnan(ratio)]
        n = len(ratio)
        # 2.6 standard deviations of a binomial: 1 in 100 for a share of 0.9
        assert abs((ratio < width).mean() - 0.9) < 2.6 * math.sqrt(0.09 / n), quantity


@pytest.mark.slow
def test_bent_gaussians_widen_the_intervals_as_far_as_the_errors(sim):
    ratio = sim.ratios("screw", "geometry", 30, first=5000)
    for quantity in sim.QUANTITIES:
        assert 0.7 < np.sqrt(np.mean(ratio[quantity] ** 2)) < 1.8, quantity


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_sigma_grows_with_the_noise_and_shrinks_with_the_root_of_the_views(sim, kind):
    one, loud, many = (
        np.median([sigmas(sim.trial(kind, "pixels", seed, grey, count)[1]) for seed in range(4)], 0)
        for grey, count in ((1.5, 6), (3.0, 6), (1.5, 24))
    )
    np.testing.assert_allclose(loud / one, 2.0, rtol=0.15)
    np.testing.assert_allclose(one / many, 2.0, rtol=0.25)


def knob(sim, rng, stripe):
    """A box with a round knob on its front, of one colour or with a dark stripe, turned by 0.6."""
    base = sim.box(np.zeros(3), np.array([0.5, 0.4, 0.5]), 0.05, rng)
    radius, depth = 0.15, 0.08
    around = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = [(radius * np.cos(a), -y, radius * np.sin(a)) for a in around for y in (0.02, 0.05, 0.08)]
    ways = [(r * np.cos(a), -depth, r * np.sin(a)) for r in np.linspace(0.01, radius, 7)
            for a in np.linspace(0, 2 * np.pi, max(6, int(280 * r)), endpoint=False)]
    local = np.array([*rim, *ways])
    n = len(local)
    colors = np.full((n, 3), 0.3)
    if stripe:
        colors[(np.abs(local[:, 0]) < 0.05) & (local[:, 2] > 0)] = 0.9
    part = sim.Gaussians(
        (local + np.array([0.25, 0, 0.25])).astype(np.float32),
        np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        np.full((n, 3), np.log(0.02), np.float32), np.full(n, 4.0, np.float32),
        ((colors - 0.5) / sim.SH_C0).astype(np.float32), np.zeros((n, 0, 3), np.float32))
    truth = sim.Joint("revolute", np.array([0.0, -1, 0]), np.array([0.25, 0, 0.25]), 0.6)
    labels = np.repeat([0, 1], [len(base), n])
    zero = sim.joined(base, part)
    one = sim.moved(zero, labels, truth.transform(truth.value))
    start = replace(truth, value=0.62, axis=se3.rotation_from_rotvec(np.array([0.01, 0, 0]))
                    @ truth.axis)
    eyes = [sim.cameras(8, 72, np.array([0.25, 0.2, 0.25]), 0.9, sim.random_rotation(rng))
            for _ in range(2)]
    return sim.Draw(truth, start, (zero, one), labels, (eyes[0][0], eyes[1][0]),
                    (eyes[0][1], eyes[1][1]), 72, 0.8)


def problem_of(d, labels, photos):
    return AlignmentProblem(d.gaussians, (labels, labels), photos, d.diag)


@pytest.mark.parametrize("stripe", [False, True])
def test_the_turn_of_a_knob_of_one_colour_is_unobservable(sim, stripe):
    rng = np.random.default_rng(3)
    d = knob(sim, rng, stripe)
    found, = align(problem_of(d, d.labels, sim.photos(d, 3.0, rng)), [d.start])
    assert math.isinf(found.sigma_value) == (not stripe)
    if stripe:
        assert abs(found.value - d.truth.value) < 4 * found.sigma_value < 0.1


def test_a_part_that_no_pixel_shows_is_unobservable(sim):
    rng = np.random.default_rng(4)
    d = sim.draw("revolute", rng)
    nobody = np.zeros_like(d.labels)
    found, = align(problem_of(d, nobody, sim.photos(d, 3.0, rng)), [d.start])
    assert np.isinf(sigmas(found)).all()
    assert found.value == d.start.value
