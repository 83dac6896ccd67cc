"""Report of one build: report.json for programs and one self-contained report.html for people."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import yaml

from part2gs_robotics import __version__
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.twin import Part
from part2gs_robotics.report.data import ReportData, assumed_numbers, check_rows
from part2gs_robotics.report.html import render_html
from part2gs_robotics.report.verdict import sentences
from part2gs_robotics.runtime.hashing import engine_versions
from part2gs_robotics.runtime.store import write_text_atomic

__all__ = ["ReportData", "engine_versions", "report_json", "write_report"]


def write_report(folder: Path, data: ReportData) -> None:
    """Write report.json and report.html into an output folder, each atomically.

    Raises:
        StoreError: the folder cannot be written.
    """
    assumed = (*data.assumed, *assumed_numbers(_twin_yaml(folder)))
    content = json.dumps(report_json(data, assumed), indent=1, allow_nan=False)
    write_text_atomic(folder / "report.json", content + "\n")
    write_text_atomic(folder / "report.html", render_html(data, assumed, engine_versions()))


def report_json(data: ReportData, assumed: tuple[str, ...]) -> dict[str, object]:
    """Return the content of report.json; numbers that are not finite become null."""
    movers = [p for p in data.twin.parts if p.joint is not None]
    return {
        "version": __version__,
        "engines": engine_versions(),
        "verdict": sentences(data, check_rows(data.checks)),
        "unexplained": _left(data),
        "scene": {"name": data.scene, "layout": data.layout, **_plain_mapping(data.counts)},
        "stage_seconds": _plain(data.stage_seconds),
        "plan": [{"item": n, "used": used, "reason": why} for n, used, why in data.plan],
        "parts": [_part_entry(p) for p in data.twin.parts],
        "joints": [_joint_entry(p) for p in movers],
        "unbuilt": [_numbers(joint) for joint in data.unbuilt],
        "curves": [
            {"label": label, "seconds": [s for s, _ in points], "psnr_db": [d for _, d in points]}
            for label, points in _plain_curves(data)
        ],
        "checks": _plain(data.checks),
        "assumed": list(assumed),
        "notes": list(dict.fromkeys((*data.twin.notes, *data.notes))),
        "exit_code": data.exit_code,
    }


def _left(data: ReportData) -> dict[str, object] | None:
    if data.left is None:
        return None
    return {"share": _plain(data.left.share), "bound": _plain(data.left.bound),
            "complete": data.left.complete}


def _twin_yaml(folder: Path) -> object:
    path = folder / "twin.yaml"
    return yaml.safe_load(path.read_text()) if path.exists() else None


def _part_entry(part: Part) -> dict[str, object]:
    return {
        "name": part.name,
        "parent": part.parent,
        "triangles": len(part.mesh.faces),
        "pieces": len(part.pieces),
        "gaussians": part.num_gaussians,
        "synthesised_share": _plain(part.mesh.synthesised),
        "diagnostics": _plain(part.diagnostics),
    }


def _joint_entry(part: Part) -> dict[str, object]:
    joint = part.joint
    assert joint is not None  # callers pass moving parts only
    return {"part": part.name, **_numbers(joint), "range": _plain(part.limits),
            "range_source": part.limits_source}


def _numbers(joint: Joint) -> dict[str, object]:
    names = {"type": "kind", "axis": "axis", "origin": "origin", "pitch": "pitch",
             "value_state_1": "value", "sigma_axis_rad": "sigma_axis",
             "sigma_origin": "sigma_origin", "sigma_value": "sigma_value",
             "sigma_rise": "sigma_rise", "confidence": "confidence", "bic": "bic"}
    return {key: _plain(getattr(joint, name)) for key, name in names.items()}


def _plain(value: object) -> object:
    """Return JSON values only; NaN and infinities become None."""
    if isinstance(value, Mapping):
        return _plain_mapping(value)
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _plain_mapping(value: Mapping[str, object] | Mapping[str, float]) -> dict[str, object]:
    return {str(k): _plain(v) for k, v in value.items()}


def _plain_curves(data: ReportData) -> Iterator[tuple[str, list[tuple[object, object]]]]:
    for label, points in data.curves:
        yield label, [(_plain(float(s)), _plain(float(d))) for s, d in points]
