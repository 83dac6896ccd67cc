"""Joints drawn from the standard deviations that twin.yaml holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.twin import Part, Twin


def known(joint: Joint) -> bool:
    """Return whether any deviation of a joint is known, so that there is something to draw."""
    return bool(np.isfinite([joint.sigma_axis, joint.sigma_origin, joint.sigma_value]).any())


def drawn_twin(twin: Twin, rng: np.random.Generator) -> Twin:
    """Return the twin with every joint drawn; what has no known deviation stays."""
    return replace(twin, parts=tuple(_drawn_part(part, rng) for part in twin.parts))


def drawn_joint(joint: Joint, rng: np.random.Generator) -> Joint:
    """Return a joint drawn from its standard deviations, all normal and independent.

    A deviation of axis or origin is the root of the summed variances of two directions across the
    axis; twin.yaml holds no more, so both get half the variance.
    """
    sides = across(joint.axis)
    tilt = _normal(joint.sigma_axis / np.sqrt(2), 2, rng) @ sides
    shift = _normal(joint.sigma_origin / np.sqrt(2), 2, rng) @ sides
    value = joint.value + float(_normal(joint.sigma_value, 1, rng)[0])
    pitch = joint.pitch
    if joint.kind == "screw" and joint.value:
        pitch += float(_normal(joint.sigma_rise, 1, rng)[0]) / joint.value
    axis = joint.axis + tilt
    return replace(joint, axis=axis / np.linalg.norm(axis), origin=joint.origin + shift,
                   value=value, pitch=pitch)


def across(axis: F64) -> F64:
    """Return [2, 3] unit vectors at right angles to a unit axis and to each other."""
    least = np.eye(3)[int(np.abs(axis).argmin())]
    first = np.cross(axis, least)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first)])


def _drawn_part(part: Part, rng: np.random.Generator) -> Part:
    return part if part.joint is None else replace(part, joint=drawn_joint(part.joint, rng))


def _normal(sigma: float, count: int, rng: np.random.Generator) -> F64:
    """Return normal numbers; zeros where the deviation is not known. Always draws as many."""
    return np.asarray(rng.normal(size=count) * (sigma if np.isfinite(sigma) else 0.0))
