"""Joined: boards of one box become one, others stay, and there are never more than wanted."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.collision.joined import Hull, hull, joined


def block(low: tuple[float, ...], high: tuple[float, ...]) -> Hull:
    pick = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    corners = np.where(pick, np.array(high), np.array(low)).astype(float)
    return hull(corners, float(np.prod(np.array(high) - low)))


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_slices_of_a_box_become_the_box(count: int) -> None:
    slices = [block((i, 0, 0), (i + 1, 1, 1)) for i in range(count)]
    found = joined(slices, 32, 0.01, 1e-6)
    assert len(found) == min(count, 1)
    assert sum(one.volume for one in found) == pytest.approx(count)


def test_an_ell_stays_two_boards_unless_one_is_asked_for() -> None:
    ell = [block((0, 0, 0), (3, 1, 1)), block((0, 1, 0), (1, 3, 1))]
    assert len(joined(ell, 32, 0.01, 1e-6)) == 2
    (one,) = joined(ell, 1, 0.01, 1e-6)
    assert one.volume == pytest.approx(7)
    assert one.excess == pytest.approx(2)


def test_far_pieces_are_joined_last_but_the_count_holds() -> None:
    far = [block((10 * i, 0, 0), (10 * i + 1, 1, 1)) for i in range(3)]
    assert len(joined(far, 3, 0.01, 0.1)) == 3
    assert len(joined(far, 2, 0.01, 0.1)) == 2


def test_flat_points_have_no_hull() -> None:
    assert hull(np.zeros((4, 3)), 1.0).volume == 0.0
