"""Convex pieces: exact on clean boards, bounded on noisy ones, apart along joints."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import manifold3d
import mujoco
import numpy as np
import pytest
from scipy.spatial import ConvexHull
from synth import box, toy_cabinet_twin

from part2gs_robotics.collision.convex import convex_pieces
from part2gs_robotics.collision.walls import facets, main_directions
from part2gs_robotics.errors import MeshError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mesh.clearance import separate_pieces
from part2gs_robotics.model.se3 import rotation_from_rotvec
from part2gs_robotics.model.solids import bound, to_manifold, to_mesh, watertight
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import format_text

ROTATION = rotation_from_rotvec(np.array([0.4, -0.9, 0.3]))
SHIFT = np.array([2.0, -1.0, 0.5])


def noisy(mesh: PartMesh, length: float, sigma: float, seed: int = 0) -> PartMesh:
    """Refine a mesh and push every vertex along a smooth random field."""
    solid = to_manifold(mesh).refine_to_length(length)
    fine = to_mesh(solid)
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(24, 3)) * (1.5 / length)
    phase = rng.uniform(0, 2 * np.pi, (24, 3))
    push = np.sin(fine.vertices @ waves.T[:, :, None].transpose(2, 0, 1)[0] + phase[:, 0])
    field = push @ rng.normal(size=(24, 3)) * sigma / np.sqrt(12)
    return dataclasses.replace(fine, vertices=fine.vertices + field)


@pytest.mark.parametrize(("index", "count"), [(0, 6), (1, 5), (2, 1)])
@pytest.mark.parametrize("turned", [False, True])
def test_clean_boards_are_found_exactly(index: int, count: int, turned: bool) -> None:
    mesh = toy_cabinet_twin(2).parts[index].mesh
    if turned:
        mesh = dataclasses.replace(mesh, vertices=mesh.vertices @ ROTATION.T + SHIFT)
    pieces = convex_pieces(mesh, tolerance=0.005)
    found = bound(mesh, pieces)
    assert len(pieces) == count
    assert found.phantom < 1e-9
    assert found.overlap > 0.999


@pytest.mark.parametrize("index", [0, 1])
def test_noisy_boards_stay_within_the_tolerance(index: int) -> None:
    tolerance = 0.006
    mesh = noisy(toy_cabinet_twin(2).parts[index].mesh, 0.02, 0.0006, index)
    assert watertight(mesh)
    pieces = convex_pieces(mesh, tolerance=tolerance)
    found = bound(mesh, pieces)
    hull = to_manifold(mesh).hull().volume() - found.volume
    assert len(pieces) <= 32
    assert found.phantom + found.missing < 0.015 * hull  # a single hull has 66 times as much
    assert found.phantom_depth < 0.3 * tolerance
    assert found.beyond < tolerance
    assert found.missing < 0.05 * found.volume


def tube(start: tuple[float, ...], end: tuple[float, ...]) -> manifold3d.Manifold:
    """Round bar between two points, ends rounded."""
    balls = [manifold3d.Manifold.sphere(0.012, 16).translate(p) for p in (start, end)]
    return manifold3d.Manifold.batch_hull(balls)


def test_a_frame_of_bars_stays_open() -> None:
    """Legs of a chair: slices along the frame are thin, and their hulls close what it encloses."""
    bars = [((-0.2, -0.2, 0), (-0.2, 0.15, 0.8)), ((0.2, -0.2, 0), (0.2, 0.15, 0.8)),
            ((-0.2, -0.2, 0), (0.2, -0.2, 0)), ((-0.2, 0.13, 0.76), (0.2, 0.13, 0.76))]
    solid = manifold3d.Manifold.batch_boolean([tube(*b) for b in bars], manifold3d.OpType.Add)
    mesh = noisy(to_mesh(solid), 0.01, 0.001)
    pieces = convex_pieces(mesh, tolerance=0.003)
    assert bound(mesh, pieces).phantom < 0.2 * solid.volume()  # the slices had 2.3 times as much
    assert len(pieces) <= 32


def test_every_piece_is_convex_and_accepted_by_the_engine(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(1)
    mesh = noisy(twin.parts[1].mesh, 0.02, 0.001)
    pieces = convex_pieces(mesh, tolerance=0.006)
    for piece in pieces:
        solid = to_manifold(piece)
        assert solid.status() == manifold3d.Error.NoError
        assert solid.volume() == pytest.approx(ConvexHull(piece.vertices).volume, rel=1e-9)
        assert 4 <= len(piece.vertices) <= 64
    drawer = dataclasses.replace(twin.parts[1], mesh=mesh, pieces=pieces)
    write_mjcf(dataclasses.replace(twin, parts=(twin.parts[0], drawer)), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    assert (model.geom_group == 3).sum() == len(pieces) + len(twin.parts[0].pieces)


def test_curved_part_is_covered() -> None:
    """A cup: no walls along three directions, still hollow afterwards."""
    outer = manifold3d.Manifold.cylinder(0.2, 0.1, -1.0, 64)
    cup = to_mesh(outer - manifold3d.Manifold.cylinder(0.2, 0.09, -1.0, 64).translate([0, 0, 0.01]))
    pieces = convex_pieces(cup, tolerance=0.004)
    found = bound(cup, pieces)
    assert len(pieces) > 4
    assert found.phantom < 0.15 * (np.pi * 0.1**2 * 0.2)
    middle = to_mesh(box((-0.03, -0.03, 0.05), (0.03, 0.03, 0.3)))
    inside = sum((to_manifold(p) ^ to_manifold(middle)).volume() for p in pieces)
    assert inside == 0.0


def test_piece_count_is_capped() -> None:
    mesh = toy_cabinet_twin(0).parts[0].mesh
    assert len(convex_pieces(mesh, tolerance=0.005, max_pieces=3)) <= 3


def test_bound_of_a_hull_by_hand() -> None:
    mesh = toy_cabinet_twin(0).parts[0].mesh
    found = bound(mesh, (to_mesh(to_manifold(mesh).hull()),))
    assert found.phantom == pytest.approx(0.5 * 0.6 * 0.8 - found.volume)
    assert found.missing == pytest.approx(0.0, abs=1e-12)


def test_open_mesh_is_refused() -> None:
    mesh = toy_cabinet_twin(0).parts[0].mesh
    with pytest.raises(MeshError, match="not closed"):
        convex_pieces(dataclasses.replace(mesh, faces=mesh.faces[1:]), tolerance=0.01)


def test_main_directions_of_a_turned_box() -> None:
    mesh = to_mesh(box((0, 0, 0), (1, 2, 3)))
    found = main_directions(facets(mesh.vertices @ ROTATION.T, mesh.faces))
    assert len(found) == 3
    np.testing.assert_allclose(np.abs(found @ ROTATION).max(0), 1.0, atol=1e-9)


def test_tight_pieces_are_parted_and_the_drawer_runs(tmp_path: Path) -> None:
    """Pieces 2 mm too fat on every side block the drawer; cut back, it runs."""
    twin = toy_cabinet_twin(1, clearance=0.001)
    fat = tuple(
        to_mesh(to_manifold(p).minkowski_sum(box((-0.002,) * 3, (0.002,) * 3)))
        for p in twin.parts[1].pieces
    )
    drawer = dataclasses.replace(twin.parts[1], pieces=fat)
    blocked = dataclasses.replace(twin, parts=(twin.parts[0], drawer))
    write_mjcf(blocked, tmp_path)
    assert not check(tmp_path, only=("actuation",)).ok
    parted = separate_pieces(blocked)
    write_mjcf(parted, tmp_path)
    report = check(tmp_path, only=("actuation", "overlap"))
    assert report.ok, format_text(report)
    assert "cut back" in parted.notes[-1]
    left = sum(to_manifold(p).volume() for p in parted.parts[1].pieces)
    assert left > 0.85 * sum(to_manifold(p).volume() for p in twin.parts[1].pieces)


def test_parting_leaves_a_sound_twin_alone() -> None:
    twin = toy_cabinet_twin(3)
    parted = separate_pieces(twin)
    assert parted.notes == twin.notes
    for a, b in zip(twin.parts, parted.parts, strict=True):
        volumes = [sum(to_manifold(p).volume() for p in part.pieces) for part in (a, b)]
        assert volumes[0] == pytest.approx(volumes[1])
