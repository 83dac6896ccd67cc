"""Make room: what a part sweeps is cut out of what it passes."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from manifold3d import Manifold

from part2gs_robotics.mesh.make_room import all_apart, without
from part2gs_robotics.model.joint import Joint

VOXEL = 0.01


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
    cut, same = all_apart([base, slide], [[base], pieces], world(), VOXEL)
    assert same.volume() == pytest.approx(slide.volume(), rel=1e-9)
    gap = 2 * 0.15 * VOXEL
    assert 8 - cut.volume() == pytest.approx((0.9 + gap) * (0.4 + gap) ** 2, rel=1e-3)
    for q in np.linspace(0, 0.5, 7):
        assert (cut ^ slide.translate([q, 0, 0])).volume() == 0


def test_what_is_not_in_the_way_stays_as_it_is() -> None:
    base, slide = box((-1, -1, -1), (1, 1, -0.5)), box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    cut, _ = all_apart([base, slide], [[base], [slide]], world(), VOXEL)
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
    _, one, two = all_apart([base, upper, lower], pieces, place, VOXEL)
    for q in np.linspace(0, 0.5, 7):
        for r in np.linspace(0, 0.5 - shift, 7):
            assert (one.translate([q, 0, 0]) ^ two.translate([r, 0, 0])).volume() < 1e-12


def test_a_part_without_convex_pieces_sweeps_nothing_and_still_yields() -> None:
    base, slide = box((-1, -1, -1), (1, 1, 1)), box((-0.2, -0.2, -0.2), (0.2, 0.2, 0.2))
    cut, same = all_apart([base, slide], [[base], []], world(), VOXEL)
    assert cut is base
    assert same is slide
    cut, _ = all_apart([base, slide], [[], [slide]], world(), VOXEL)
    assert cut.volume() < 8 - 0.9 * 0.4**2


@pytest.mark.parametrize("door_first", [True, False])
def test_a_door_clears_a_drawer_however_far_that_is_out(door_first: bool) -> None:
    """The door's lower edge hangs into the drawer's way, but only while the drawer is half out."""
    slide = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.6)
    hinge = Joint("revolute", np.array([0, 0, 1.0]), np.array([0.0, -0.4, 0]), -1.2)
    drawer = box((-0.5, -0.3, 0), (0.0, 0.3, 0.2)) + box((-0.3, 0.1, 0.2), (-0.25, 0.15, 0.23))
    door = box((0.01, -0.4, 0.21), (0.04, 0.4, 0.6))
    lumps = [box((-0.5, -0.3, 0), (0.0, 0.3, 0.2)), box((-0.3, 0.1, 0.2), (-0.25, 0.15, 0.23))]
    base = box((-1, -1, -2), (1, 1, -1.5))
    solids, pieces, joints = [drawer, door], [lumps, [door]], [slide, hinge]
    order = [1, 0] if door_first else [0, 1]
    place = SimpleNamespace(count=3, joints=tuple(joints[i] for i in order), parents=(0, 0))
    out = all_apart([base, *(solids[i] for i in order)], [[base], *(pieces[i] for i in order)],
                    place, VOXEL)[1:]
    left = dict(zip(order, out, strict=True))
    assert left[1 if door_first else 0].volume() == pytest.approx(
        solids[1 if door_first else 0].volume())
    met = 0.0
    for q in np.linspace(0, 0.6, 13):
        for r in np.linspace(0, -1.2, 13):
            poses = slide.transform(q)[:3], hinge.transform(r)[:3]
            met += (drawer.transform(poses[0]) ^ door.transform(poses[1])).volume()
            assert (left[0].transform(poses[0]) ^ left[1].transform(poses[1])).volume() < 1e-12
    assert met > 0, "uncut they meet"


def test_a_groove_of_many_tools_is_as_plain_as_one_of_one() -> None:
    """Faces of a solid cut by several tools lie in one plane: no seam is left where tools meet."""
    solid = box((0, 0, 0), (1, 1, 1)) + box((1 - 1e-6, 0, 0), (2, 1, 1))
    ends = np.linspace(0.1, 1.9, 10)
    tools = [box((a, 0.4, 0.5), (b + 1e-4, 0.6, 1.5)) for a, b in pairwise(ends)]
    many = without(solid, tools, 0, VOXEL)
    one = without(solid, [box((ends[0], 0.4, 0.5), (ends[-1] + 1e-4, 0.6, 1.5))], 0, VOXEL)
    assert many.num_tri() == one.num_tri() == 28  # 10 of the box, 8 of the rim, 10 of the pocket
    assert many.volume() == pytest.approx(one.volume(), rel=1e-9)
