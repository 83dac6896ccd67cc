"""Make room: what a part sweeps is cut out of what it passes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold

from part2gs_robotics.boards.cut import Belief
from part2gs_robotics.mesh.make_room import all_apart
from part2gs_robotics.model.grid import Grid
from part2gs_robotics.model.joint import Joint

VOXEL = 0.01
GRID = Grid(np.array([-1.0, -1, -1]), VOXEL, (4, 4, 4))


def belief(inside: float) -> Belief:
    """Return what photos say: of every place the same."""
    one = np.full(GRID.shape, inside, np.float32)
    return Belief(GRID, one, np.zeros_like(one), one > 1)


UNKNOWN = [belief(0.0)] * 3


def world(value: float = 0.5) -> Any:
    """Return where a slide along x has its two parts: what `all_apart` asks of a Place."""
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), value)
    return SimpleNamespace(count=2, joints=(joint,), parents=(0,))


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Manifold:
    size = np.array(high) - low
    return Manifold.cube(size.tolist()).translate(low)


@pytest.mark.parametrize("empty", [False, True])
def test_the_base_makes_room_for_a_slide_and_empty_pieces_sweep_nothing(empty: bool) -> None:
    base, slide = box((-1, -1, -1), (1, 1, 1)), box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    pieces = [slide, Manifold()] if empty else [slide]
    cut, same = all_apart([base, slide], [[base], pieces], world(), UNKNOWN)
    assert same.volume() == pytest.approx(slide.volume(), rel=1e-9)
    gap = 2 * 0.15 * VOXEL
    assert 8 - cut.volume() == pytest.approx((0.9 + gap) * (0.4 + gap) ** 2, rel=1e-3)
    for q in np.linspace(0, 0.5, 7):
        assert (cut ^ slide.translate([q, 0, 0])).volume() == 0


def test_what_is_not_in_the_way_stays_as_it_is() -> None:
    base, slide = box((-1, -1, -1), (1, 1, -0.5)), box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    cut, _ = all_apart([base, slide], [[base], [slide]], world(), UNKNOWN)
    assert cut is base


@pytest.mark.parametrize("shift", [0.03, 0.2])
def test_two_slides_side_by_side_are_apart_wherever_both_stand(shift: float) -> None:
    """A lump of the one hangs into the way of the other; their ends may lie near to each other."""
    joints = tuple(Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), value)
                   for value in (0.5, 0.5 - shift))
    place = SimpleNamespace(count=3, joints=joints, parents=(0, 0))
    base = box((-1, -1, -2), (1, 1, -1.5))
    bodies = [box((-0.3, -0.3, 0.0), (0.3, 0.3, 0.2)), box((0.2, -0.3, -0.05), (0.3, -0.2, 0.1))]
    lower = box((-0.3, -0.3, -0.2), (0.3, 0.3, -0.01))
    pieces, upper = [[base], bodies, [lower]], bodies[0] + bodies[1]
    _, one, two = all_apart([base, upper, lower], pieces, place, UNKNOWN)
    for q in np.linspace(0, 0.5, 7):
        for r in np.linspace(0, 0.5 - shift, 7):
            assert (one.translate([q, 0, 0]) ^ two.translate([r, 0, 0])).volume() < 1e-12


@pytest.mark.parametrize("order", [(1, 2), (2, 1)])
@pytest.mark.parametrize("surer", ["large", "small", None])
def test_of_two_that_move_the_one_yields_of_which_photos_say_less(order: tuple[int, int],
                                                                  surer: str | None) -> None:
    """A large slide with a lump where a small one is, whichever comes first.

    Where photos tell nothing, the one yields that loses the smaller share of itself.
    """
    joints = tuple(Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.5) for _ in order)
    place = SimpleNamespace(count=3, joints=joints, parents=(0, 0))
    base, small = box((-1, -1, -2), (1, 1, -1.5)), box((0.0, 0.0, 0.0), (0.1, 0.1, 0.1))
    bodies = [box((-0.9, -0.9, -0.5), (0.3, 0.9, -0.02)), box((0.0, 0.0, -0.1), (0.1, 0.1, 0.06))]
    large, told = bodies[0] + bodies[1], [belief(0.0)] * 3
    told[order[surer == "small"]] = belief(0.0 if surer is None else 0.8)
    solids = {0: base, order[0]: large, order[1]: small}
    pieces = {0: [base], order[0]: bodies, order[1]: [small]}
    out = all_apart([solids[k] for k in range(3)], [pieces[k] for k in range(3)], place, told)
    kept = out[order[0]] if surer == "large" else out[order[1]]
    assert kept.volume() == pytest.approx((large if surer == "large" else small).volume(), rel=1e-6)
    for q in [0.0] if surer == "large" else np.linspace(-0.5, 0.5, 9):
        assert (out[order[0]] ^ out[order[1]].translate([q, 0, 0])).volume() < 1e-12
