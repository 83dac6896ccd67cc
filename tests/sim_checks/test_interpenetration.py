"""Exact overlap: closed forms, rigid invariance, engine contacts beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.collision.depth import depth, point_triangle_distance
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.model.se3 import make, rotation_from_rotvec
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks.blocking import check_combinations
from part2gs_robotics.sim_checks.geometry import overlap, place
from part2gs_robotics.sim_checks.interpenetration import Poser, check_interpenetration, sweep
from part2gs_robotics.sim_checks.order import in_order
from part2gs_robotics.sim_checks.subject import Subject, make_subject

CUBE = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))


@pytest.mark.parametrize(("other", "volume", "deep"), [
    (((0.9, 0.2, 0.2), (2, 0.8, 0.8)), 0.036, 0.1),  # a peg, 0.1 into a face
    (((0.9, -1, -1), (2, 2, 2)), 0.1, 0.1),  # a wall over the whole face
    (((0.95, 0.9, 0.93), (2, 2, 2)), 0.05 * 0.1 * 0.07, 0.05),  # a corner: the shortest way out
    (((0.25, 0.25, 0.25), (0.75, 0.75, 0.75)), 0.125, None),  # swallowed whole
    (((1.0, 0, 0), (2, 1, 1)), 0.0, 0.0),  # touching
    (((1.1, 0, 0), (2, 1, 1)), 0.0, 0.0),  # apart
])  # fmt: skip
def test_boxes_overlap_by_hand(other: tuple, volume: float, deep: float | None) -> None:  # type: ignore[type-arg]
    found = overlap(box(*CUBE).as_original(), box(*other).as_original())
    assert found.volume == pytest.approx(volume, abs=1e-12)
    if deep is not None:
        measured = depth(found.solid) if found.solid is not None else 0.0
        assert measured == pytest.approx(deep, abs=1e-9)


def test_overlap_does_not_depend_on_the_frame() -> None:
    a = box(*CUBE).as_original()
    b = box((0.9, 0.2, 0.2), (2, 0.8, 0.8)).as_original()
    move = make(rotation_from_rotvec(np.array([0.3, 0.7, -1.1])), np.array([5.0, -3.0, 2.0]))
    moved = overlap(place(a, move), place(b, move))
    assert moved.volume == pytest.approx(0.036, rel=1e-9)
    assert depth(moved.solid) == pytest.approx(0.1, rel=1e-6)


def test_point_triangle_distance_against_dense_sampling() -> None:
    rng = np.random.default_rng(0)
    tri, points = rng.normal(size=(6, 3, 3)), rng.normal(size=(7, 3))
    grid = np.array([(i, j, 150 - i - j) for i in range(151) for j in range(151 - i)]) / 150
    dense = np.einsum("gk,tki->tgi", grid, tri)
    brute = np.linalg.norm(points[:, None, None] - dense[None], axis=-1).min(-1)
    exact = point_triangle_distance(points[:, None], tri[None])
    assert (exact <= brute + 1e-12).all()
    # a grid of 150 steps on triangles of size 3 is 0.02 apart: the foot is within 0.02
    assert (brute - exact).max() < 0.02


def subject_of(twin: Twin, folder: Path) -> Subject:
    write_mjcf(twin, folder)
    return make_subject(folder / "twin.xml")


def test_interfering_drawer_is_measured_exactly(tmp_path: Path) -> None:
    """Clearance -2 mm: the walls overlap by 2 mm all along, the engine sees the same."""
    subject = subject_of(toy_cabinet_twin(1, clearance=-0.002), tmp_path)
    curve, worst = sweep(Poser(subject), subject.joints[0], 5)
    # by hand at 0.15: 2 mm of the bottom board, of both sides, of the rims under the shelf
    width, height, bite, board = 0.6 - 2 * 0.018 + 0.004, 0.4 - 0.018 - 0.009, 0.002, 0.012
    along = bite * (width + 2 * height + 2 * board)
    back_rim = bite * board * (width - 2 * board)
    want = along * (0.5 - 0.016 - 0.15) + back_rim
    assert curve.overlap_volume[2] == pytest.approx(want, rel=1e-4)
    # the deepest point is a corner of the drawer, 2 mm inside each of three boards
    assert worst.depth == pytest.approx(0.002 * 3**0.5, rel=1e-3)
    assert curve.overlap_depth[2] == pytest.approx(0.002 * 2**0.5, rel=1e-3)
    assert max(curve.contact_depth) == pytest.approx(0.002, rel=0.2)


def test_clearance_gives_exactly_zero(tmp_path: Path) -> None:
    subject = subject_of(toy_cabinet_twin(3), tmp_path)
    subject, sweeps = in_order(subject, 5)
    rows, curves = check_interpenetration(subject, sweeps)
    rows += check_combinations(subject, sweeps, 8)
    assert all(r.status == "pass" and r.value == 0.0 for r in rows)
    assert [len(c.positions) for c in curves] == [5, 5, 5]


@pytest.mark.parametrize(("deep", "counts"), [(2e-6, False), (1e-3, True)])
def test_flakes_of_rounding_are_no_overlap(tmp_path: Path, deep: float, counts: bool) -> None:
    poser = Poser(subject_of(toy_cabinet_twin(1, clearance=-deep), tmp_path))
    poser.pose(poser.data.qpos.copy())
    assert bool(poser.overlaps(poser.pairs)) == counts
