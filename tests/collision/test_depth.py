"""Depth: closed forms, and flakes that rounding leaves where two faces lie on each other."""

import pytest
from manifold3d import Manifold

from part2gs_robotics.collision.depth import depth
from part2gs_robotics.model.solids import FLAKE
from part2gs_robotics.sim_checks.geometry import overlap

BLOCK = Manifold.cube([1, 1, 1])


def test_a_plug_is_as_deep_as_it_sticks_in() -> None:
    plug = Manifold.cube([0.1, 0.1, 1.0]).translate([0.4, 0.4, 0.93])
    assert depth(BLOCK ^ plug) == pytest.approx(0.07, rel=1e-6)


@pytest.mark.parametrize(("thin", "counts"), [(1e-7, False), (1e-3, True)])
def test_a_flake_counts_only_where_it_is_thick(thin: float, counts: bool) -> None:
    """A sheet, wide and long, that is hardly thick, alone and beside a plug."""
    sheet = Manifold.cube([0.5, 0.5, 1.0]).translate([0.2, 0.2, 1 - thin])
    assert (overlap(BLOCK, sheet, FLAKE).solid is not None) == counts
    plug = Manifold.cube([0.1, 0.1, 1.0]).translate([0.8, 0.8, 0.95])
    assert overlap(BLOCK, sheet + plug, FLAKE).solid is not None
