"""How the time of a rendering grows with Gaussians, pixels and views, for both kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from raster_case import naive_pass, our_pass, race, spread
from raster_scene import DISTANCE, box_surface, corner_view
from toy_scenes import viewmats_around

GAUSSIANS = (1_000, 3_000, 10_000, 30_000, 100_000, 300_000)  # at SIDE
SIDES = (64, 128, 256, 400, 512, 800, 1024)  # with COUNT Gaussians
VIEWS = (1, 2, 4, 8, 16, 32, 64)  # with COUNT Gaussians at VIEW_SIDE
SIDE, COUNT, VIEW_SIDE = 400, 30_000, 256


def growth(runs: int, gaussians: Sequence[int] = GAUSSIANS, sides: Sequence[int] = SIDES,
           views: Sequence[int] = VIEWS, count: int = COUNT) -> dict[str, list[dict[str, Any]]]:
    """Return ms of forward and backward together over each quantity, per view for the last."""
    return {"gaussians": [point(n, SIDE, 1, runs) for n in gaussians],
            "pixels": [point(count, side, 1, runs) for side in sides],
            "views": [point(count, VIEW_SIDE, number, runs) for number in views]}


def point(count: int, side: int, views: int, runs: int) -> dict[str, Any]:
    """Return medians and spread of the ms that one view takes, ours and the yardstick's."""
    cloud = box_surface(count)
    cameras = corner_view()[None] if views == 1 else viewmats_around(views, DISTANCE)
    ours, naive = race(our_pass(cloud, cameras, side), naive_pass(cloud, cameras, side), runs)
    per_view = {"ms": ours.sum(1) / views, "naive_ms": naive.sum(1) / views}
    return {"gaussians": count, "size": side, "views": views,
            **{name: float(np.median(values)) for name, values in per_view.items()},
            "spread": {name: spread(values) for name, values in per_view.items()}}
