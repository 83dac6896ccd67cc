"""Cells, gains and faces counted voxel by voxel: the same as by plain array arithmetic."""

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from part2gs_robotics.boards.cell_kernels import borders
from part2gs_robotics.boards.cells import cells_of
from part2gs_robotics.boards.cut import Belief, gain_of
from part2gs_robotics.boards.planes import Family
from part2gs_robotics.boards.rest import DEEP, _deep
from part2gs_robotics.model.grid import Grid

GRID = Grid(np.array([-0.5, -0.4, -0.6]), 0.05, (21, 17, 25))
OBLIQUE = np.array([0.6, -0.8, 0.0])


def some_families(rng: np.random.Generator) -> tuple[Family, ...]:
    normals = (*np.eye(3), -np.eye(3)[2], OBLIQUE, np.array([0.0, 0.6, 0.8]))
    return tuple(Family(normal, np.sort(rng.uniform(-0.5, 0.5, 7))) for normal in normals)


def test_cells_are_told_apart_by_how_many_planes_they_lie_above() -> None:
    families = some_families(np.random.default_rng(0))
    cells = cells_of(GRID, families)
    x, y, z = (GRID.lo[i] + GRID.voxel * np.arange(n) for i, n in enumerate(GRID.shape))
    centers = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1)
    above = np.stack([(centers @ one.normal)[..., None] > one.offsets for one in families], -2)
    assert np.array_equal(cells.digits[cells.of_voxel], above.sum(-1))
    codes = np.ravel_multi_index(tuple(cells.digits.T), (8,) * len(families))
    assert (np.diff(codes) > 0).all()  # in the order of their digits, none twice


def test_a_plane_through_voxel_centres_has_them_below_it() -> None:
    level = GRID.lo[0] + GRID.voxel * 5
    cells = cells_of(GRID, (Family(np.eye(3)[0], np.array([level])),))
    assert (cells.digits[cells.of_voxel][:6] == 0).all()
    assert (cells.digits[cells.of_voxel][6:] == 1).all()


@pytest.mark.parametrize("pairs", [40, 30_000])  # the second more than a table has room for
def test_faces_of_voxels_are_summed_per_pair_of_cells(pairs: int) -> None:
    rng = np.random.default_rng(1)
    of_voxel = rng.integers(0, int(np.sqrt(2 * pairs)), (30, 31, 32), np.int32)
    surface = rng.random(of_voxel.shape).astype(np.float32)
    one, two, cost = borders(of_voxel, surface, 0.5, 0.02)
    count = int(of_voxel.max()) + 1
    wanted = np.zeros((count, count))
    for axis in range(3):
        n = of_voxel.shape[axis] - 1
        low, high = of_voxel.take(range(n), axis), of_voxel.take(range(1, n + 1), axis)
        photo = np.maximum(surface.take(range(n), axis), surface.take(range(1, n + 1), axis))
        faces = np.where(low != high, 0.5 * (1 - photo) + 0.02, 0.0)
        np.add.at(wanted, (np.minimum(low, high), np.maximum(low, high)), faces)
    found = np.zeros((count, count))
    np.add.at(found, (one, two), cost)
    assert (one < two).all()
    assert len(one) == np.count_nonzero(found)  # every pair once
    assert np.allclose(found, wanted, rtol=1e-6)


def test_gains_are_sums_of_belief_and_worth() -> None:
    rng = np.random.default_rng(2)
    cells = cells_of(GRID, some_families(rng))
    inside = rng.normal(size=GRID.shape).astype(np.float32)
    belief = Belief(GRID, inside, np.abs(inside), inside < 0)
    worth = rng.random(GRID.shape)
    for more in (0.0, worth):
        wanted = np.bincount(cells.of_voxel.ravel(), (inside + more).ravel(), len(cells))
        assert np.allclose(gain_of(cells, belief, more), wanted, atol=1e-9)


def test_what_is_deep_is_so_by_distance() -> None:
    rng = np.random.default_rng(3)
    filled = distance_transform_edt(rng.random((20, 21, 22)) > 0.01) > 3
    away = distance_transform_edt(filled) + distance_transform_edt(~filled)
    index = np.argwhere(np.ones(filled.shape, bool))
    deep = _deep(filled, index)
    assert 0.02 < deep.mean() < 0.98
    assert np.array_equal(deep, away.ravel() > DEEP)
