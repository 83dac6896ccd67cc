"""Run the checks on a twin folder or on any MJCF, URDF or USD file."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.assets.engine import distinct, engine_messages
from part2gs_robotics.assets.model_files import check_model_files
from part2gs_robotics.assets.opened import opened
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.twin_yaml import TwinSummary, read_twin_yaml
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult, Curve, passed, with_causes
from part2gs_robotics.sim_checks.subject import UNREAL, Subject

if TYPE_CHECKING:
    import mujoco

GROUPS = ("compile", "files", "mesh", "inertia", "limits", "states", "actuation", "overlap",
          "stability", "passive")  # fmt: skip
SLOW = {"stability", "passive"}  # groups that a quick check leaves out
ACTUATED, WORLD, URDF = "twin_actuated.xml", "scene.xml", "twin.urdf"
TWIN_FILES = ("twin.xml", ACTUATED, WORLD, URDF)
QUICK_STEPS, QUICK_POSES = 7, 8  # a third and an eighth of what a full check looks at
MEND = "correct what the engine names, or build the twin again"
WORDS = {  # the engine's message, and what to do about it
    "coplanar": "a collision piece is flat; give it thickness or drop it",
    "volume is negative": "the faces of a mesh point inwards; turn them",
    "A + B >= C": "an inertia tensor is not that of a body; recompute it from a closed mesh",
    "mjMINVAL": "a moving body has no mass; add an <inertial> or larger geometry",
}


@dataclass(frozen=True)
class Extent:
    """Positions, random poses, whether the long rows too; whether in a twin folder."""

    steps: int
    poses: int
    stress: bool
    folder: bool


@dataclass(frozen=True)
class Models:
    """What is under test.

    Attributes:
        still: whose shapes, masses, limits and states are looked at; passive in a twin folder.
        driven: the same with motors; `still` itself for a single file and folders of one twin.xml.
    """

    still: Subject
    driven: Subject

    @property
    def passive(self) -> bool:
        """True when `still` is meant to be without motors."""
        return self.still is not self.driven


def check(path: Path, *, steps: int = 21, quick: bool = False, stress: bool = False,
          only: Collection[str] | None = None, root: Path | None = None) -> CheckReport:
    """Check a twin folder, an MJCF, a URDF or a USD file in the installed MuJoCo.

    Args:
        path: folder with twin.xml, or a model file. Everything it names must lie in its folder.
        steps: positions per joint of the overlap sweep.
        quick: fewer positions, no stability and no passive rows.
        stress: also the long rows: ten seconds of rest, slow drives.
        only: names of the groups to run (GROUPS); None = all.
        root: folder that nothing a model names may leave, where its own folder is too narrow.

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
    with engine_messages() as messages, _opened(folder, files, root) as (files, ours):
        # the engine keeps meshes by name and second of change: a file rewritten at once is stale
        mujoco.mj_clearCache(mujoco.mj_getCache())
        results, models, compiled = _compile(files, messages, ours)
        if folder is not None and "files" in wanted and (summary is not None or files[1:]):
            results += _files_rows(folder, compiled)
        report = CheckReport(str(path), engine, tuple(with_causes(results)))
        messages.clear()
        if models is not None:
            steps, poses = (QUICK_STEPS, QUICK_POSES) if quick else (steps, 64)
            extent = Extent(steps, poses, stress, folder is not None)
            report = _run(report, models, summary, wanted, extent)
    # Sorted: which simulation speaks first is chance.
    said = tuple(f"the engine warned: {line}" for line in sorted(distinct(messages)))
    return replace(report, notes=report.notes + said, seconds=time.perf_counter() - began)


def _wanted(only: Collection[str] | None, quick: bool) -> set[str]:
    names = set(GROUPS if only is None else only)
    if unknown := sorted(names - set(GROUPS)):
        raise CheckError(f"unknown check {unknown[0]!r}. Available: {', '.join(GROUPS)}.")
    return names - SLOW if quick and only is None else names


