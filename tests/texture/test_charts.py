"""Charts and atlas: every face has a place of its own, as large as it is."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.texture.atlas import GUTTER, make_atlas
from part2gs_robotics.texture.charts import make_charts, neighbours, pack


def mesh_of(shape: trimesh.Trimesh) -> PartMesh:
    vertices = np.asarray(shape.vertices, np.float64)
    return PartMesh(vertices, np.asarray(shape.faces, np.int64),
                    np.full((len(vertices), 3), 90, np.uint8))


def crumpled(seed: int) -> PartMesh:
    """A ball whose surface is as rough as a reconstructed one."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.vertices += np.random.default_rng(seed).normal(scale=0.03, size=ball.vertices.shape)
    return mesh_of(ball)


def helix() -> PartMesh:
    """A ramp of two turns: seen from above it covers itself."""
    steps = np.linspace(0, 4 * np.pi, 120)
    inner, outer = (np.stack([r * np.cos(steps), r * np.sin(steps), 0.05 * steps], 1)
                    for r in (0.5, 1.0))
    i = np.arange(len(steps) - 1)
    n = len(steps)
    faces = np.concatenate([np.stack([i, i + n, i + 1], 1), np.stack([i + 1, i + n, i + n + 1], 1)])
    return PartMesh(np.concatenate([inner, outer]), faces, np.zeros((2 * n, 3), np.uint8))


MESHES = {"box": mesh_of(trimesh.creation.box((1.0, 0.6, 0.3))), "ball": crumpled(0),
          "ring": mesh_of(trimesh.creation.torus(1.0, 0.3)), "helix": helix()}  # fmt: skip


def covered(uv: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return [H, W] how many faces hold each texel's centre well inside."""
    height, width = shape
    count = np.zeros(shape, int)
    corners = np.stack([uv[..., 0] * width, (1 - uv[..., 1]) * height], -1).astype(float)
    for a, b, c in corners:
        double = np.linalg.det(np.stack([b - a, c - a]))
        if abs(double) < 1e-9:
            continue
        low, high = np.floor(np.min([a, b, c], 0)).astype(int), np.max([a, b, c], 0).astype(int) + 1
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / double
        v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / double
        count[low[1]:high[1], low[0]:high[0]] += np.minimum(np.minimum(u, v), 1 - u - v) > 0.01
    return count


@pytest.mark.parametrize("name", MESHES)
def test_no_texel_belongs_to_two_faces(name: str) -> None:
    atlas = make_atlas(MESHES[name], 0.01, 2048)
    assert covered(atlas.uv, atlas.shape).max() == 1


@pytest.mark.parametrize("name", MESHES)
def test_every_face_has_a_chart_and_half_its_texels_at_least(name: str) -> None:
    mesh, texel = MESHES[name], 0.01
    charts = make_charts(mesh, texel)
    assert (charts.chart >= 0).all()
    corners = mesh.vertices[mesh.faces]
    real = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
                          axis=1) / texel**2
    flat = charts.flat
    laid = np.abs(np.linalg.det(np.stack([flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]], 1)))
    assert (laid > 0.4 * real).all(), "seen at 60 degrees at most, a little more after the mean"
    assert (laid < 1.0001 * real).all()


def test_charts_keep_their_distance() -> None:
    charts = make_charts(MESHES["ball"], 0.01)
    places, (width, height) = pack(charts.sizes, GUTTER, 2048)
    ends = places + np.ceil(charts.sizes).astype(int)
    assert (places >= GUTTER).all()
    assert (ends[:, 0] <= width - GUTTER).all()
    assert (ends[:, 1] <= height - GUTTER).all()
    apart = ((places[:, None] >= ends[None] + 2 * GUTTER)
             | (ends[:, None] + 2 * GUTTER <= places[None])).any(-1)
    assert (apart | np.eye(len(places), dtype=bool)).all()


def test_a_box_has_six_charts_and_a_plain_atlas() -> None:
    charts = make_charts(MESHES["box"], 0.01)
    assert len(charts.sizes) == 6
    want = sorted([(100, 60), (100, 60), (100, 30), (100, 30), (60, 30), (60, 30)])
    assert sorted(map(tuple, np.rint(charts.sizes).astype(int))) == want


def test_an_atlas_stays_within_its_side() -> None:
    atlas = make_atlas(MESHES["box"], 0.001, 256)
    assert max(atlas.shape) <= 256
    assert atlas.uv.min() >= 0
    assert atlas.uv.max() <= 1


@pytest.mark.parametrize("side", [64, 128, 512])
def test_many_charts_still_fit_in_little_room(side: int) -> None:
    rough = trimesh.creation.icosphere(subdivisions=3)
    rough.vertices += np.random.default_rng(0).normal(scale=0.2, size=rough.vertices.shape)
    mesh = mesh_of(rough)
    atlas = make_atlas(mesh, 0.005, side)
    count = len(make_charts(mesh, 0.005).sizes)
    assert max(atlas.shape) <= max(side, (2 * GUTTER + 2) * np.sqrt(count) + 64)
    assert covered(atlas.uv, atlas.shape).max() == 1


def test_points_of_texels_lie_on_their_faces() -> None:
    atlas = make_atlas(MESHES["box"], 0.01, 1024)
    off = np.abs(np.abs(atlas.points) - np.array([0.5, 0.3, 0.15])).min(1)
    assert off.max() < 1e-6


def test_flat_faces_without_area_are_no_obstacle() -> None:
    box = MESHES["box"]
    broken = PartMesh(box.vertices, np.concatenate([box.faces, [[0, 0, 1], [2, 2, 2]]]), box.colors)
    atlas = make_atlas(broken, 0.01, 1024)
    assert np.isfinite(atlas.uv).all()
    assert np.isfinite(atlas.points).all()


def test_neighbours_share_an_edge() -> None:
    faces = MESHES["ring"].faces
    beside = neighbours(faces)
    assert (beside >= 0).all()
    for side in range(3):
        shared = [len(set(a) & set(b)) for a, b in zip(faces, faces[beside[:, side]], strict=True)]
        assert set(shared) == {2}


def test_the_same_mesh_gives_the_same_atlas() -> None:
    one, two = (make_atlas(crumpled(4), 0.01, 1024) for _ in range(2))
    assert np.array_equal(one.uv, two.uv)
    assert np.array_equal(one.points, two.points)
