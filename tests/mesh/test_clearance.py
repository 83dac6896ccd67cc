"""Collision pieces of neighbours: apart along joints, opened around what passes, true to parts."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import manifold3d
import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mesh.clearance import gap_share, separate_pieces
from part2gs_robotics.mesh.cut_pieces import piece_of
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.solids import corners_of, hull_of, size_of, to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import format_text

ROTATION = rotation_from_rotvec(np.array([0.4, -0.9, 0.3]))
SHIFT = np.array([2.0, -1.0, 0.5])


@pytest.mark.parametrize(("metres", "share"), [(10.0, 0.002), (0.5, 0.0022 / 0.5), (0.01, 0.01)])
def test_small_things_get_a_gap_that_engines_with_margins_see(metres: float, share: float) -> None:
    """A twin whose size is 1 unit long: 0.2 % of it, or 2.2 mm, but 1 % at most."""
    twin = toy_cabinet_twin(1)
    size = size_of(tuple(p.mesh for p in twin.parts))
    assert gap_share(twin, 0.002, metres / size) == pytest.approx(share)
    assert gap_share(twin, 0.0, metres / size) == 0.0


def volume(pieces) -> float:
    return sum(to_manifold(p).volume() for p in pieces)


def blocked(closed: tuple[int, ...] = (0,)) -> Twin:
    """A cabinet with a drawer whose `closed` parts collide as their hulls."""
    twin = toy_cabinet_twin(1)
    parts = [dataclasses.replace(p, pieces=(to_mesh(to_manifold(p.mesh).hull()),))
             if k in closed else p for k, p in enumerate(twin.parts)]
    return dataclasses.replace(twin, parts=tuple(parts))


@pytest.mark.parametrize("turned", [False, True])
def test_a_wall_with_a_window_is_four_boards_about_what_passes(turned: bool) -> None:
    wall, window = box((0, 0, 0), (1, 0.02, 1)), box((0.3, -1, 0.2), (0.6, 1, 0.5))
    passing, gap = corners_of(box((0.301, -1, 0.201), (0.599, 1, 0.499))), 0.001
    real, solid = wall - window, wall
    if turned:
        frame = np.column_stack([ROTATION, SHIFT])
        real, solid = real.transform(frame), solid.transform(frame)
        passing = passing @ ROTATION.T + SHIFT
    piece = piece_of(3, solid, real, 0.01 * real.volume())
    shares = piece.around(passing, gap)
    assert len(shares) == 4
    union = manifold3d.Manifold.batch_boolean([s.solid for s in shares], manifold3d.OpType.Add)
    assert union.volume() == pytest.approx(real.volume(), rel=1e-6)
    assert (union - real).volume() < 1e-9, "the window is open"
    assert (union ^ hull_of(passing)).volume() == 0.0
    assert all(s.part == 3 and s.spare == piece.spare for s in shares)


def test_a_wall_without_a_window_is_left_whole() -> None:
    wall, passing = box((0, 0, 0), (1, 0.02, 1)), corners_of(box((0.3, -1, 0.2), (0.6, 1, 0.5)))
    assert piece_of(0, wall, wall, 0.03 * wall.volume()).around(passing, 0.001) == []
    assert piece_of(0, wall, wall, 0.1 * wall.volume()).around(passing, 0.001) == [], "all is real"
    nothing = piece_of(0, wall, manifold3d.Manifold(), 0.0)
    assert nothing.around(passing, 0.001) == []
    assert piece_of(0, wall, wall, 0.1).around(np.zeros((4, 3)), 0.0) == [], "nothing passes"


@pytest.mark.parametrize("closed", [(0,), (0, 1)])
def test_a_drawer_runs_through_what_closed_its_opening(closed: tuple[int, ...], tmp_path: Path,
                                                       ) -> None:
    """Of the cabinet, and of the cabinet and the drawer, one hull each: nothing could move."""
    twin = blocked(closed)
    write_mjcf(twin, tmp_path)
    assert not check(tmp_path, only=("actuation",)).ok
    opened = separate_pieces(twin)
    assert not any("too deep" in note for note in opened.notes)
    write_mjcf(opened, tmp_path)
    report = check(tmp_path, only=("actuation", "overlap"))
    # one hull of a drawer is not its drawer, and the row `collision` says so
    wrong = {r.name for r in report.results if r.status in ("fail", "incomplete")}
    assert wrong == {"collision"}, format_text(report)
    for part in opened.parts:
        real = to_manifold(part.mesh)
        hulls = [to_manifold(p) for p in part.pieces]
        union = manifold3d.Manifold.batch_boolean(hulls, manifold3d.OpType.Add)
        assert (real - union).volume() < 0.1 * real.volume(), "what is real stays"


def test_a_pane_thinner_than_what_losses_are_weighed_with_keeps_its_pieces() -> None:
    twin = blocked()
    low, high = (np.asarray(f(twin.parts[1].mesh.vertices, 0)) for f in (np.min, np.max))
    middle = (low + high) / 2
    pane = to_mesh(box((middle[0], low[1], low[2]), (middle[0] + 2e-4, high[1], high[2])))
    thin = dataclasses.replace(twin.parts[1], mesh=pane, pieces=(pane,))
    apart = separate_pieces(dataclasses.replace(twin, parts=(twin.parts[0], thin)))
    assert volume(apart.parts[1].pieces) > 0.97 * volume([pane])


def test_bodies_that_cross_are_left_alone_and_said_to() -> None:
    twin = blocked()
    block = to_mesh(to_manifold(twin.parts[0].mesh).hull())
    solid = dataclasses.replace(twin.parts[0], mesh=block)
    crossed = separate_pieces(dataclasses.replace(twin, parts=(solid, *twin.parts[1:])))
    assert any("too deep to cut back: base and part_1" in note for note in crossed.notes)
    assert volume(crossed.parts[0].pieces) > 0.9 * volume((block,))


def test_a_gap_holds_between_the_stops_of_half_a_turn() -> None:
    """An arm of half a metre passes a post: its tip bulges beyond the chord of a step."""
    arm = box((-0.5, -0.02, 0.0), (0.5, 0.02, 0.1))
    post = box((-0.05, 0.501, 0.0), (0.05, 0.6, 0.1))
    joint = Joint("revolute", np.array([0, 0, 1.0]), np.zeros(3), 1.0)
    parts = (Part("base", -1, to_mesh(post), (to_mesh(post),), None),
             Part("part_1", 0, to_mesh(arm), (to_mesh(arm),), joint, (-0.5, 2.6), "derived"))
    gap = 0.003
    parted = separate_pieces(Twin("arm", parts, meters_per_unit=1.0), gap=gap)
    (still,), (moved,) = (part.pieces for part in parted.parts)
    for degrees in np.arange(60.0, 120.0, 0.5):
        turned = to_manifold(moved).rotate([0, 0, float(degrees)])
        assert turned.min_gap(to_manifold(still), 1.0) > 0.9 * gap
