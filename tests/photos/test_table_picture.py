"""The plane below an object: neighbouring photos tell it from what stands on it."""

from __future__ import annotations

import numpy as np
from toys import Box, cameras, cast

from part2gs_robotics.photos.table_picture import seen_on_plane
from part2gs_robotics.photos.views import Views


def test_a_sweep_of_planes_stops_at_the_table_and_not_on_the_object():
    Ks, poses = cameras(48, 120, np.array([0, 0, 0.3]), 1.3)
    eyes = -np.einsum("vij,vi->vj", poses[:, :3, :3], poses[:, :3, 3])
    above = eyes[:, 2] > 0.9
    table = Box((-1.2, -1.2, -0.05), (1.2, 1.2, 0.0), 1)
    thing = Box((-0.3, -0.2, 0.0), (0.3, 0.2, 0.6), 2)
    both, bare = (cast(boxes, Ks[above], poses[above], 120) for boxes in ([table, thing], [table]))
    told = np.stack(seen_on_plane(Views(both.images, Ks[0], poses[above]), np.array([0, 0, 0.3])))
    plane = (both.depths > 0) & (np.abs(both.depths - bare.depths) < 1e-6)
    other = (both.depths > 0) & ~plane
    assert told[plane].mean() > 0.25
    assert told[other].mean() < 0.005
