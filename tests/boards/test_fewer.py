"""Fewer planes: those stay that photos or rays ask for, and tilts that explain what was seen."""

from dataclasses import replace

import numpy as np
import pytest
from board_room import AXES, GRID, VOXEL, belief_of, box_distance, points, solid_of, volume

from part2gs_robotics.boards.board_solid import BoardSolid, filled, paying
from part2gs_robotics.boards.cells import cells_of
from part2gs_robotics.boards.cut import gain_of, inside_cells
from part2gs_robotics.boards.fewer import without_idle
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.model.arrays import F64

NOTHING = np.zeros(GRID.shape)
HALF = np.array([0.31, 0.23, 0.41])
LEG = np.array([0.05, 0.05, 0.2])
UNDER = np.array([0.2, 0.2, -0.15])


def with_planes(solid: BoardSolid, offsets: F64) -> BoardSolid:
    """Return a solid whose cells are cut by more planes across every axis."""
    found = tuple(Family(f.normal, np.unique(np.r_[f.offsets, offsets]))
                  for f in solid.cells.families)
    return filled(replace(solid, cells=cells_of(GRID, found)), NOTHING)


def test_planes_that_noise_alone_asks_for_go_and_the_box_stays() -> None:
    rng = np.random.default_rng(1)
    for _ in range(3):
        distance = box_distance(HALF) + rng.normal(0, 0.3 * VOXEL, GRID.shape)
        solid = with_planes(solid_of(distance), rng.uniform(-0.5, 0.5, 8))
        few = paying(solid, NOTHING)
        assert few.cells.planes <= 7 < solid.cells.planes
        assert few.whole.num_tri() == 12
        assert np.allclose(few.whole.bounding_box(), [*-HALF, *HALF], atol=0.6 * VOXEL)


def test_a_plane_that_parts_nothing_is_idle_and_walls_are_not() -> None:
    belief = belief_of(box_distance(HALF))
    walls = tuple(Family(a, np.sort([-h, 0.07, h])) for a, h in zip(AXES, HALF, strict=True))
    cells = cells_of(GRID, walls)
    inside = inside_cells(cells, belief)[0]
    left = without_idle(cells, inside, gain_of(cells, belief, 0.0), 1.0)
    assert [f.offsets.tolist() for f in left] == [[-h, h] for h in HALF]


def table() -> tuple[BoardSolid, F64]:
    """Return a plate and a leg that belief leaves out, and worth of rays that ask for the leg."""
    plate = box_distance(np.array([0.4, 0.4, 0.05]), np.array([0.0, 0.0, 0.1]))
    leg = box_distance(LEG, UNDER)
    solid = solid_of(np.maximum(plate, leg))
    unseen = (leg > 0) & (plate < 0)
    doubtful = np.where(unseen, np.float32(-0.02), solid.belief.inside)
    bare = np.where(leg > plate, np.float32(0.0), solid.belief.surface)
    belief = replace(solid.belief, inside=doubtful.astype(np.float32),
                     surface=bare.astype(np.float32))
    return replace(solid, belief=belief), 10.0 * unseen


def test_a_leg_that_rays_alone_ask_for_keeps_its_planes() -> None:
    solid, worth = table()
    leg = float(8 * LEG.prod())
    without = paying(filled(solid, NOTHING), NOTHING)
    asked = paying(filled(solid, worth), worth)
    assert without.cells.planes < asked.cells.planes
    assert volume(asked) - volume(without) > 0.5 * leg


def hopper(slope: float) -> F64:
    """Return [X, Y, Z] distance to a box whose sides lean outward by a slope, positive inside."""
    away = np.abs(points())
    side = 0.3 + slope * points()[..., 2] - away[..., :2].max(-1)
    return np.minimum(side / np.hypot(1, slope), 0.35 - away[..., 2])


@pytest.mark.parametrize("degrees", [6.0, 9.0])
def test_walls_that_lean_lie_in_one_plane_each(degrees: float) -> None:
    slope = np.tan(np.deg2rad(degrees))
    solid = solid_of(hopper(slope))
    wanted = 8 * 0.35 * (0.3**2 + (slope * 0.35)**2 / 3)
    assert volume(solid) == pytest.approx(wanted, rel=0.03)
    assert solid.whole.num_tri() <= 24  # a stair of straight walls has hundreds


def test_a_bulge_of_half_a_cell_is_no_wall_that_leans() -> None:
    bulge = 0.5 * VOXEL * np.cos(4 * points()[..., 0]) * np.cos(4 * points()[..., 2])
    solid = solid_of(box_distance(HALF) + bulge)
    assert len(solid.cells.families) == 3
    assert len(paying(solid, NOTHING).pieces) == 1
