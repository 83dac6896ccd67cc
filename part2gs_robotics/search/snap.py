"""Snapping: made things move along their own faces; a weakly seen axis is tried on them too.

Drawers of one cabinet share their direction: along every direction found, the distances that
together explain most are tried as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.evidence.faces import directions, on_edge
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.search.cover import cover, saved_matrix
from part2gs_robotics.search.patches import SLIDE_STEP

SLIDE_SNAP = np.deg2rad(40.0)  # a drawer front sliding over itself leaves its direction nearly free
TURN_SNAP = np.deg2rad(12.0)  # a hinge seen through a whole door is off by less
LONGEST_SLIDE = 0.5  # of the diagonal: a drawer is not longer than what holds it
MAX_FAMILIES = 3  # directions, and those of edges: drawers side by side have one, space has three
SAME_MOTION = 0.004  # of the diagonal: half a grid step, within the reach of refinement


def snapped(found: list[Joint], study: Study, rng: np.random.Generator) -> list[Joint]:
    """Return every motion turned onto each nearby dominant direction.

    Args:
        found: motions.
        study: supplies the dominant directions of the object.
        rng: of the direction search.
    """
    axes = _own_directions(study, rng)
    out: list[Joint] = []
    for h in found:
        limit = TURN_SNAP if h.turns else SLIDE_SNAP
        for axis in axes:
            cosine = float(axis @ h.axis)
            if np.cos(limit) < abs(cosine) < 1 - 1e-7:
                out.append(replace(h, axis=axis * np.sign(cosine), value=h.value * abs(cosine),
                                   held=on_edge(axis, study.straight.directions)))
    return out


def _own_directions(study: Study, rng: np.random.Generator) -> F64:
    """Return the directions of the object's edges, then those of its faces."""
    sample = study.surfels[0]
    patch = sample.select(rng.permutation(len(sample))[:200])
    return directions(sample, patch, rng, known=study.straight.directions)


def slide_families(found: list[Joint], study: Study, price: float,
                   rng: np.random.Generator) -> list[Joint]:
    """Return slides along the directions of `found` whose distances together explain most.

    Where no patch found a slide, such as of drawers behind doors, the object's own directions are
    tried. Those of edges always are: a slide askew that hides two drawers leans to many others.

    Args:
        found: motions; only the slides' directions are used.
        study: evidence and landing grids.
        price: evidence one more distance must explain, see `cover`.
        rng: of the direction search.
    """
    axes: list[F64] = []
    for h in found:
        if (h.kind == "prismatic" and (h.held or len(axes) < MAX_FAMILIES)
                and all(abs(h.axis @ a) < np.cos(np.deg2rad(8.0)) for a in axes)):
            axes.append(h.axis)
    axes = axes or list(_own_directions(study, rng))[:MAX_FAMILIES]
    steps = np.arange(2, LONGEST_SLIDE / SLIDE_STEP) * SLIDE_STEP * study.diag
    out: list[Joint] = []
    for axis in axes:
        held = on_edge(axis, study.straight.directions)
        line = [Joint("prismatic", axis, study.box[0], float(s * v), held=held)
                for v in steps for s in (1, -1)]
        out += [
            line[c]
            for c in cover(saved_matrix(line, study.evidence, study.lands, study.diag), price)
        ]
    return out


def distinct(found: list[Joint], study: Study) -> list[Joint]:
    """Return the motions without those that move the object like an earlier one."""
    lo, hi = study.box
    corners = np.stack(np.meshgrid(*zip(lo, hi, strict=True), indexing="ij"), -1).reshape(-1, 3)
    out: list[Joint] = []
    places: list[F64] = []
    for h in found:
        moved = se3.apply(h.move, corners)
        if all(np.abs(moved - p).max() > SAME_MOTION * study.diag for p in places):
            out.append(h)
            places.append(moved)
    return out
