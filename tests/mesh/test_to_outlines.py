"""To outlines: surfaces end where masks do; slopes are derivatives; pieces cover what moved."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import manifold3d
import numpy as np
import pytest
from manifold3d import Manifold
from toys import cameras

from part2gs_robotics.evidence.depth_maps import DepthMaps
from part2gs_robotics.mesh import silhouettes
from part2gs_robotics.mesh.silhouettes import gaps, shape_of
from part2gs_robotics.mesh.to_outlines import moved_pieces, to_outlines
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import arrays, corners_of
from part2gs_robotics.render.mesh_depths import draw_depths

SIDE, FINE, VOXEL = 192, 3, 0.03
AWAY = np.array([[1.0, 0, 0, 2.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def drawn(solids: list[Manifold], Ks: F64, viewmats: F64, side: int) -> F64:
    """Return [V, side, side] depth of solids in photos of SIDE pixels drawn finer."""
    depths = np.full((len(Ks), side, side), np.inf, np.float32)
    fine = Ks.copy()
    fine[:, :2] *= side / SIDE
    for solid in solids:
        vertices, faces = arrays(solid)
        draw_depths(vertices.astype(np.float32), faces, fine, viewmats, 1e-6, depths)
    return depths.astype(np.float64)


def photographed(solids: list[Manifold], Ks: F64, viewmats: F64) -> Any:
    """Return what `to_outlines` asks of a PartMaps: coverage in 0..255 of every pixel."""
    covered = np.isfinite(drawn(solids, Ks, viewmats, SIDE * FINE))
    alphas = 255 * covered.reshape(len(Ks), SIDE, FINE, SIDE, FINE).mean((2, 4))
    depths = np.zeros(alphas.shape, np.float32)
    return SimpleNamespace(maps=DepthMaps(depths, alphas.astype(np.uint8), Ks, viewmats))


def place(*state1_from_0: F64) -> Any:
    return SimpleNamespace(count=len(state1_from_0), state1_from_0=list(state1_from_0))


def world(true: list[Manifold], moved: list[Manifold]) -> tuple[Any, Any]:
    Ks, viewmats = cameras(48, SIDE, np.zeros(3), 4.0)
    return photographed(true, Ks, viewmats), photographed(moved, Ks, viewmats)


@pytest.mark.parametrize("wide", [0.96, 1.04])
def test_a_box_of_a_wrong_size_gets_that_of_its_masks(wide: float) -> None:
    true = Manifold.cube([1.0, 0.6, 0.8], True)
    given = true.scale([wide, 1.0, 1.0])
    (fitted,), _ = to_outlines([given], place(np.eye(4)), world([true], [true]), VOXEL)
    wrong, left = ((one - true).volume() + (true - one).volume() for one in (given, fitted))
    assert left < 0.45 * wrong


def test_what_already_ends_where_masks_do_stays() -> None:
    true = Manifold.cube([1.0, 0.6, 0.8], True)
    (fitted,), (bend,) = to_outlines([true], place(np.eye(4)), world([true], [true]), VOXEL)
    (piece,) = moved_pieces([true], bend)
    apart = (fitted - true).volume() + (true - fitted).volume()
    assert apart < 0.06 * 0.024 * true.surface_area()  # 0.06 pixels all over
    assert piece.volume() == pytest.approx(true.volume(), rel=0.01)


def test_the_state_in_which_a_part_stands_free_tells_its_shape() -> None:
    """In state 0 a block hides the part from every side but one; in state 1 it has left it."""
    block, true = Manifold.cube([1.6, 1.6, 1.0], True), Manifold.cube([1.0, 0.7, 0.4], True)
    given = true.scale([1.0, 1.06, 1.0])
    move = AWAY.copy()
    maps = world([block, true], [block, true.transform(move[:3])])
    _, fitted = to_outlines([block, given], place(np.eye(4), move), maps, VOXEL)[0]
    width = [np.ptp(arrays(solid)[0][:, 1]) for solid in (true, given, fitted)]
    assert abs(width[2] - width[0]) < 0.45 * abs(width[1] - width[0])


def test_what_no_photo_sees_stays_as_it_is() -> None:
    block, hidden = Manifold.cube([1.6, 1.6, 1.6], True), Manifold.cube([0.5, 0.5, 0.5], True)
    maps = world([block], [block])
    same = to_outlines([block, hidden], place(np.eye(4), np.eye(4)), maps, VOXEL)[0][1]
    assert np.abs(arrays(same)[0]).max() == 0.25
    assert same.volume() == pytest.approx(hidden.volume(), rel=1e-12)


def test_convex_pieces_still_cover_the_surface_that_moved() -> None:
    true = Manifold.cylinder(0.6, 0.8, 0.8, 48, True)
    given = Manifold.cube([1.55, 1.55, 0.6], True)
    halves = [given.trim_by_plane([sign, 0, 0], 0.0) for sign in (1.0, -1.0)]
    (fitted,), (bend,) = to_outlines([given], place(np.eye(4)), world([true], [true]), VOXEL)
    pieces = moved_pieces(halves, bend)
    whole = Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    assert (given - fitted).volume() > 0.01  # its corners went
    assert (fitted - whole).volume() < 1e-4 * fitted.volume()
    assert all(len(corners_of(piece)) >= 8 for piece in pieces)


def test_slopes_are_how_gaps_change_as_the_part_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(silhouettes, "BETWEEN", 1e6)  # one point per edge: its middle
    Ks, viewmats = cameras(24, SIDE, np.zeros(3), 4.0)
    true, step = Manifold.cube([1.0, 0.6, 0.8], True), 0.004
    alphas = photographed([true], Ks, viewmats).maps.alphas
    first = drawn([true], Ks, viewmats, SIDE).astype(np.float32)
    shape, compared = shape_of(*arrays(true)), 0
    for view in range(len(Ks)):
        for axis in np.eye(3):
            one, two = (gaps(replace(shape, vertices=shape.vertices + sign * step * axis),
                             viewmats[view], Ks[view], alphas[view], first[view], 1.4)
                        for sign in (-1, 1))
            both = [(i, j) for i, end in enumerate(one.ends.tolist())
                    for j, other in enumerate(two.ends.tolist()) if end == other]
            i, j = np.array(both, int).reshape(-1, 2).T
            change = two.pixels[j] - one.pixels[i]
            wanted = -step * (one.slopes[i] + two.slopes[j]) @ axis
            near = np.maximum(np.abs(one.pixels[i]), np.abs(two.pixels[j])) < 1  # the same outline
            assert np.abs(change - wanted)[near].max(initial=0) < 0.2
            compared += int((np.abs(wanted[near]) > 0.2).sum())
    assert compared > 30


def test_flat_faces_stay_flat_while_they_move() -> None:
    true = Manifold.cube([1.0, 0.6, 0.8], True)
    given = true.scale([1.05, 1.0, 1.0])
    (fitted,), _ = to_outlines([given], place(np.eye(4)), world([true], [true]), VOXEL)
    vertices, _ = arrays(fitted)
    right = vertices[vertices[:, 0] > 0.45]
    assert 0.5 - 0.01 < right[:, 0].min() <= right[:, 0].max() < 0.5 + 0.015
    assert np.ptp(right[:, 0]) < 0.1 * 0.025  # of how far the face came


def test_a_held_part_stays_while_others_move() -> None:
    true, beside = Manifold.cube([1.0, 0.6, 0.8], True), Manifold.cube([0.3, 0.3, 0.3], True)
    apart = beside.translate([0, 0, 0.8])
    maps = world([true, apart], [true, apart])
    given, same = true.scale([1.04, 1.0, 1.0]), apart.scale([1.04, 1.0, 1.0])
    (fitted, kept), _ = to_outlines([given, same], place(np.eye(4), np.eye(4)), maps, VOXEL, [1])
    assert kept.volume() == pytest.approx(same.volume(), rel=1e-9)
    assert fitted.volume() < given.volume()
