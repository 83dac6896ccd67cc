"""Chances against closed forms: a board slides over a plate, its axis and its way uncertain."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from synth import toy_cabinet_twin, union_part

from part2gs_robotics.chance import chances
from part2gs_robotics.chance.draws import drawn_joint
from part2gs_robotics.chance.rows import interval
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import size_of
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks.interpenetration import LIMIT

WAY, GAP, DRAWS = 0.3, 0.003, 400


def board(sigma_axis: float, sigma_value: float, stop: float | None = None) -> Twin:
    """A board that slides along x, GAP above a plate; a stop at x = 0.6 + stop."""
    boxes = [((0.0, 0.0, 0.0), (1.0, 0.5, 0.1))]
    if stop is not None:
        boxes.append(((0.6 + stop, 0.0, 0.1), (0.7 + stop, 0.5, 0.3)))
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), WAY, sigma_axis=sigma_axis,
                  sigma_value=sigma_value)
    low = 0.1 + GAP
    slide = union_part("part_1", 0, [((0.1, 0.1, low), (0.3, 0.4, low + 0.05))], joint, (0.0, WAY),
                       (1, 2, 3))
    return Twin("board", (union_part("base", -1, boxes, None, (0, 0), (9, 9, 9)), slide),
                meters_per_unit=1.0, up=np.array([0.0, 0, 1]))


def written(twin: Twin, folder: Path) -> Path:
    write_mjcf(twin, folder)
    write_twin_yaml(twin, folder)
    return folder


def test_a_tilted_slide_touches_as_often_as_the_normal_distribution_says(tmp_path: Path) -> None:
    """At its end the board has sunk by WAY times the tilt: it touches from GAP + limit on."""
    sigma = 0.04
    twin = board(sigma, float("nan"))
    limit = LIMIT * size_of(tuple(p.mesh for p in twin.parts))
    exact = norm.cdf((GAP + limit) / WAY / (sigma / np.sqrt(2)))
    assert 0.6 < exact < 0.9
    free, reached = chances(written(twin, tmp_path), DRAWS)
    for row in (free, reached):
        low, high = interval(round(row.value * DRAWS), DRAWS)
        assert low < exact < high, row
        assert row.status == "warn"
        assert "part_1_joint" in row.detail
        assert "photos" in row.cause


def test_a_slide_runs_into_its_stop_as_often_as_the_normal_distribution_says(
        tmp_path: Path) -> None:
    """Its front is at 0.3 + value: it stands in the stop from 0.6 + stop + limit on."""
    stop, sigma = 0.004, 0.01
    twin = board(float("nan"), sigma, stop)
    limit = LIMIT * size_of(tuple(p.mesh for p in twin.parts))
    exact = norm.cdf((stop + limit) / sigma)
    _, reached = chances(written(twin, tmp_path), DRAWS)
    low, high = interval(round(reached.value * DRAWS), DRAWS)
    assert low < exact < high, reached


def test_draws_have_the_deviations_that_the_file_says() -> None:
    joint = Joint("screw", np.array([0.6, 0, 0.8]), np.ones(3), 2.0, 0.1, sigma_axis=0.01,
                  sigma_origin=0.02, sigma_value=0.03, sigma_rise=0.04)
    rng = np.random.default_rng(1)
    drawn = [drawn_joint(joint, rng) for _ in range(4000)]
    off = np.array([j.axis for j in drawn]) - joint.axis
    assert np.sqrt(np.square(off).sum(1).mean()) == pytest.approx(0.01, rel=0.05)
    shift = np.array([j.origin for j in drawn]) - joint.origin
    assert np.sqrt(np.square(shift).sum(1).mean()) == pytest.approx(0.02, rel=0.05)
    assert np.abs(shift @ joint.axis).max() < 1e-12, "a point on the axis moves across it"
    assert np.std([j.value for j in drawn]) == pytest.approx(0.03, rel=0.05)
    rise = np.array([j.pitch for j in drawn]) * joint.value
    assert np.std(rise) == pytest.approx(0.04, rel=0.05)


def test_certain_joints_are_free_for_certain_and_unknown_ones_are_named(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(2)
    sure = replace(twin.parts[1].joint, sigma_axis=1e-6, sigma_origin=1e-6, sigma_value=1e-6)
    twin = replace(twin, parts=(twin.parts[0], replace(twin.parts[1], joint=sure), twin.parts[2]))
    free, reached = chances(written(twin, tmp_path), 12)
    assert (free.value, reached.value, free.status) == (1.0, 1.0, "pass")
    assert "not drawn, no deviation known: part_2_joint" in free.detail


def test_nothing_to_draw_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CheckError, match="no joint has a known standard deviation"):
        chances(written(board(float("nan"), float("nan")), tmp_path), 5)
    with pytest.raises(CheckError, match="holds no twin"):
        chances(tmp_path / "none", 5)


def test_the_interval_is_the_exact_one() -> None:
    assert interval(0, 20) == pytest.approx((0.0, 1 - 0.025 ** (1 / 20)))
    assert interval(20, 20) == pytest.approx((0.025 ** (1 / 20), 1.0))
