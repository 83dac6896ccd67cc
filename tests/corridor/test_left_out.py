"""What the plan can leave out, and looking less closely: fewer results, else the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth_photos import viewmats_around, write_ball_scene

from part2gs_robotics.config import (
    PRESETS,
    FitConfig,
    ReadConfig,
    SearchConfig,
    StereoConfig,
    resolve,
)
from part2gs_robotics.fit.fit_state import fit_state
from part2gs_robotics.fit.hull import carve
from part2gs_robotics.fit.start import first_gaussians
from part2gs_robotics.fit.stereo import stereo_depths
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.small_views import small_views, spread
from part2gs_robotics.plan import make_plan
from part2gs_robotics.readers.read_scene import read_scene

CENTRE = np.array([0.4, 0.4, 0.25])
DIAGONAL = float(np.linalg.norm(2 * CENTRE))


@pytest.fixture(scope="module")
def cup(toy):
    """Photos of an open cup, and its hull, which is closed."""
    walls = [((0, 0, 0), (0.8, 0.8, 0.06)), ((0, 0, 0), (0.06, 0.8, 0.5)),
             ((0.74, 0, 0), (0.8, 0.8, 0.5)), ((0, 0, 0), (0.8, 0.06, 0.5)),
             ((0, 0.74, 0), (0.8, 0.8, 0.5))]
    boxes = [toy.Box(lo, hi, i) for i, (lo, hi) in enumerate(walls, 1)]
    state = replace(toy.cast(boxes, *toy.cameras(40, 100, CENTRE, DIAGONAL), 100), depths=None)
    return state, carve(state, resolution=48)


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return read_scene(write_ball_scene(tmp_path_factory.mktemp("b") / "scene"), ReadConfig())


def test_fewer_stereo_maps_are_the_same_maps(cup) -> None:
    state, hull = cup
    every, views = stereo_depths(state, hull, StereoConfig(stereo_side=40))
    some, few = stereo_depths(state, hull, StereoConfig(stereo_side=40, stereo_views=6))
    assert len(some) == len(few.colors) == 6
    index = [int(np.abs(views.viewmats - m).sum((1, 2)).argmin()) for m in some.viewmats]
    assert np.array_equal(some.depths, every.depths[index])


def test_without_stereo_a_fit_starts_on_the_hull_alone(cup) -> None:
    state, hull = cup
    config = FitConfig(start_gaussians=2000)
    start = first_gaussians(hull, state, config, StereoConfig(stereo=False))
    assert len(start) == 2000
    assert np.abs(hull.sample(start.means)).max() < hull.voxel
    seen = first_gaussians(hull, state, config, StereoConfig(stereo_side=70))
    # The floor, well inside the closed hull.
    assert inside(seen.means).sum() > 10
    assert not inside(start.means).any()


def inside(points):
    """Return which points are in the middle of the cup, off walls, bottom and rim."""
    low, high = np.array([0.14, 0.14, 0.03]), np.array([0.66, 0.66, 0.4])
    return ((points > low) & (points < high)).all(1)


def test_spread_views_are_distinct_and_nested() -> None:
    viewmats = viewmats_around(20, 2.0)
    assert spread(viewmats, 20) == list(range(20))
    assert spread(viewmats, 99) == list(range(20))
    four, nine = spread(viewmats, 4), spread(viewmats, 9)
    assert four == sorted(set(four))
    assert set(four) < set(nine)


def test_selected_views_are_those_of_the_indices(ball: Scene) -> None:
    views = small_views(ball.states[0], 5, 16)
    two = views.select([0, 3])
    for name in ("colors", "alphas", "Ks", "viewmats"):
        assert np.array_equal(getattr(two, name), getattr(views, name)[[0, 3]])


def test_larger_surfels_are_fewer_and_proofs_as_small_as_asked(toy) -> None:
    boxes = [toy.Box((0, 0, 0), (0.5, 0.5, 0.4), 1), toy.Box((0.55, 0.1, 0.1), (0.7, 0.3, 0.3), 2)]
    moved = [boxes[0], toy.Box((0.75, 0.1, 0.1), (0.9, 0.3, 0.3), 2)]
    pairs = [(toy.gaussians_of(b, 0.015)[0], toy.cast(b, *toy.cameras(16, 80, CENTRE, 1.2), 80))
             for b in (boxes, moved)]
    scene = toy.scene_of([pair[1] for pair in pairs])
    gaussians = pairs[0][0], pairs[1][0]
    small = SearchConfig(surfel_size=0.02, proof_views=7, proof_side=40)
    fine = toy.study_of(scene, gaussians, small)
    rough = toy.study_of(scene, gaussians, SearchConfig(surfel_size=0.05))
    assert len(rough.surfels[0]) < 0.5 * len(fine.surfels[0])
    assert fine.views[0].alphas.shape == (7, 40, 40)


def test_without_view_colour_no_colour_depends_on_the_view(ball: Scene) -> None:
    config = FitConfig(steps=2, half_steps=1, start_gaussians=200, hull_resolution=24,
                       view_color=False)
    found = fit_state(ball.states[0], config=config, stereo=StereoConfig(stereo=False))
    assert found.gaussians.shN.shape[1] == 0


@pytest.mark.parametrize(("word", "name"), [
    ("stereo", "hollows by stereo"), ("view_color", "view-dependent colour"),
    ("convex", "convex decomposition"), ("identity", "part identities"),
    ("alignment", "alignment to images"), ("contact", "contact loss"),
])
def test_the_plan_says_what_was_left_out(ball: Scene, word: str, name: str) -> None:
    assert make_plan(ball, resolve({}))[name].used
    item = make_plan(ball, resolve({word: False}))[name]
    assert not item.used
    assert item.decided == "before"
    assert item.reason


def test_the_plan_says_what_was_asked_for(ball: Scene) -> None:
    name = "flat faces without texture"
    assert not make_plan(ball, resolve({}))[name].used
    assert make_plan(ball, resolve({"plain_faces": True}))[name].used
    assert not make_plan(ball, resolve({"plain_faces": True, "stereo": False}))[name].used


def test_one_hull_per_part_without_convex_pieces(tmp_path: Path) -> None:
    from part2gs_robotics.collision.convex import convex_pieces
    from part2gs_robotics.model.solids import to_mesh

    manifold3d = pytest.importorskip("manifold3d")
    cup = (manifold3d.Manifold.cube([1, 1, 1]) - manifold3d.Manifold.cube([0.8, 0.8, 1]).translate(
        [0.1, 0.1, 0.1]))
    mesh = to_mesh(cup)
    assert len(convex_pieces(mesh, tolerance=0.02)) > 1
    (hull,) = convex_pieces(mesh, tolerance=0.02, max_pieces=1)
    assert np.allclose(np.ptp(hull.vertices, axis=0), 1.0)


def test_draft_looks_less_closely_than_standard_everywhere() -> None:
    draft, standard = resolve({"preset": "draft"}), resolve({})
    for name, value in PRESETS["draft"].items():
        for room in ("read", "fit", "stereo", "search", "articulate", "mesh", "check"):
            usual = getattr(getattr(standard, room), name, value)
            assert value <= usual, name
    assert draft != standard
