"""Error against run time: every integrator at every time step, against a reference of known error.

The same runs are the ladder of time steps: from 0.1 ms up to where each integrator diverges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.stress.cells import Cell, Start, error_of, judged, run, with_options

Kind = Literal["smooth", "contact"]
INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")  # in the engine's order
SECONDS = 0.256  # of either motion: eight settling times of a servo of 30 rad/s
COUNTS = tuple(2**k for k in range(12))  # steps of one run: 256 ms to 0.125 ms
FINEST = 2**13  # steps of the reference: four times the finest run
# Whose reference: fourth order where the motion is smooth, the most stable one where it is not.
REFERENCE = {"smooth": 1, "contact": 3}
FLOOR = 1e-15  # of an error: rounding


@dataclass(frozen=True)
class Diagram:
    """Work and precision of one motion.

    Attributes:
        kind: smooth or contact.  cells: one per integrator and number of steps.
        reference: [S, W] positions.  own_error: of the reference, of the range.
        orders: measured order of accuracy by integrator; NaN = not seen.
    """

    kind: Kind
    cells: tuple[Cell, ...]
    reference: F64
    own_error: float
    orders: dict[str, float]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"seconds": SECONDS, "reference": {
            "integrator": INTEGRATORS[REFERENCE[self.kind]], "step": SECONDS / FINEST,
            "own_error": self.own_error},
            "orders": {k: v if np.isfinite(v) else None for k, v in self.orders.items()},
            "points": [c.to_dict() for c in self.cells]}

    def line(self, integrator: str) -> list[Cell]:
        """Return the cells of one integrator, coarse steps first."""
        return [c for c in self.cells if c.set["integrator"] == integrator]


def diagram(kind: Kind, start: Start, finest: int = FINEST) -> Diagram:
    """Return the work-precision diagram of a motion.

    The reference is one integrator at the finest step; its own error is its distance from the same
    at twice the step, which an order of one or more at least halves again: the true error is not
    larger. What is closer to it than that is not told from it.

    Args:
        kind: of the motion.
        start: of it.
        finest: steps of the reference, a power of two from 16.
    """
    best = with_options(start, integrator=REFERENCE[kind])
    right = run(best, SECONDS, finest).path
    coarser = run(best, SECONDS, finest // 2)
    own = max(error_of(coarser, right), FLOOR)
    cells = []
    for number, name in enumerate(INTEGRATORS):
        chosen = with_options(start, integrator=number)
        for count in (c for c in COUNTS if c <= finest // 4):
            step = SECONDS / count
            cells.append(judged(run(chosen, SECONDS, count), right,
                                {"integrator": name, "step": step}))
    orders = {name: order_of([c for c in cells if c.set["integrator"] == name], own)
              for name in INTEGRATORS}
    return Diagram(kind, tuple(cells), right, own, orders)


def order_of(cells: list[Cell], own_error: float) -> float:
    """Return how an error falls with the step: the median slope of log error over log step.

    Args:
        cells: of one integrator.
        own_error: of the reference; what is less than ten times that says nothing.
    """
    steps = np.array([c.set["step"] for c in cells])
    errors = np.array([np.nan if c.error is None else c.error for c in cells])
    told = (errors > 10 * own_error) & (errors < 0.1) & np.isfinite(errors)
    if told.sum() < 2:
        return float("nan")
    return float(np.median(np.diff(np.log(errors[told])) / np.diff(np.log(steps[told]))))


def diverges_at(cells: list[Cell]) -> float:
    """Return the smallest step from which on no coarser one is right or merely inaccurate; s."""
    steps = sorted((c.set["step"], c.status) for c in cells)
    worst = [step for step, status in steps if status == "diverged"]
    good = [step for step, status in steps if status != "diverged"]
    return min((s for s in worst if s > max(good, default=0.0)), default=float("inf"))
