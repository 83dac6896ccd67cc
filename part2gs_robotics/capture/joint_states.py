"""Which joints move between the states, and from where to where."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.errors import ConfigError

if TYPE_CHECKING:
    from part2gs_robotics.capture.rig import JointInfo, Rig

States = dict[str, tuple[float, float]]

# Nearly closed and three quarters open: both show the seam, neither sits on a limit.
RANGE_SHARES = (0.05, 0.75)
FREE_HINGE_RAD = float(np.deg2rad(45.0))  # half a right angle: an unlimited hinge has no range
FREE_SLIDE_SHARE = 0.1  # of the model's extent: an unlimited slide has no natural length


def parse_states(words: Iterable[str]) -> States:
    """Return joint name -> both positions from words like `door=0.1,1.2`.

    Raises:
        ConfigError: a word of another form, or a joint named twice.
    """
    states: States = {}
    for word in words:
        name, _, values = word.rpartition("=")
        try:
            first, second = (float(value) for value in values.split(","))
        except ValueError:
            name = ""
        if not name or name in states:
            raise ConfigError(
                f"capture: --state {word}: {'given twice' if name else 'not understood'}. "
                "Expected JOINT=Q0,Q1 once per joint, rad or scene units; write --state door=0,1.2"
            )
        states[name] = first, second
    return states


def choose_states(
    rig: Rig, states: States | None, model: Path
) -> list[tuple[JointInfo, tuple[float, float]]]:
    """Return the moving joints in model order with both positions."""
    by_name = {j.name: j for j in rig.joints}
    if not by_name:
        raise ConfigError(
            f"{model}: has no hinge and no slide joint. "
            "Expected an articulated model; give another."
        )
    chosen = states or {j.name: _default_states(j, rig.extent) for j in rig.joints}
    for name, values in chosen.items():
        if name not in by_name:
            raise ConfigError(
                f"capture: --state {name}: {model.name} has no such joint. "
                f"Available: {', '.join(by_name)}; use one of these."
            )
        _check_range(by_name[name], values)
    moves = [(j, chosen[j.name]) for j in rig.joints if j.name in chosen]
    bodies = [j.body for j, _ in moves]
    for joint, _ in moves:
        if bodies.count(joint.body) > 1:
            raise ConfigError(
                f"capture: body {rig.body_name(joint.body)!r} has several moving joints. "
                "Expected one per part; name one of them with --state."
            )
    return moves


def _default_states(joint: JointInfo, extent: float) -> tuple[float, float]:
    if joint.limits is None:
        return 0.0, FREE_HINGE_RAD if joint.hinge else FREE_SLIDE_SHARE * extent
    low, high = joint.limits
    first, second = (low + share * (high - low) for share in RANGE_SHARES)
    return first, second


def _check_range(joint: JointInfo, values: tuple[float, float]) -> None:
    low, high = joint.limits or (-np.inf, np.inf)
    # Ranges given in degrees carry rounding of about 1e-6 after conversion.
    if not all(np.isfinite(v) and low - 1e-6 <= v <= high + 1e-6 for v in values):
        raise ConfigError(
            f"capture: --state {joint.name}={values[0]:g},{values[1]:g} leaves the joint's range "
            f"[{low:g}, {high:g}]. Expected two values inside (rad or scene units); change them."
        )
    if values[0] == values[1]:
        raise ConfigError(
            f"capture: --state {joint.name}={values[0]:g},{values[1]:g} does not move. "
            "Expected two different values; change one."
        )
