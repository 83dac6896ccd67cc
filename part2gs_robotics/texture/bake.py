"""Bake: the photos of both states become one texture per part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from part2gs_robotics.config_rooms import TextureConfig
from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.kinematics import moves, part_transforms
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.model.solids import bounds, size_of
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin
from part2gs_robotics.render.mesh_depths import NEAR, draw_depths
from part2gs_robotics.texture.atlas import Atlas, make_atlas
from part2gs_robotics.texture.bake_kernels import blend, gather
from part2gs_robotics.texture.even import evened
from part2gs_robotics.texture.fill import fill
from part2gs_robotics.texture.views import Views, trusted

Samples = tuple[F32, F32]  # [T, B] weights, best first, and [T, B, 3] colours
BATCH = 16  # photos whose depth is held at once: 64 MB at 1024 x 1024 pixels
SAMPLES = 8  # best samples of a texel per state that are blended: more blur by what is misplaced
POWER = 4.0  # of the cosine of the view angle: a misplaced point moves by its tangent
SPREAD = 15.0  # of 255: what gloss and misplacement leave of one colour
ROUNDS = 4  # of reweighting: from the median to the mean of those that agree
FINE = 1.0  # texels per pixel of the middle photo


def bake(scene: Scene, parts: tuple[Part, ...], config: TextureConfig) -> tuple[Texture, ...]:
    """Return the texture of every part, from the photos of both states that were trained on.

    Args:
        scene: posed images of both states, equally bright.
        parts: built, base first, world frame at state 0.
        config: longest side of a picture.
    """
    low, high = bounds(tuple(part.mesh for part in parts))
    texel = _texel(scene, (low + high) / 2)
    atlases = [make_atlas(part.mesh, texel, config.texture_side) for part in parts]
    places = _places(parts)
    seen = [_samples(state, parts, place, atlases) for state, place in
            zip(scene.states, places, strict=True)]
    still = [bool((place == np.eye(4)).all()) for place in places[1]]
    return tuple(_texture(parts[k], atlases[k], (seen[0][k], seen[1][k]), still[k])
                 for k in range(len(parts)))


def _samples(state: StateViews, parts: tuple[Part, ...], places: list[F64],
             atlases: list[Atlas]) -> list[Samples]:
    """Return the best samples of every part's texels from the photos of one state."""
    out = [(np.zeros((len(a.pixels), SAMPLES), np.float32),
            np.zeros((len(a.pixels), SAMPLES, 3), np.float32)) for a in atlases]
    size = size_of(tuple(part.mesh for part in parts))
    for views in _batches(state, parts, places, size):
        for atlas, place, mine in zip(atlases, places, out, strict=True):
            move = np.ascontiguousarray((views.viewmats @ place)[:, :3])
            gather(atlas.points, atlas.normals, move, views.Ks, views.images, views.trust,
                   views.depths, size, POWER, *mine)
    return out


def _texel(scene: Scene, middle: F64) -> float:
    """Return the side of a texel: what a pixel of the middle photo shows of the object's middle."""
    sides = [apply(view, middle[None])[0, 2] / K[0, 0]
             for state in scene.states for view, K in zip(state.viewmats, state.Ks, strict=True)]
    return abs(float(np.median(sides))) / FINE


def _places(parts: tuple[Part, ...]) -> tuple[list[F64], list[F64]]:
    """Return where every part is in either state: [4, 4] from its place at state 0."""
    twin = Twin("", parts)
    values = [part.joint.value for part in parts if part.joint is not None and moves(part)]
    return part_transforms(twin, [0.0] * len(values)), part_transforms(twin, values)


def _batches(state: StateViews, parts: tuple[Part, ...], places: list[F64],
             size: float) -> Iterator[Views]:
    """Yield the photos of a state with the depth of the posed twin, a few at a time."""
    vertices, faces = _posed(tuple(part.mesh for part in parts), places)
    used = np.flatnonzero(~state.held_out)
    for some in np.array_split(used, max(1, -(-len(used) // BATCH))):
        depths = np.full((len(some), state.height, state.width), np.inf, np.float32)
        Ks, viewmats = np.array(state.Ks[some]), np.array(state.viewmats[some])
        draw_depths(vertices, faces, Ks, viewmats, NEAR * size, depths)
        yield Views(np.ascontiguousarray(state.images[some]),
                    trusted(state.alphas[some], depths, size), depths, Ks, viewmats)


def _posed(meshes: tuple[PartMesh, ...], places: list[F64]) -> tuple[F32, I64]:
    """Return all parts as one surface, each at its place."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = [apply(place, mesh.vertices) for mesh, place in zip(meshes, places, strict=True)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces)


def _texture(part: Part, atlas: Atlas, samples: tuple[Samples, Samples], still: bool) -> Texture:
    """Return the picture of a part; what stands still has one colour, in whatever light."""
    one, two = (np.concatenate(both, axis=1) for both in zip(*samples, strict=True))
    mixed, seen = _mixed((one, two)), one.max(1) > 0
    if not still:
        weights = samples[0][0][:, 0], samples[1][0][:, 0]
        mixed = evened(atlas, (_mixed(samples[0]), _mixed(samples[1])), weights, mixed)
    backup = part.mesh.colors.astype(np.float32).mean(0)
    return Texture(atlas.uv, fill(atlas, mixed, seen, backup))


def _mixed(samples: Samples) -> F32:
    out = np.zeros((len(samples[0]), 3), np.float32)
    blend(*samples, SPREAD, ROUNDS, out)
    return out
