"""Mesh depths: the depth of a mesh in every view, and which face is there, pixel by pixel."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

NEAR = 1e-6  # of the size: nothing nearer to a camera is drawn


def draw_depths(vertices: F32, faces: I64, Ks: F64, viewmats: F64, near: float,
                depths: F32) -> None:
    """Draw the depth of triangles into every view: `draw_faces` without which face it is."""
    draw_faces(vertices, faces, Ks, viewmats, near, depths, np.zeros((0, 0, 0), np.int64))


@kernel
def draw_faces(vertices: F32, faces: I64, Ks: F64, viewmats: F64, near: float,
               depths: F32, shown: I64) -> None:
    """Draw the depth of triangles into every view, and which of them is seen.

    Args:
        vertices: [N, 3] world.
        faces: [F, 3].
        Ks: [V, 3, 3] pixels.
        viewmats: [V, 4, 4].
        near: least depth; faces that reach nearer are left out.
        depths: [V, H, W] result, infinite before.
        shown: [V, H, W] result, number of the face, left alone where there is none; or empty.
    """
    views, height, width = depths.shape
    for_each(views, _draw_faces_at, (vertices, faces, Ks, viewmats, near, depths, shown, height,
                                     width))


@inlined
def _draw_faces_at(v: int, vertices: F32, faces: I64, Ks: F64, viewmats: F64, near: float,
                   depths: F32, shown: I64, height: int, width: int) -> None:
    seen = np.zeros((len(vertices), 3), np.float32)
    for n in range(len(vertices)):
        x, y, z = vertices[n, 0], vertices[n, 1], vertices[n, 2]
        w = viewmats[v]
        a = w[0, 0] * x + w[0, 1] * y + w[0, 2] * z + w[0, 3]
        b = w[1, 0] * x + w[1, 1] * y + w[1, 2] * z + w[1, 3]
        c = w[2, 0] * x + w[2, 1] * y + w[2, 2] * z + w[2, 3]
        seen[n, 2] = c
        if c > near:
            seen[n, 0] = Ks[v, 0, 0] * a / c + Ks[v, 0, 2]
            seen[n, 1] = Ks[v, 1, 1] * b / c + Ks[v, 1, 2]
    for f in range(len(faces)):
        p, q, r = seen[faces[f, 0]], seen[faces[f, 1]], seen[faces[f, 2]]
        if p[2] <= near or q[2] <= near or r[2] <= near:
            continue
        double = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        if double == 0.0:
            continue
        left = max(int(min(p[0], q[0], r[0])), 0)
        right = min(int(max(p[0], q[0], r[0])) + 1, width)
        low = max(int(min(p[1], q[1], r[1])), 0)
        high = min(int(max(p[1], q[1], r[1])) + 1, height)
        ip, iq, ir = 1.0 / p[2], 1.0 / q[2], 1.0 / r[2]
        for j in range(low, high):
            for i in range(left, right):
                x, y = i + 0.5, j + 0.5
                u = ((q[0] - x) * (r[1] - y) - (q[1] - y) * (r[0] - x)) / double
                t = ((r[0] - x) * (p[1] - y) - (r[1] - y) * (p[0] - x)) / double
                s = 1.0 - u - t
                if u >= -1e-6 and t >= -1e-6 and s >= -1e-6:
                    z = 1.0 / (u * ip + t * iq + s * ir)
                    if z < depths[v, j, i]:
                        depths[v, j, i] = z
                        if shown.size:
                            shown[v, j, i] = f
