"""Passage: whatever a part would carry through another part's front does not belong to it."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.decide.passage import PASS_COST, WAITS, Seen, passage_costs, through
from part2gs_robotics.model.joint import Joint

CELL = 0.01
OUT = np.array([1.0, 0.0, 0.0])  # drawers open this way


def sheet(lo, hi) -> np.ndarray:
    """Return points a cell apart on an axis-aligned rectangle or in a box."""
    axes = [np.arange(a, b + 0.5 * CELL, CELL) for a, b in zip(lo, hi, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def drawers() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[Joint]]:
    """Return points, normals, state, owner (negative = asked about) of two drawers in a column.

    Fronts at x = 0 in state 0, seen in both states; the lower drawer's left wall in state 1 only.
    """
    joints = [Joint("prismatic", OUT, np.zeros(3), v) for v in (0.2, 0.3)]
    points, late, owner = [], [], []
    for part, low in ((1, 0.2), (2, 0.0)):
        front = sheet((0.0, -0.2, low + 0.01), (0.0, 0.2, low + 0.19))
        for state in (0, 1):
            points.append(front + state * joints[part - 1].value * OUT)
            late.append(np.full(len(front), bool(state)))
            owner.append(np.full(len(front), part))
    wall = sheet((0.12, -0.2, 0.02), (0.24, -0.2, 0.18))
    points.append(wall)
    late.append(np.ones(len(wall), bool))
    owner.append(np.full(len(wall), -2))
    normals = np.tile(OUT, (sum(map(len, points)), 1))
    normals[-len(wall):] = (0.0, -1.0, 0.0)
    return np.concatenate(points), normals, np.concatenate(late), np.concatenate(owner), joints


def costs_of(case, parents=(0, 0)) -> np.ndarray:
    points, normals, late, owner, joints = case
    seen = Seen(points, normals, late, owner[:, None] == np.arange(len(joints) + 1))
    return passage_costs(seen, np.flatnonzero(owner < 0), joints, parents, CELL)


def test_a_wall_behind_a_front_belongs_to_no_other_drawer() -> None:
    costs = costs_of(drawers())
    np.testing.assert_array_equal(costs[:, 2], 0.0)  # its own drawer
    assert (costs[:, 1] == PASS_COST).mean() > 0.95  # the upper drawer meets the lower front
    assert (costs[:, 0] == PASS_COST).mean() > 0.95  # and that front would sweep a still wall


@pytest.mark.parametrize("carrier", [1, 2])
def test_a_part_meets_what_its_carrier_meets(carrier) -> None:
    """A box that stands in a drawer is pulled out with it; no other label hears of that."""
    points, normals, late, owner, joints = drawers()
    box = Joint("prismatic", OUT, np.zeros(3), 0.0, carrier=joints[carrier - 1].state1_from_0)
    costs = costs_of((points, normals, late, owner, [*joints, box]), (0, 0, carrier))
    np.testing.assert_array_equal(costs[:, 3], costs[:, carrier])
    np.testing.assert_array_equal(costs[:, :3], costs_of((points, normals, late, owner, joints)))


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_costs_know_no_unit(scale) -> None:
    points, normals, late, owner, joints = drawers()
    seen = Seen(scale * points, normals, late, owner[:, None] == np.arange(3))
    asked = np.flatnonzero(owner < 0)
    large = [Joint(j.kind, j.axis, scale * j.origin, scale * j.value) for j in joints]
    np.testing.assert_array_equal(
        passage_costs(seen, asked, large, (0, 0), scale * CELL),
        costs_of((points, normals, late, owner, joints)))


def test_labels_may_be_renumbered() -> None:
    points, normals, late, owner, joints = drawers()
    swap = np.array([-2, -1, 0, 2, 1])  # of owners -2..2; the asked ones stay asked
    swapped = costs_of((points, normals, late, swap[owner + 2], joints[::-1]))
    np.testing.assert_array_equal(swapped[:, [0, 2, 1]], costs_of((points, normals, late, owner,
                                                                   joints)))


def test_parts_that_really_cross_say_nothing(monkeypatch) -> None:
    """A drawer behind a door passes through where the closed door is: that proves no label."""
    door = Joint("revolute", np.array([0.0, 0.0, 1.0]), np.array([0.02, -0.2, 0.0]), -1.4)
    drawer = Joint("prismatic", OUT, np.zeros(3), 0.6)
    leaf = sheet((0.05, -0.2, 0.0), (0.05, 0.2, 0.2))
    front = sheet((-0.05, -0.18, 0.02), (-0.05, 0.18, 0.15))
    rim = sheet((0.47, -0.18, 0.18), (0.54, -0.18, 0.19))  # over the front, out of the door's reach
    points = np.concatenate([leaf, front, rim])
    normals = np.tile(OUT, (len(points), 1))
    late = np.repeat([False, False, True], [len(leaf), len(front), len(rim)])
    owner = np.repeat([1, 2, -2], [len(leaf), len(front), len(rim)])
    costs = costs_of((points, normals, late, owner, [door, drawer]))
    assert costs[:, 2].max() == 0.0
    monkeypatch.setattr("part2gs_robotics.decide.passage.REAL", 2.0)  # were nothing a real crossing
    charged = costs_of((points, normals, late, owner, [door, drawer]))
    assert charged[:, 2].min() == PASS_COST


def test_without_proofs_nothing_is_said() -> None:
    points, normals, late, owner, joints = drawers()
    seen = Seen(points, normals, late, np.zeros((len(points), 3), bool))
    asked = np.flatnonzero(owner < 0)
    assert not passage_costs(seen, asked, joints, (0, 0), CELL).any()


UP = np.array([0.0, 0.0, 1.0])


def crossing(*others, joints, scale=1.0) -> np.ndarray:
    """Return `through` of a plate at z = 0 that moves by the first joint, and of other parts.

    others: (part, points in state 0, normal), seen in both states; the base is part 0.
    """
    plate = sheet((0.0, 0.0, 0.0), (0.3, 0.3, 0.0))
    moves = [np.eye(4), *(j.state1_from_0 for j in joints)]
    points, normals, late, owner = [], [], [], []
    for part, own, normal in ((1, plate, UP), *others):
        for state in (0, 1):
            move = moves[part] if state else np.eye(4)
            points.append(own @ move[:3, :3].T + move[:3, 3])
            normals.append(np.tile(move[:3, :3] @ normal, (len(own), 1)))
            late.append(np.full(len(own), bool(state)))
            owner.append(np.full(len(own), part))
    seen = Seen(scale * np.concatenate(points), np.concatenate(normals), np.concatenate(late),
                np.concatenate(owner)[:, None] == np.arange(len(joints) + 1))
    large = [Joint(j.kind, j.axis, scale * j.origin, scale * j.value) for j in joints]
    return through(seen, large, (0,) * len(joints), scale * CELL)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("shelf", "told"), [(0.3, 1.0), (0.04, 0.61), (0.02, 0.0)])
def test_what_goes_through_a_shelf_is_no_part(shelf, told, scale) -> None:
    """The inside of one drawer lands on that of the one above it; what share is stopped decides.

    Of 31 rows of the plate a shelf stops all, 5 (16 %) or 3 (less than a tenth).
    """
    lift = Joint("prismatic", UP, np.zeros(3), 0.4)
    wide = sheet((0.0, 0.0, 0.2), (shelf, 0.3, 0.2))
    found = crossing((0, wide, UP), joints=[lift], scale=scale)
    assert found == pytest.approx([told], abs=0.02)


def test_what_stands_aside_stops_nothing() -> None:
    lift = Joint("prismatic", UP, np.zeros(3), 0.4)
    beside = sheet((0.4, 0.0, 0.2), (0.7, 0.3, 0.2))
    assert crossing((0, beside, UP), joints=[lift]) == pytest.approx([0.0])


@pytest.mark.parametrize("above", [-0.02, 0.0, 0.02])
def test_what_slides_along_a_wall_is_free(above) -> None:
    """A wall within its noise, longer than the slide: the plate comes from beside, or is in it."""
    along = Joint("prismatic", OUT, np.zeros(3), 0.5)
    wall = sheet((-0.1, 0.0, above), (0.9, 0.3, above))
    assert crossing((0, wall, UP), joints=[along]) == pytest.approx([0.0])


@pytest.mark.parametrize(("opens", "told"), [(0.8, 0.0), (0.4, WAITS), (0.01, 1.0)])
def test_a_part_may_go_where_another_has_gone_out_of_its_way(opens, told) -> None:
    """A drawer behind a shutter that slides aside; behind one that hardly moves it is stuck.

    That it must wait until a slow one is gone is a little strange: most parts move at once.
    """
    lift = Joint("prismatic", UP, np.zeros(3), 0.4)
    aside = Joint("prismatic", OUT, np.zeros(3), opens)
    shutter = sheet((0.0, 0.0, 0.2), (0.3, 0.3, 0.2))
    assert crossing((2, shutter, UP), joints=[lift, aside])[0] == pytest.approx(told, abs=0.1)


def test_nothing_that_lands_goes_through_nothing() -> None:
    points, normals, late, _, joints = drawers()
    seen = Seen(points, normals, late, np.zeros((len(points), 3), bool))
    assert not through(seen, joints, (0, 0), CELL).any()
