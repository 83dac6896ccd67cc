"""All studies of one model: rows, numbers, pictures, advice."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from part2gs_robotics.agree.finding import CheckResult, Status
from part2gs_robotics.agree.of_yaml import number
from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.assets.model_files import check_model_files
from part2gs_robotics.assets.opened import opened
from part2gs_robotics.exporters.twin_yaml import read_twin_yaml
from part2gs_robotics.sim_checks.subject import Subject, actuated_twin, compile_spec, make_subject
from part2gs_robotics.stress import bullet, closed, extremes, motions, scaled
from part2gs_robotics.stress.advice import Advice, advice, frontier
from part2gs_robotics.stress.cells import RIGHT, Cell, Start, judged, run
from part2gs_robotics.stress.extremes import MEETS, own_count
from part2gs_robotics.stress.picture import diagrams_svg, frontier_svg
from part2gs_robotics.stress.precision import INTEGRATORS, SECONDS, Diagram, diagram, diverges_at

PASSIVE, ACTUATED, SCENE = "twin.xml", "twin_actuated.xml", "scene.xml"


STEP = "take the step and integrator of the row `advised step` (--apply, in a twin folder)"
VERDICTS: dict[str, Status] = {"ok": "pass", "inaccurate": "warn", "diverged": "fail"}


@dataclass(frozen=True)
class Study:
    """What came of all studies.

    Attributes:
        rows: of the report.  numbers: plain values for JSON, pictures among them.  chosen: advice.
    """

    rows: tuple[CheckResult, ...]
    numbers: dict[str, Any]
    chosen: Advice


def stress(path: Path, root: Path | None = None) -> Study | None:
    """Return what extremes make of a model; None where nothing of it moves.

    Args:
        path: twin folder, MJCF, URDF or USD file, which `check` has found to be sound enough.
        root: folder that nothing a model names may leave; None = its own.

    Raises:
        CheckError, ValueError: it cannot be opened or compiled.

    Example:
        study = stress(Path("out"))
    """
    with engine_messages():
        if not path.is_dir():
            with opened(path, root) as file:
                ours = (path.parent / "twin.yaml").is_file()
                return study_of(make_subject(file, ours=ours), file)
        for name in (PASSIVE, ACTUATED, SCENE):
            if (path / name).is_file():
                check_model_files(path / name, root)
        options = compile_spec(path / SCENE).opt if (path / SCENE).is_file() else None
        bare = not (path / ACTUATED).is_file()
        subject = make_subject(path / PASSIVE, options, servos=bare)
        if bare:
            return study_of(subject, path / PASSIVE)
        subject = actuated_twin(subject, path / ACTUATED, options)
        told = read_twin_yaml(path) if (path / "twin.yaml").is_file() else None
        meters = number(told.document, "meters_per_unit") if told else 1.0
        return study_of(subject, path / ACTUATED, meters, subject.model.opt.timestep)


def study_of(subject: Subject, path: Path, meters: float = 1.0, most: float = np.inf
             ) -> Study | None:
    """Return what extremes make of a model; None where nothing of it moves.

    Args:
        subject: with servos, under the options of its world.
        path: file that it was compiled from.
        meters: per scene unit.
        most: largest time step that may be advised, s.
    """
    joints = [j for j in subject.joints if j.span > 0]
    if not joints:
        return None
    began, model = time.perf_counter(), subject.model
    meets = motions.contact(subject, path)
    starts = motions.smooth(subject), meets
    ways = diagram("smooth", starts[0]), diagram("contact", meets)
    cells = {
        "solver": extremes.solvers(meets, ways[1].reference),
        "mass ratio": closed.mass_ratios(model, joints), "gain": closed.gains(model, joints),
        "solref": extremes.stiffness(meets), "wall": bullet.walls(model, subject.size),
        "clearance": extremes.room(subject, meters), "scale": scaled.scales(meets)}
    chosen = advice(*ways, INTEGRATORS[int(model.opt.integrator)], most)
    rows = [_own_step(start, d) for start, d in zip(starts, ways, strict=True)] + [_ladder(ways)]
    rows += [_ratios(cells["mass ratio"]), *_spans(cells), _walls(subject, cells["wall"])]
    rows.append(CheckResult("advised step", "", "pass", chosen.step, None, "s", chosen.said))
    numbers = {"precision": {d.kind: d.to_dict() for d in ways}, "advice": chosen.to_dict(),
               "cells": {k: [c.to_dict() for c in v] for k, v in cells.items()},
               "seconds": round(time.perf_counter() - began, 2),
               "pictures": {"precision": diagrams_svg(ways, model.opt.timestep),
                            "frontier": frontier_svg(cells)}}
    return Study(tuple(rows), numbers, chosen)


def _own_step(start: Start, found: Diagram) -> CheckResult:
    """Return how wrong a motion is at the model's own step and integrator."""
    opt = start.model.opt
    limit = RIGHT if found.kind == "smooth" else MEETS
    cell = judged(run(start, SECONDS, own_count(opt.timestep)), found.reference, {}, limit)
    error = np.inf if cell.error is None else cell.error
    status = VERDICTS[cell.status]
    return CheckResult("own step", found.kind, status, float(error), limit, "of range",
                       f"{INTEGRATORS[int(opt.integrator)]} at {opt.timestep:.3g} s; the reference "
                       f"is known to {found.own_error:.1g}",
                       "" if status == "pass" else f"<option>: {STEP}")


