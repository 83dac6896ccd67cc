"""The twin folder: exporters, checks and report written into one fresh folder."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path
from typing import cast

import numpy as np
import yaml

from part2gs_robotics import __version__
from part2gs_robotics.agree.catalogue import CHECKS, EXPLAINED
from part2gs_robotics.config import Config, to_dict
from part2gs_robotics.errors import StoreError
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.scale import ASSUMED, with_scale
from part2gs_robotics.model.scene_frame import (
    SceneFrame,
    gaussians_in_scene,
    joint_in_scene,
    parts_in_scene,
)
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.pictures import pictures_of
from part2gs_robotics.report.report_json import ReportData, write_report
from part2gs_robotics.report.verdict import incomplete
from part2gs_robotics.result import BuildResult
from part2gs_robotics.runtime.atomic import replace_files, write_text_atomic
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult, Status

logger = logging.getLogger(__name__)


def write_outputs(folder: Path, out: Path, result: BuildResult) -> tuple[CheckReport, str]:
    """Write every file of the twin folder; returns the checks and a summary for people.

    Args:
        folder: fresh folder the files go to.
        out: where they will lie, for texts.
        result: of the build.
    """
    from part2gs_robotics.sim_checks import check

    twin = result.twin
    write_models(twin, folder, {"version": __version__, "layout": result.scene.layout,
                                "internal_frame": asdict(result.frame), **_counts(result)})
    write_text_atomic(folder / "config.yaml",
                      yaml.safe_dump(to_dict(result.config), sort_keys=False))
    splats = _write_gaussians(folder, result)
    checked = check(folder, steps=result.config.check.sweep_values)
    report = with_failed(replace(checked, path=str(out)), result.motion)
    report = with_left(report, result.left)
    write_report(folder, _told(result, report, splats))
    return report, _summary(out, twin, report)


def output_folder(scene: Path, wanted: str | None) -> Path:
    """Return where results go.

    Raises:
        StoreError: inside the scene, whose files are never touched.
    """
    resolved = scene.resolve()
    out = Path(wanted) if wanted else resolved.parent / f"{resolved.name}_twin"
    if out.resolve().is_relative_to(resolved) and scene.is_dir():
        raise StoreError(f"{out}: lies in the scene folder {scene}. Expected a folder outside of "
                         "it, the scene is never written; choose another one with -o.")
    return out


def twin_name(scene: Path, out: Path) -> str:
    """Return a file-safe name: the scene's, or the output folder's where the scene lies in it.

    A scene made of plain photos lies in the output folder, which says what it shows.
    """
    named = out if scene.parent == out else scene
    return re.sub(r"[^a-z0-9_]+", "_", named.name.lower()).strip("_") or "twin"


def twin_in_scene(twin: Twin, frame: SceneFrame, metres: float | None, config: Config) -> Twin:
    """Return a twin of internal units in the scene's own, with scale and material.

    The log says whether anybody knows the scale.
    """
    parts = parts_in_scene(twin.parts, frame, config.articulate.paper_mode)
    twin = replace(twin, parts=parts, meters_per_unit=metres, assumed_meters=frame.assumed_meters,
                   material=config.read.material)
    twin = with_scale(twin, config.read.known_length)
    level = logging.WARNING if twin.meters_per_unit is None else logging.INFO
    logger.log(level, "%s", twin.notes[-1])
    return twin


def write_models(twin: Twin, folder: Path, extra: Mapping[str, object] | None = None) -> None:
    """Write MJCF, URDF and `twin.yaml` of a twin, and the meshes they name.

    Args:
        twin: whose names, meshes and numbers all formats take.
        folder: fresh folder the files go to.
        extra: plain values of the build, for `twin.yaml`.
    """
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
    from part2gs_robotics.exporters.urdf import write_urdf

    write_mjcf(twin, folder)
    write_urdf(twin, folder)
    write_twin_yaml(twin, folder, extra)


def with_failed(report: CheckReport, motion: Motion) -> CheckReport:
    """Return the checks with a failing row for every part that could not be built."""
    rows = tuple(CheckResult("part built", "", "fail", detail=note) for note in motion.failed)
    return replace(report, results=(*report.results, *rows))


def with_left(report: CheckReport, left: LeftOver) -> CheckReport:
    """Return the checks with the row about what no part explains: incomplete, or it passes."""
    detail = (f"{left.share:.1%} of what moved between the states is explained by no part; noise "
              f"of this scene makes up to {left.bound:.1%}")
    status, cause = (("pass", "") if left.complete else
                     ("incomplete", CHECKS[EXPLAINED].change))
    row = CheckResult(EXPLAINED, "", cast("Status", status), 100 * left.share, 100 * left.bound,
                      "%", detail, cause)
    return replace(report, results=(*report.results, row))


def verdict(report: CheckReport) -> str:
    """Return the verdict of a build in a few words."""
    bad = [row for row in report.results if row.status in ("fail", "incomplete")]
    left = next((row for row in bad if row.name == EXPLAINED), None)
    words = [incomplete((left.value or 0.0) / 100)] if left else []
    if len(bad) > len(words):
        words.append("checks FAIL")
    return "; ".join(words) or "checks pass"


def _told(result: BuildResult, report: CheckReport, splats: tuple[Gaussians, ...]) -> ReportData:
    """Return what the report says."""
    scene = result.scene
    return ReportData(
        scene=scene.path.resolve().name, layout=scene.layout, exit_code=report.exit_code,
        twin=result.twin, counts=_counts(result), stage_seconds=result.seconds,
        plan=result.plan.rows(),
        curves=tuple((f"state {index}", fit[1]) for index, fit in enumerate(result.fits)),
        pictures=pictures_of(result), left=result.left,
        unbuilt=tuple(joint_in_scene(j, result.frame) for j in result.motion.unbuilt),
        splats=splats, checks=report.to_dict(), notes=report.notes)


def _counts(result: BuildResult) -> dict[str, float]:
    counts: dict[str, float] = {}
    for index, (state, fit) in enumerate(zip(result.scene.states, result.fits, strict=True)):
        counts |= {f"views_{index}": len(state), f"width_{index}": state.width,
                   f"height_{index}": state.height, f"gaussians_{index}": len(fit[0]),
                   f"held_out_psnr_{index}": round(fit[1][-1][1], 3)}
    return counts


def _write_gaussians(folder: Path, result: BuildResult) -> tuple[Gaussians, ...]:
    """Write the Gaussians of state 0, whole and per part: at q = 0 they lie on the meshes."""
    from part2gs_robotics.exporters.meshfile import write_gaussians_ply

    gaussians = gaussians_in_scene(result.fits[0][0], result.frame)
    labels = result.motion.labels(0)
    shares = tuple(gaussians.select(labels == index) for index in range(len(result.twin.parts)))
    write_gaussians_ply(gaussians, folder / "gaussians.ply")
    for part, share in zip(result.twin.parts, shares, strict=True):
        write_gaussians_ply(share, folder / f"{part.name}.ply")
    return shares


def _summary(out: Path, twin: Twin, report: CheckReport) -> str:
    lines = []
    for part in twin.parts:
        if part.joint is not None:
            joint = part.joint
            unit = "deg" if joint.kind in ("revolute", "screw") else "units"
            value = np.degrees(joint.value) if unit == "deg" else joint.value
            axis = " ".join(f"{x:+.3f}" for x in joint.axis)
            lines.append(f"{part.name}: {joint.kind}, axis {axis}, {value:+.4g} {unit} between the "
                         "states")
    lines += [note for note in twin.notes if note.startswith(ASSUMED)]
    for row in report.results:
        if row.status not in ("pass", "skipped"):
            lines.append(f"{row.status}: {row.name} {row.subject} {row.detail}".rstrip())
    lines.append(f"{verdict(report)}; {out}: scene.xml, twin.xml, "
                 "twin_actuated.xml, twin.urdf, twin.yaml, report.html")
    return "\n".join(lines) + "\n"


def export_twin(folder: Path, kind: str, out: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Write a twin folder's twin in another format; return the files and what was repaired.

    All is written beside the target and moved there when it is whole.

    Args:
        folder: with twin.yaml.
        kind: mjcf, urdf, usd, sdf, glb or ros.
        out: folder of the new files; files of the same name in it are replaced.

    Raises:
        Part2GSError: if the folder is damaged, a part cannot be repaired, or out not be written.
    """
    from part2gs_robotics.exporters.read_twin import read_twin
    from part2gs_robotics.exporters.sound import sound_twin

    if out.resolve() == folder.resolve():
        raise StoreError(f"{out}: is the twin folder itself. Expected another one; choose it "
                         "with -o.")
    read = read_twin(folder)
    twin = sound_twin(read)
    files = replace_files(out, lambda fresh: _writer(kind)(twin, fresh))
    return files, twin.notes[len(read.notes):]


def _writer(kind: str) -> Callable[[Twin, Path], list[Path]]:
    """Return the writer of a format: module and function, imported when it is asked for."""
    module, name = {
        "mjcf": ("mjcf", "write_mjcf"), "urdf": ("urdf", "write_urdf"), "usd": ("usd", "write_usd"),
        "sdf": ("sdf", "write_sdf"), "glb": ("glb", "write_glb"),
        "ros": ("ros_package", "write_ros"),
    }[kind]
    found = getattr(import_module(f"part2gs_robotics.exporters.{module}"), name)
    return cast("Callable[[Twin, Path], list[Path]]", found)
