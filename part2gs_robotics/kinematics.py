"""Kinematics: where every part of a twin is, for given joint positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.twin import Part, Twin


def moving_parts(twin: Twin) -> tuple[int, ...]:
    """Return the indices of the parts that have a degree of freedom, in order."""
    return tuple(i for i, p in enumerate(twin.parts) if moves(p))


def moves(part: Part) -> bool:
    """Say whether a part has a degree of freedom."""
    return part.joint is not None and part.joint.kind != "fixed"


def part_transforms(twin: Twin, positions: Sequence[float]) -> list[NDArray[np.float64]]:
    """Return per part [4, 4] world_at_q_from_world_at_0.

    A child is carried by its parent: world_q_from_0(child) = world_q_from_0(parent) joint(q).

    Args:
        twin: parents before children.
        positions: one per moving part, rad or scene units.
    """
    at = dict(zip(moving_parts(twin), positions, strict=True))
    out: list[NDArray[np.float64]] = []
    for i, part in enumerate(twin.parts):
        parent = out[part.parent] if part.parent >= 0 else np.eye(4)
        local = part.joint.transform(at.get(i, 0.0)) if part.joint is not None else np.eye(4)
        out.append(parent @ local)
    return out


def subtree(twin: Twin, index: int) -> tuple[int, ...]:
    """Return the part and everything it carries."""
    carried = {index}
    for i, part in enumerate(twin.parts):
        if part.parent in carried:
            carried.add(i)
    return tuple(sorted(carried))


def children(twin: Twin, index: int) -> tuple[int, ...]:
    """Return the parts directly carried by a part."""
    return tuple(i for i, p in enumerate(twin.parts) if p.parent == index)
