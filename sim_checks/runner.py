"""Run the checks on a twin folder or on any MJCF or URDF file."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.twin_yaml import TwinSummary, read_twin_yaml
from part2gs_robotics.sim_checks.engine import distinct, engine_messages
from part2gs_robotics.sim_checks.model_files import check_model_files
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult, Curve, passed
from part2gs_robotics.sim_checks.subject import Subject

GROUPS = ("compile", "mesh", "inertia", "limits", "states", "actuation", "overlap", "stability")
TWIN_FILES = ("twin.xml", "scene.xml", "twin.urdf")
QUICK_STEPS, QUICK_POSES = 7, 8  # a third and an eighth of what a full check looks at
WORDS = {  # the engine's message, and what to do about it
    "coplanar": "a collision piece is flat; give it thickness or drop it",
    "volume is negative": "the faces of a mesh point inwards; turn them",
    "A + B >= C": "an inertia tensor is not that of a body; recompute it from a closed mesh",
    "mjMINVAL": "a moving body has no mass; add an <inertial> or larger geometry",
}


def check(
    path: Path, *, steps: int = 21, quick: bool = False, only: Collection[str] | None = None
) -> CheckReport:
    """Check a twin folder, an MJCF or a URDF file in the installed MuJoCo.

    Args:
        path: folder with twin.xml, or a model file. Everything it names must lie in its folder.
        steps: positions per joint of the overlap sweep.
        quick: fewer positions and no stability rows.
        only: names of the groups to run (GROUPS); None = all.

    Raises:
        CheckError: if the path, a file it names or a group cannot be used.

    Example:
        report = check(Path("out"))
        sys.stdout.write(format_text(report))
    """
    import mujoco

    began = time.perf_counter()
    wanted = _wanted(only, quick)
    folder, files, summary = _files(Path(path))
    engine = f"mujoco {mujoco.__version__}"
    with engine_messages() as messages:
        # the engine keeps meshes by name and second of change: a file rewritten at once is stale
        mujoco.mj_clearCache(mujoco.mj_getCache())
        results, subject = _compile(files, messages)
        report = CheckReport(str(path), engine, tuple(results))
        messages.clear()
        if subject is not None:
            twin = folder is not None
            steps, poses = (QUICK_STEPS, QUICK_POSES) if quick else (steps, 64)
            report = _run(report, subject, summary, wanted, steps, poses, twin)
    # Sorted: which simulation speaks first is chance.
    said = tuple(f"the engine warned: {line}" for line in sorted(distinct(messages)))
    return replace(report, notes=report.notes + said, seconds=time.perf_counter() - began)


def _wanted(only: Collection[str] | None, quick: bool) -> set[str]:
    names = set(GROUPS if only is None else only)
    if unknown := sorted(names - set(GROUPS)):
        raise CheckError(f"unknown check {unknown[0]!r}. Available: {', '.join(GROUPS)}.")
    return names - {"stability"} if quick and only is None else names


def _files(path: Path) -> tuple[Path | None, list[Path], TwinSummary | None]:
    """Return the twin folder (None for a single file), the model files, and its description."""
    if path.is_dir():
        files = [path / name for name in TWIN_FILES if (path / name).is_file()]
        if not files or files[0].name != "twin.xml":
            raise CheckError(
                f"{path}: holds no twin.xml. "
                "Needed a folder written by `build`, or the name of an MJCF or URDF file."
            )
        return path, files, read_twin_yaml(path) if (path / "twin.yaml").is_file() else None
    if not path.is_file():
        raise CheckError(
            f"{path}: does not exist. Needed a twin folder, an MJCF or a URDF file; check the path."
        )
    return None, [path], None


def _compile(files: list[Path], messages: list[str]) -> tuple[list[CheckResult], Subject | None]:
    """Compile every file; the first one is the subject of all other checks."""
    from part2gs_robotics.sim_checks.subject import load_spec, make_subject

    rows: list[CheckResult] = []
    subject = None
    for i, file in enumerate(files):
        check_model_files(file)
        messages.clear()
        try:
            if i == 0:
                subject = make_subject(file)
            else:
                load_spec(file)[0].compile()
        except ValueError as error:
            rows.append(CheckResult("compile", file.name, "fail", detail=_plain_words(str(error))))
            continue
        if subject is not None and subject.model.nbody == 1 and not subject.model.ngeom:
            messages.append("the model is empty")
        said = "; ".join(distinct(messages))
        status = passed(not said)
        rows.append(CheckResult("compile", file.name, status, detail=said or "no warning"))
    return rows, subject


def _plain_words(message: str) -> str:
    line = " ".join(message.split())
    hints = [hint for key, hint in WORDS.items() if key in line]
    return f"{line} ({hints[0]})" if hints else line


def _run(report: CheckReport, subject: Subject, summary: TwinSummary | None, wanted: set[str],
         steps: int, poses: int, twin: bool) -> CheckReport:
    from part2gs_robotics.sim_checks import static
    from part2gs_robotics.sim_checks.actuation import check_actuation
    from part2gs_robotics.sim_checks.interpenetration import check_interpenetration
    from part2gs_robotics.sim_checks.order import in_order
    from part2gs_robotics.sim_checks.self_intersection import check_self_intersections, warnings_of
    from part2gs_robotics.sim_checks.stability import check_stability

    rows, curves = list(report.results), list[Curve]()
    rows += static.check_meshes(subject) if "mesh" in wanted else []
    rows += check_self_intersections(subject) if "mesh" in wanted else []
    rows += static.check_inertia(subject) if "inertia" in wanted else []
    rows += static.check_limits(subject) if "limits" in wanted else []
    rows += static.check_states(subject, twin) if "states" in wanted else []
    driven = wanted & {"actuation", "overlap", "stability"}
    subject, sweeps = in_order(subject, steps) if driven else (subject, {})
    rows += check_actuation(subject) if "actuation" in wanted else []
    if "overlap" in wanted:
        found, curves = check_interpenetration(subject, sweeps, poses)
        rows += found
    stuck = {r.subject for r in rows if r.name == "reach" and r.status == "fail"}
    rows += check_stability(subject, stuck) if "stability" in wanted else []
    return CheckReport(
        report.path,
        report.engine,
        tuple(rows),
        tuple(j.name for j in subject.joints),
        tuple(curves),
        tuple(static.losses_table(subject, summary, rows)),
        tuple(static.pieces_table(subject)) if "overlap" in wanted else (),
        (*_notes(subject, wanted), *warnings_of(rows)),
        size=subject.size,
    )


def _notes(subject: Subject, wanted: set[str]) -> tuple[str, ...]:
    left_out = [g for g in GROUPS if g not in wanted and g != "compile"]
    return ("base fixed, parent-child contacts not filtered, automatic reset off", *subject.notes,
            *((f"not run: {', '.join(left_out)}",) if left_out else ()))
