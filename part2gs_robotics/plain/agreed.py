"""Agreed planes: those that several photos put their regions on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from part2gs_robotics.evidence.depth_maps import MIN_VIEWS
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.plain.planes import Asked, Plane, Views, likeliest, met

SOME = 0.02  # of a rim in all photos: less is chance
VOICES = 0.5  # sum of scores over photos: planes of chance had less
LAYER = 0.006  # of the diagonal: planes of one face differ by less


@dataclass(frozen=True)
class Spoken:
    """A region and the planes that other photos speak for as its, with their scores."""

    asked: Asked
    planes: list[tuple[float, Plane]]


def on_agreed(views: Views, found: Sequence[Spoken], normals: F64) -> F32:
    """Return maps [V, H, W] with regions on planes that photos agree on.

    A region goes there if other photos speak for that more than for the map's own depths.

    Args:
        views: with the maps as they are.
        found: regions of all photos.
        normals: [M, 3] unit, that planes speak of.
    """
    planes, out = agreed(found, LAYER * views.bounds.diagonal), views.maps.copy()
    for one in found:
        best = likeliest(one.asked, normals, planes)
        if best is None:
            continue
        score, (k, offset) = best
        at = np.array([offset])
        if score > max(SOME, one.asked.own(one.asked.facing(normals[k], at))):
            view, pixels = one.asked.view, one.asked.region.pixels
            depth = met(views.eyes[view], views.rays(view, pixels), normals[k], at)[0]
            seen = depth > 0
            out[view, pixels[seen, 1], pixels[seen, 0]] = depth[seen]
    return out


def agreed(found: Sequence[Spoken], layer: float) -> list[Plane]:
    """Return planes that enough photos speak for; each has one voice, its best region's score.

    Args:
        found: regions of all photos.
        layer: scene units, within which planes are one.
    """
    planes, kinds = list[Plane](), {k for one in found for _, (k, _) in one.planes}
    for kind in sorted(kinds):
        voices = np.array([(offset, score, one.asked.view) for one in found
                           for score, (k, offset) in one.planes if k == kind])
        while len(voices):
            near = np.abs(voices[:, 0] - voices[:, :1]) < layer
            total = np.array([_voice(voices[row]) for row in near])
            best = int(total.argmax())
            own = voices[near[best]]
            if total[best] < VOICES or len(np.unique(own[:, 2])) < MIN_VIEWS:
                break
            planes.append((kind, float(np.average(own[:, 0], weights=own[:, 1]))))
            voices = voices[np.abs(voices[:, 0] - voices[best, 0]) >= 2 * layer]
    return planes


def _voice(voices: F64) -> float:
    """Return the sum over photos of their highest score; rows are offset, score, photo."""
    top = np.zeros(int(voices[:, 2].max()) + 1)
    np.maximum.at(top, voices[:, 2].astype(int), voices[:, 1])
    return float(top.sum())