def _files(path: Path) -> tuple[Path | None, list[Path], TwinSummary | None]:
    """Return the twin folder (None for a single file), the model files, and its description."""
    if path.is_dir():
        files = [path / name for name in TWIN_FILES if (path / name).is_file()]
        if not files or files[0].name != "twin.xml":
            raise CheckError(
                f"{path}: holds no twin.xml. "
                "Needed a folder written by `build`, or the name of an MJCF, URDF or USD file."
            )
        return path, files, read_twin_yaml(path) if (path / "twin.yaml").is_file() else None
    if not path.is_file():
        raise CheckError(
            f"{path}: does not exist. Needed a twin folder, an MJCF, URDF or USD file; check the "
            "path."
        )
    return None, [path], None


@contextmanager
def _opened(folder: Path | None, files: list[Path], root: Path | None
            ) -> Iterator[tuple[list[Path], bool]]:
    """Inspect all files, and give those that the engine opens; whether this program wrote them."""
    ours = folder is not None or (files[0].parent / "twin.yaml").is_file()
    if folder is not None:
        for file in files:
            check_model_files(file, root)
        yield files, ours
        return
    with opened(files[0], root) as file:
        yield [file], ours


def _files_rows(folder: Path, compiled: dict[str, mujoco.MjModel]) -> list[CheckResult]:
    """Return what the files of a twin folder say against each other."""
    from part2gs_robotics.agree.folder import agreement, further
    from part2gs_robotics.contract import contract

    sdf = [name for name, kind in further(folder).items() if kind == "sdf"]
    for name in sdf:
        check_model_files(folder / name)
    return agreement(folder, compiled) + contract(folder, sdf, compiled)


Compiled = tuple[list[CheckResult], Models | None, dict[str, "mujoco.MjModel"]]


def _compile(files: list[Path], messages: list[str], ours: bool) -> Compiled:
    """Compile every file; the first one is the subject, its servos those of twin_actuated.xml.

    A twin holds no options of its own: those of scene.xml count for all files of a folder.
    """
    rows: dict[str, CheckResult] = {}
    subjects: dict[str, Subject] = {}
    compiled: dict[str, mujoco.MjModel] = {}
    names, options = [f.name for f in files], None
    for file in sorted(files, key=lambda f: len(files) > 1 and f.name != WORLD):
        messages.clear()
        try:
            compiled[file.name] = model = _load(file, (names, ours), subjects, options)
        except ValueError as error:
            said = _plain_words(str(error))
            rows[file.name] = CheckResult("compile", file.name, "fail", detail=said,
                                          cause=f"{file.name}: {MEND}")
            continue
        if file.name == WORLD and ACTUATED in names:
            options = model.opt
        if file == files[0] and model.nbody == 1 and not model.ngeom:
            messages.append("the model is empty")
        said = "; ".join(distinct(messages))
        status, said = passed(not said), said or "no warning"
        rows[file.name] = CheckResult("compile", file.name, status, detail=said)
    still = subjects.get(names[0])
    results = [rows[name] for name in names]
    numbers = {r.subject for r in results if r.detail.startswith(UNREAL)}
    if still is None or (ACTUATED in names and ACTUATED not in subjects) or numbers - {URDF}:
        return results, None, compiled
    driven = subjects.get(ACTUATED, still)
    return [*results, *_same(still, driven)], Models(still, driven), compiled


def _load(file: Path, folder: tuple[list[str], bool], subjects: dict[str, Subject],
          options: mujoco.MjOption | None) -> mujoco.MjModel:
    """Compile one file, and make it a subject where the checks look at it.

    Folder: the names of all files, and whether this program wrote them.

    Raises:
        ValueError: MuJoCo's own message, or a number that no model can have.
    """
    from part2gs_robotics.sim_checks.subject import actuated_twin, compile_spec, make_subject

    names, ours = folder
    if file.name == names[0]:
        bare = ACTUATED not in names
        subjects[file.name] = make_subject(file, options, servos=bare, ours=ours)
        # servos of ours are no part of the file
        return compile_spec(file) if bare else subjects[file.name].model
    if file.name == ACTUATED and names[0] in subjects:
        subjects[ACTUATED] = actuated_twin(subjects[names[0]], file, options)
        return subjects[ACTUATED].model
    return compile_spec(file)


