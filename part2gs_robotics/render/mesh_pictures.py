"""Mesh pictures: what a posed, textured twin shows from a camera, without light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.render.mesh_depths import NEAR, draw_faces

FINER = 2  # pixels per pixel of the picture and side: edges are smooth, as in a photo
WHITE = 255.0  # where there is no mesh, as photos are shown in reports


def draw_meshes(meshes: Sequence[PartMesh], places: Sequence[F64], camera: Camera,
                ) -> NDArray[np.uint8]:
    """Return [H, W, 3] uint8 the meshes in their own colours over white.

    Args:
        meshes: of the parts, world frame.
        places: [4, 4] per part, where it has moved to.
        camera: in that world.
    """
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([apply(place, mesh.vertices)
                               for mesh, place in zip(meshes, places, strict=True)])
    faces = np.concatenate([mesh.faces + start
                            for mesh, start in zip(meshes, starts[:-1], strict=True)])
    height, width = FINER * camera.height, FINER * camera.width
    lens = np.diag([FINER, FINER, 1.0]) @ camera.K
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    depths = np.full((1, height, width), np.inf, np.float32)
    shown = np.full(depths.shape, -1, np.int64)
    draw_faces(vertices.astype(np.float32), faces, lens[None], camera.viewmat[None], NEAR * size,
               depths, shown)
    weights = _shares(apply(camera.viewmat, vertices)[faces], lens, shown[0])
    picture = _painted(meshes, shown[0], weights)
    fine = picture.reshape(camera.height, FINER, camera.width, FINER, 3).mean((1, 3))
    return np.asarray(np.rint(fine), np.uint8)


def _shares(tri: F64, K: F64, face: I64) -> F32:
    """Return [H, W, 3] shares of the corners in the point of a face that each pixel shows.

    Corners p, q, r weigh as the volumes that the pixel's ray spans with the other two.

    Args:
        tri: [F, 3, 3] faces in the camera's frame.
        K: [3, 3] pixels.
        face: [H, W] number of a face, -1 = none.
    """
    out = np.zeros((*face.shape, 3), np.float32)
    row, col = np.nonzero(face >= 0)
    rays = np.column_stack([col + 0.5, row + 0.5, np.ones(len(row))]) @ np.linalg.inv(K).T
    p, q, r = tri[face[row, col]].transpose(1, 0, 2)
    spans = np.stack([(rays * np.cross(*pair)).sum(1) for pair in ((q, r), (r, p), (p, q))], 1)
    shares = np.clip(spans / spans.sum(1, keepdims=True), 0, None)  # a face on edge shows no pixel
    out[row, col] = shares / shares.sum(1, keepdims=True)
    return out


def _painted(meshes: Sequence[PartMesh], face: I64, weights: F32) -> F32:
    """Return [H, W, 3] the colour of the face and place that each pixel shows."""
    picture = np.full((*face.shape, 3), WHITE, np.float32)
    first = 0
    for mesh in meshes:
        at = np.nonzero((face >= first) & (face < first + len(mesh.faces)))
        own, share = face[at] - first, weights[at][:, :, None]
        first += len(mesh.faces)
        if mesh.texture is None:
            picture[at] = (mesh.colors[mesh.faces[own]] * share).sum(1)
        elif len(own):
            picture[at] = _looked_up(mesh.texture.image, (mesh.texture.uv[own] * share).sum(1))
    return picture


def _looked_up(image: NDArray[np.uint8], uv: F32) -> F32:
    """Return colours [N, 3] between the texels of an image; v counts from its lower edge."""
    height, width = image.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = x.astype(int), y.astype(int)
    right, low = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    a, b = (x - left)[:, None], (y - top)[:, None]
    return np.asarray((image[top, left] * (1 - a) + image[top, right] * a) * (1 - b)
                      + (image[low, left] * (1 - a) + image[low, right] * a) * b, np.float32)
