"""Solvers, stiffness of contacts, and room around moving parts, each over its whole span."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks.response import FAST, run_of
from part2gs_robotics.sim_checks.subject import Subject
from part2gs_robotics.stress.cells import SAMPLES, Cell, Start, judged, run, with_options
from part2gs_robotics.stress.precision import INTEGRATORS, SECONDS

SOLVERS = ("PGS", "CG", "Newton")  # in the engine's order
ITERATIONS = (1, 2, 5, 20, 100)  # of the solver: one, to its own default
SOLREFS = (0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)  # s
ROOM = (0.0, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)  # m between moving parts and what is around
REFINED = 8  # times finer: the run of a stiffness is compared with itself at such a step
MEETS = 0.05  # of the range: impacts fall between two steps, and one of 2 ms moves 0.8 %
ARRIVES = 0.01  # of the way that may lack, as in `reach`


def own_count(step: float) -> int:
    """Return the steps of a motion at a model's own time step, or at the next that fits samples."""
    return SAMPLES * max(1, round(SECONDS / step / SAMPLES))


def solvers(start: Start, right: F64) -> list[Cell]:
    """Return a cell per integrator, solver and number of iterations, at the model's own step."""
    count = own_count(start.model.opt.timestep)
    tasks = [partial(_solved, start, right, (count, i, s, n)) for i in range(len(INTEGRATORS))
             for s in range(len(SOLVERS)) for n in ITERATIONS]
    return in_threads(tasks)


def _solved(start: Start, right: F64, setting: tuple[int, int, int, int]) -> Cell:
    count, integrator, solver, tries = setting
    chosen = with_options(start, integrator=integrator, solver=solver, iterations=tries)
    return judged(run(chosen, SECONDS, count), right, {
        "integrator": INTEGRATORS[integrator], "solver": SOLVERS[solver], "tries": tries}, MEETS)


def stiffness(start: Start) -> list[Cell]:
    """Return a cell per solref of every contact and limit, against the same at a finer step."""
    return in_threads([partial(_stiff, start, solref) for solref in SOLREFS])


def _stiff(start: Start, solref: float) -> Cell:
    model = copy(start.model)
    for name in ("geom_solref", "jnt_solref", "dof_solref", "pair_solref"):
        getattr(model, name)[:] = (solref, 1.0)
    hard, count = replace(start, model=model), own_count(start.model.opt.timestep)
    right = run(hard, SECONDS, REFINED * count).path
    return judged(run(hard, SECONDS, count), right, {"solref": solref}, MEETS)


def room(subject: Subject, meters: float) -> list[Cell]:
    """Return a cell per joint and clearance: everything that collides is wrapped that thickly.

    Half of it lies on each geom as a margin. The error is what a fast drive lacks of its way more
    than without wrapping.

    Args:
        subject: with servos.
        meters: per scene unit.
    """
    joints = [j for j in subject.joints if j.servo >= 0 and j.span > 0]
    runs = in_threads([partial(_wrapped, subject, j, gap / meters) for j in joints
                       for gap in ROOM])
    cells = []
    for i, joint in enumerate(joints):
        own = runs[i * len(ROOM)][0]  # a weak servo lacks some of the way without any wrapping
        for gap, (lacks, said) in zip(ROOM, runs[i * len(ROOM):], strict=False):
            error = lacks - own
            lost = bool(said) or not np.isfinite(error)
            cells.append(Cell({"joint": joint.name, "clearance": gap},
                              "diverged" if lost else "ok" if error <= ARRIVES else "inaccurate",
                              float(error) if np.isfinite(error) else None, 0.0, warnings=said))
    return cells


def _wrapped(subject: Subject, joint: DrivenJoint, gap: float) -> tuple[float, tuple[str, ...]]:
    """Return the share of its way that a wrapped joint lacks, and what the engine says."""
    model = copy(subject.model)
    model.geom_margin[:] += gap / 2
    found = run_of(replace(subject, model=model), joint, FAST)
    way = min(found.top - joint.low, found.top - found.bottom)
    return 1 - way / joint.span, found.said