def _same(still: Subject, driven: Subject) -> list[CheckResult]:
    """Return whether both twins of a folder are one, but for the servos."""
    from part2gs_robotics.sim_checks.subject import difference

    if still is driven:
        return []
    found = difference(still.model, driven.model)
    detail = f"differs from twin.xml in {found}" if found else "as twin.xml, with servos"
    return [CheckResult("same twin", ACTUATED, passed(not found), detail=detail)]


def _plain_words(message: str) -> str:
    line = " ".join(message.split())
    hints = [hint for key, hint in WORDS.items() if key in line]
    return f"{line} ({hints[0]})" if hints else line


def _run(report: CheckReport, models: Models, summary: TwinSummary | None, wanted: set[str],
         extent: Extent) -> CheckReport:
    """Return the report with the rows of all wanted groups."""
    from part2gs_robotics.sim_checks import static
    from part2gs_robotics.sim_checks.actuation import check_actuation
    from part2gs_robotics.sim_checks.blocking import check_combinations
    from part2gs_robotics.sim_checks.interpenetration import check_interpenetration
    from part2gs_robotics.sim_checks.order import in_order
    from part2gs_robotics.sim_checks.passive import check_passive
    from part2gs_robotics.sim_checks.self_intersection import check_self_intersections, warnings_of

    still, driven = models.still, models.driven
    rows, curves = list(report.results), list[Curve]()
    rows += static.check_meshes(still) if "mesh" in wanted else []
    rows += check_self_intersections(still) if "mesh" in wanted else []
    rows += static.check_inertia(still) if "inertia" in wanted else []
    rows += static.check_limits(still) if "limits" in wanted else []
    rows += static.check_states(still, extent.folder) if "states" in wanted else []
    moved = wanted & {"actuation", "overlap", "stability", "passive"}
    still, sweeps = in_order(still, extent.steps) if moved else (still, {})
    driven = replace(driven, around=still.around)
    rows += check_actuation(driven) if "actuation" in wanted else []
    if "overlap" in wanted:
        found, curves = check_interpenetration(still, sweeps)
        rows += found + check_combinations(still, sweeps, extent.poses)
    table = static.pieces_table(still) if "overlap" in wanted else []
    rows += static.check_pieces(still, table)
    stuck = {r.subject for r in rows if r.name == "reach" and r.status == "fail"}
    rows += _servos(driven, stuck, (extent.stress, report.path)) if "stability" in wanted else []
    rows += check_passive(still) if "passive" in wanted and models.passive else []
    return CheckReport(
        report.path,
        report.engine,
        tuple(with_causes(rows)),
        tuple(j.name for j in still.joints),
        tuple(curves),
        tuple(static.losses_table(still, summary, rows)),
        tuple(table),
        (*_notes(still, models.passive, wanted), *warnings_of(rows)),
        size=still.size,
    )


def _servos(driven: Subject, stuck: set[str], how: tuple[bool, str]) -> list[CheckResult]:
    """Return what servos make of steps, gains, drives and rest; how: long rows, and the path."""
    from part2gs_robotics.sim_checks.actuation import theirs
    from part2gs_robotics.sim_checks.motors import check_motors
    from part2gs_robotics.sim_checks.response import check_response
    from part2gs_robotics.sim_checks.rest import check_rest
    from part2gs_robotics.sim_checks.stability import check_stability

    stress, path = how
    return theirs(driven, [*check_stability(driven, stuck, stress),
                           *check_response(driven, stuck, stress), *check_rest(driven, stress),
                           *check_motors(driven, Path(path))])


def _notes(subject: Subject, passive: bool, wanted: set[str]) -> tuple[str, ...]:
    left_out = [g for g in GROUPS if g not in wanted and g != "compile"]
    motors = f"servos of {ACTUATED}, options of {WORLD}; everything else of twin.xml"
    filtered = "parent-child contacts not filtered, " if subject.ours else ""
    return (f"base fixed, {filtered}automatic reset off",
            *((motors,) if passive else ()), *subject.notes,
            *((f"not run: {', '.join(left_out)}",) if left_out else ()))