def _ladder(ways: Sequence[Diagram]) -> CheckResult:
    """Return at which step each integrator diverges, and how fast errors fall."""
    told = []
    for name in INTEGRATORS:
        ends = [diverges_at(d.line(name)) * 1e3 for d in ways]
        where = "/".join(f"{e:.3g}" if np.isfinite(e) else "never" for e in ends)
        order = ways[0].orders[name]
        told.append(f"{name} {where}" + (f" (order {order:.1f})" if np.isfinite(order) else ""))
    return CheckResult("ladder", "", "pass", detail="diverges from ... ms on, smooth/contact: "
                       + ", ".join(told))


def _ratios(cells: Sequence[Cell]) -> CheckResult:
    """Return the joint and mass that are furthest from the closed form; the own mass must fit."""
    worst = max(cells, key=lambda c: np.inf if c.error is None else c.error)
    own = max((np.inf if c.error is None else c.error) for c in cells if c.set["ratio"] == 1.0)
    low, high = frontier(cells, "ratio")
    status: Status = "fail" if own > RIGHT else "pass" if low <= 1e-6 and high >= 1e6 else "warn"
    return CheckResult(
        "mass ratio", str(worst.set["joint"]), status, worst.error, RIGHT, "of range",
        f"a push against its closed form holds from {low:g} to {high:g} times the mass; worst at "
        f"{worst.set['ratio']:g}", "" if status == "pass" else f"<option>: {STEP}, or give the "
        "joint an armature")


def _spans(cells: dict[str, list[Cell]]) -> list[CheckResult]:
    """Return the span of values that hold, of every study without a value of its own."""
    out = []
    texts = {"gain": "", "solref": "contacts end where a finer step ends, from {:g} to {:g} s",
             "clearance": "joints go all their way with {:g} to {:g} m wrapped around them",
             "scale": "a motion scales as it must from {:g} to {:g} times the size"}
    for name, text in texts.items():
        low, high = frontier(cells[name], name)
        if name == "gain":
            out.append(_gains(cells[name]))
            continue
        broken = sorted({c.set[name] for c in cells[name] if c.status == "diverged"})
        detail = text.format(low, high) if np.isfinite(low) else "no value of the study holds"
        if broken:
            detail += f"; diverges at {', '.join(f'{v:g}' for v in broken)}"
        out.append(CheckResult(f"{name} span", "", "pass" if np.isfinite(low) else "warn",
                               None, None, "", detail, "" if np.isfinite(low) else
                               "<option>: take a smaller time step"))
    fine = [c for c in cells["solver"] if c.status == "ok"]
    few = {s: min((c.set["tries"] for c in fine if c.set["solver"] == s), default=0)
           for s in extremes.SOLVERS}
    text = ", ".join(f"{s} {n or 'never'}" for s, n in few.items())
    out.append(CheckResult("solver span", "", "pass" if fine else "warn", detail=f"{len(fine)} of "
                           f"{len(cells['solver'])} settings are right; iterations needed: {text}"))
    return out


def _gains(cells: Sequence[Cell]) -> CheckResult:
    """Return per joint up to which gain a servo follows its closed form."""
    joints = list(dict.fromkeys(c.set["joint"] for c in cells))
    told = {j: frontier([c for c in cells if c.set["joint"] == j], "gain") for j in joints}
    text = ", ".join(f"{j} {low:g} to {high:g}" for j, (low, high) in told.items())
    fine = all(np.isfinite(low) for low, _ in told.values())
    return CheckResult("gain span", "", "pass" if fine else "warn", None, None, "", "critically "
                       f"damped servos follow their closed form: {text}",
                       "" if fine else f"<option>: {STEP}")


def _walls(subject: Subject, cells: Sequence[Cell]) -> CheckResult:
    """Return how fast a ball may hit the thinnest piece without coming through."""
    thin = bullet.thinnest(subject.model)
    passed = sum(bool(c.error) for c in cells)
    if not np.isfinite(thin):
        return CheckResult("tunnelling", "", "skipped", detail="nothing of the model collides")
    most = bullet.fastest(subject.model, subject.size, thin / subject.size) * subject.size
    return CheckResult("tunnelling", "", "pass", most, None, "units/s",
                       f"a ball faster than this passes the thinnest piece, {thin:.3g} units; "
                       f"{passed} of {len(cells)} walls and speeds are passed")
