"""Mesh pictures: what a posed, textured twin shows from a camera, without light."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.model.se3 import apply
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.render.mesh_depths import NEAR
from part2gs_robotics.runtime.jit import kernel

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
    local = apply(camera.viewmat, vertices)
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    depth, face = np.full((height, width), np.inf), np.full((height, width), -1, np.int64)
    weights = np.zeros((height, width, 3), np.float32)
    draw_faces(local, faces, lens, NEAR * size, depth, face, weights)
    picture = _painted(meshes, face, weights)
    fine = picture.reshape(camera.height, FINER, camera.width, FINER, 3).mean((1, 3))
    return np.asarray(np.rint(fine), np.uint8)


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


@kernel
def draw_faces(local: F64, faces: I64, K: F64, near: float, depth: F64, face: I64,
               weights: F32) -> None:
    """Draw which face each pixel shows, and where on it.

    Args:
        local: [N, 3] vertices in the camera's frame.
        faces: [F, 3].
        K: [3, 3] pixels.
        near: least depth; faces that reach nearer are left out.
        depth: [H, W] infinite before.
        face: [H, W] result, -1 before.
        weights: [H, W, 3] result: shares of the face's corners, perspective in them.
    """
    height, width = depth.shape
    for f in range(len(faces)):
        p, q, r = local[faces[f, 0]], local[faces[f, 1]], local[faces[f, 2]]
        if p[2] <= near or q[2] <= near or r[2] <= near:
            continue
        px, py = K[0, 0] * p[0] / p[2] + K[0, 2], K[1, 1] * p[1] / p[2] + K[1, 2]
        qx, qy = K[0, 0] * q[0] / q[2] + K[0, 2], K[1, 1] * q[1] / q[2] + K[1, 2]
        rx, ry = K[0, 0] * r[0] / r[2] + K[0, 2], K[1, 1] * r[1] / r[2] + K[1, 2]
        double = (qx - px) * (ry - py) - (qy - py) * (rx - px)
        if double == 0.0:
            continue
        for j in range(max(int(min(py, qy, ry)), 0), min(int(max(py, qy, ry)) + 1, height)):
            for i in range(max(int(min(px, qx, rx)), 0), min(int(max(px, qx, rx)) + 1, width)):
                x, y = i + 0.5, j + 0.5
                u = ((qx - x) * (ry - y) - (qy - y) * (rx - x)) / double
                t = ((rx - x) * (py - y) - (ry - y) * (px - x)) / double
                s = 1.0 - u - t
                if u >= -1e-6 and t >= -1e-6 and s >= -1e-6:
                    z = 1.0 / (u / p[2] + t / q[2] + s / r[2])
                    if z < depth[j, i]:
                        depth[j, i], face[j, i] = z, f
                        weights[j, i, 0] = u * z / p[2]
                        weights[j, i, 1] = t * z / q[2]
                        weights[j, i, 2] = s * z / r[2]
