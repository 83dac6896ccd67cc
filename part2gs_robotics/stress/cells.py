"""One simulation under one setting: what came of it, what it cost, how wrong it was."""

from __future__ import annotations

import time
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from part2gs_robotics.model.arrays import F64

if TYPE_CHECKING:
    import mujoco

Status = Literal["ok", "inaccurate", "diverged"]
SAMPLES = 8  # times of a run at which it is compared: enough to see a swing, few enough to be cheap
RIGHT = 0.01  # of the range: what the row `time step` allows as well
LOST = 1.0  # of the range: further off, and the run has left the model
NOISY = 0.02  # s of one run below which it is timed again: the clock of a thread ticks in ms


@dataclass(frozen=True)
class Start:
    """Where a run begins.

    Attributes:
        model: compiled.  qpos: [nq].  qvel: [nv].  ctrl: [nu], constant.
        watched: addresses in qpos that are compared.  scale: [W] what 1 of an error is.
    """

    model: mujoco.MjModel
    qpos: F64
    qvel: F64
    ctrl: F64
    watched: tuple[int, ...]
    scale: F64


@dataclass(frozen=True)
class Trace:
    """What came of a run.

    Attributes:
        path: [S, W] watched positions over their scale, S <= SAMPLES; NaN where it blew up.
        seconds: of the processor.  penetration: deepest contact at a sample, units.
        warnings: of the engine.  iterations: of the solver, mean at the samples.
    """

    path: F64
    seconds: float
    penetration: float
    warnings: tuple[str, ...]
    iterations: float


@dataclass(frozen=True)
class Cell:
    """One setting of a study: what was set, and how the run compares with the right answer.

    Attributes:
        set: settings by name.  status: by `error` against RIGHT and LOST.
        error: largest, of the range; None where the run is not finite.
    """

    set: dict[str, Any]
    status: Status
    error: float | None
    seconds: float
    penetration: float = 0.0
    warnings: tuple[str, ...] = ()
    iterations: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**self.set, "status": self.status, "error": self.error, "seconds": self.seconds,
                "penetration": self.penetration, "warnings": list(self.warnings),
                "iterations": self.iterations}


def with_options(start: Start, **options: Any) -> Start:
    """Return the same start under other values of `MjOption`; the model itself is not touched."""
    model = copy(start.model)
    for name, value in options.items():
        setattr(model.opt, name, value)
    return replace(start, model=model)


def run(start: Start, seconds: float, count: int) -> Trace:
    """Step a start through a time.

    Args:
        start: with its options.
        seconds: of the simulation.
        count: steps; where more than SAMPLES, a multiple of it.
    """
    trace = _once(start, seconds, count)
    if trace.seconds < NOISY:
        trace = replace(trace, seconds=min(trace.seconds, _once(start, seconds, count).seconds))
    return trace


def _once(start: Start, seconds: float, count: int) -> Trace:
    import mujoco

    model = copy(start.model)
    model.opt.timestep = seconds / count
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = start.qpos, start.qvel, start.ctrl
    samples = min(count, SAMPLES)
    path, depth, tries = np.full((samples, len(start.watched)), np.nan), 0.0, list[int]()
    spent = 0.0
    for k in range(samples):
        began = time.thread_time()
        mujoco.mj_step(model, data, count // samples)
        spent += time.thread_time() - began
        if not np.isfinite(data.qpos).all() or np.abs(data.qpos).max(initial=0.0) > 1e9:
            break
        path[k] = data.qpos[list(start.watched)] / start.scale
        depth = max(depth, -float(data.contact.dist.min(initial=0.0)))
        tries.append(int(np.max(data.solver_niter[:max(1, data.nisland)], initial=0)))
    kinds = mujoco.mjtWarning.__members__.items()
    said = tuple(n for n, w in kinds if int(w) < len(data.warning) and data.warning[int(w)].number)
    return Trace(path, spent, depth, said, float(np.mean(tries)) if tries else 0.0)


def error_of(trace: Trace, right: F64) -> float:
    """Return the largest distance of a run from the right answer at the samples they share.

    Args:
        trace: of a run.
        right: [SAMPLES, W] positions over their scale; NaN in the run gives NaN.
    """
    stride = len(right) // len(trace.path)
    return float(np.abs(trace.path - right[stride - 1::stride]).max(initial=0.0))


def judged(trace: Trace, right: F64, settings: dict[str, Any], allowed: float = RIGHT) -> Cell:
    """Return a run as a cell: diverged where it is not finite, far off, or the engine says so."""
    error = error_of(trace, right)
    lost = not error < LOST or any(w.startswith("mjWARN_BAD") for w in trace.warnings)
    status: Status = "diverged" if lost else "ok" if error <= allowed else "inaccurate"
    known = error if np.isfinite(error) else None
    return Cell(settings, status, known, trace.seconds, trace.penetration, trace.warnings,
                trace.iterations)


def against(right: Callable[[F64], F64], seconds: float, count: int) -> F64:
    """Return [SAMPLES, 1] of a closed form x(t) at the samples of a run.

    Args:
        right: positions [S] over their scale at times [S], s.
        seconds: of the simulation.
        count: steps of the run; fewer than SAMPLES are compared where they are.
    """
    samples = min(count, SAMPLES)
    return right(seconds * np.arange(1, samples + 1) / samples)[:, None]
