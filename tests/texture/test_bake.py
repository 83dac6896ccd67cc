"""Baking: what was painted on boxes comes back from their photos, whatever moves and hides."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import toys
import trimesh
from toys import Box

from part2gs_robotics.config import TextureConfig
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.twin import Part, PartMesh, Texture
from part2gs_robotics.texture.atlas import make_atlas
from part2gs_robotics.texture.bake import bake
from part2gs_robotics.texture.fill import fill

SIDE, VIEWS = 128, 24
BASE, DOOR = Box((0, 0, 0), (0.8, 0.6, 0.6), 1), Box((0, -0.06, 0), (0.8, -0.02, 0.6), 3)
HINGE = Joint("revolute", np.array([0.0, 0, 1]), np.array([0.0, -0.06, 0.0]), -1.2)


def mesh_of(box: Box) -> PartMesh:
    shape = trimesh.creation.box(bounds=[box.lo, box.hi])
    return PartMesh(np.asarray(shape.vertices, np.float64), np.asarray(shape.faces, np.int64),
                    np.full((8, 3), 7, np.uint8))


def photos(*boxes: Box):
    eyes = toys.cameras(VIEWS, SIDE, np.array([0.4, 0.3, 0.3]), 1.3)
    return toys.photographed(boxes, *eyes, SIDE)


def part(box: Box, joint: Joint | None = None) -> Part:
    name, parent = ("part_1", 0) if joint else ("base", -1)
    return Part(name, parent, mesh_of(box), (), joint, (-1.2, 0.0) if joint else (0.0, 0.0))


def looked_up(texture: Texture, faces: np.ndarray, bary: np.ndarray) -> np.ndarray:
    """Return [n, 3] colours at barycentric places of faces, as a renderer filters them."""
    u, v = np.einsum("nc,nci->ni", bary, texture.uv[faces]).astype(np.float32).T
    height, width = texture.image.shape[:2]
    return cv2.remap(texture.image.astype(np.float32), u[:, None] * width - 0.5,
                     (1 - v[:, None]) * height - 0.5, cv2.INTER_LINEAR)[:, 0]


def compared(texture: Texture, mesh: PartMesh, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Return [n, 3] random points on the surface and [n] by how many grey levels they are off."""
    rng = np.random.default_rng(0)
    faces = rng.integers(0, len(mesh.faces), 4000)
    bary = rng.dirichlet((1, 1, 1), 4000)
    points = np.einsum("nc,nci->ni", bary, mesh.vertices[mesh.faces[faces]])
    want = 255 * toys.paint(points, box.seed)
    return points, np.abs(looked_up(texture, faces, bary) - want).max(1)


@pytest.fixture(scope="module")
def opened():
    """A door before a base, closed and open by 69 degrees: photos, parts, textures."""
    moved = Box(DOOR.lo, DOOR.hi, DOOR.seed, HINGE.transforms(np.array([HINGE.value]))[0])
    scene = toys.scene_of((photos(BASE, DOOR), photos(BASE, moved)))
    parts = part(BASE), part(DOOR, HINGE)
    return scene, parts, bake(scene, parts, TextureConfig())


def test_a_painted_box_gets_its_pattern_back() -> None:
    state = photos(BASE)
    parts = (part(BASE),)
    (texture,) = bake(toys.scene_of((state, state)), parts, TextureConfig())
    _, off = compared(texture, parts[0].mesh, BASE)
    assert np.median(off) < 3
    assert np.percentile(off, 99) < 12


def test_a_door_does_not_bleed_onto_what_is_behind_it(opened) -> None:
    _, parts, (base, _) = opened
    points, off = compared(base, parts[0].mesh, BASE)
    front = points[:, 1] < 1e-6
    assert np.median(off[front]) < 4
    assert np.percentile(off[front], 95) < 20


def test_a_part_that_moved_is_not_smeared(opened) -> None:
    _, parts, (_, door) = opened
    points, off = compared(door, parts[1].mesh, DOOR)
    outside = points[:, 1] < DOOR.lo[1] + 1e-6
    assert np.median(off[outside]) < 3
    assert np.percentile(off[outside], 95) < 10


def test_held_out_photos_are_not_looked_at(opened) -> None:
    scene, parts, _ = opened
    held = np.arange(VIEWS) % 8 == 0
    white = held[:, None, None, None] & np.ones(3, bool)
    clean = tuple(replace(s, held_out=held) for s in scene.states)
    spoiled = tuple(replace(s, images=np.where(white, 255, s.images).astype(np.uint8))
                    for s in clean)
    one, two = (bake(replace(scene, states=s), parts, TextureConfig()) for s in (clean, spoiled))
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.image, b.image)


def test_light_from_one_side_leaves_no_border_on_a_moving_part(opened) -> None:
    scene, parts, _ = opened
    dark = replace(scene.states[1], images=(0.7 * scene.states[1].images).astype(np.uint8))
    _, door = bake(replace(scene, states=(scene.states[0], dark)), parts, TextureConfig())
    points, _ = compared(door, parts[1].mesh, DOOR)
    rng = np.random.default_rng(0)
    faces, bary = rng.integers(0, 12, 4000), rng.dirichlet((1, 1, 1), 4000)
    got = looked_up(door, faces, bary)
    want = 0.85 * 255 * toys.paint(points, DOOR.seed)
    outside = points[:, 1] < DOOR.lo[1] + 1e-6
    assert np.percentile(np.abs(got - want).max(1)[outside], 90) < 12


def test_textures_repeat_bit_for_bit(opened) -> None:
    scene, parts, textures = opened
    for a, b in zip(bake(scene, parts, TextureConfig()), textures, strict=True):
        assert np.array_equal(a.image, b.image)
        assert np.array_equal(a.uv, b.uv)


def test_what_no_photo_shows_takes_the_colour_beside_it() -> None:
    mesh = mesh_of(BASE)
    atlas = make_atlas(mesh, 0.01, 1024)
    seen = atlas.points[:, 0] < 0.4
    colors = np.where(atlas.points[:, 1:2] < 0.3, [[200.0, 30, 30]], [[30.0, 30, 200]])
    colors = np.where(seen[:, None], colors, 255.0).astype(np.float32)
    picture = fill(atlas, colors, seen, np.zeros(3, np.float32))
    flat = picture.reshape(-1, 3)[atlas.pixels]
    hidden = ~seen & (atlas.points[:, 0] < 0.79)
    for side, want in ((atlas.points[:, 1] < 0.2, [200, 30, 30]),
                       (atlas.points[:, 1] > 0.4, [30, 30, 200])):
        assert np.abs(flat[hidden & side] - want).max() <= 2


def test_a_part_that_no_photo_shows_keeps_its_colour() -> None:
    state = photos(BASE)
    empty = replace(state, alphas=np.zeros_like(state.alphas))
    (texture,) = bake(toys.scene_of((empty, empty)), (part(BASE),), TextureConfig())
    assert (texture.image == 7).all()


def test_charts_are_framed_in_their_own_colour() -> None:
    mesh = mesh_of(BASE)
    atlas = make_atlas(mesh, 0.01, 1024)
    colors = np.where(atlas.normals[:, 2:] > 0.9, 255.0, 0.0).repeat(3, 1).astype(np.float32)
    picture = fill(atlas, colors, np.ones(len(colors), bool), np.zeros(3, np.float32))
    top = np.zeros(atlas.shape, np.uint8)
    top.ravel()[atlas.pixels] = colors[:, 0] > 0
    framed = cv2.dilate(top, np.ones((5, 5), np.uint8)) > 0
    assert (picture[framed] == 255).all()
