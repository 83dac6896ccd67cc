"""What a report says, and how checks and provenance are read out of nested results."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import LeftOver
from part2gs_robotics.model.twin import Twin

STATUSES = ("pass", "warn", "fail", "skipped", "incomplete")


@dataclass(frozen=True)
class Picture:
    """A photo over white, and what the fits show from its camera.

    Attributes:
        caption: which photo it is.  state: 0 or 1.
        photo: [H, W, 3 or 4] uint8.
        render: [H, W, 3 or 4] uint8 its own state's Gaussians, of a photo that no fit has seen;
            None = a photo to look at.
        mesh: [H, W, 3] uint8 the twin's textured meshes there, of the same photos.
        moved: [H, W, 4] uint8 the other state's Gaussians, moved by the joints, over white, and
            what they cover.
        mask: [H, W] bool where the photo shows the object.
        world_from_camera: [4, 4] where it was taken, scene's frame, OpenCV axes; None = unknown.
        fov: vertical field of view, rad.
        left: [H, W] bool where it shows what no part explains; None = it was not asked.
    """

    caption: str
    state: int
    photo: NDArray[np.uint8]
    render: NDArray[np.uint8] | None = None
    mesh: NDArray[np.uint8] | None = None
    moved: NDArray[np.uint8] | None = None
    mask: NDArray[np.bool_] | None = None
    world_from_camera: F64 | None = None
    fov: float = 0.0
    left: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class ReportData:
    """All that a report says.

    Attributes:
        scene: name of the scene.  layout: layout it was read in.  exit_code: of the whole build.
        twin: the result.
        counts: what the scene holds (views per state, width, height, Gaussians, ...).
        stage_seconds: stage name -> wall seconds, in order.
        plan: (stage or term, used, reason) in order.
        curves: (label, ((seconds, held-out PSNR in dB), ...)).
        pictures: of each state first the photo that shows best what moves, then held-out ones.
        splats: Gaussians of state 0 of every part, scene's frame; empty = none to show.
        checks: result of the simulator checks as JSON-like values; every mapping in it that has a
            `status` (pass | warn | fail | skipped | incomplete) is one check, with optional
            `value`, `limit`, `unit` and `note`.
        assumed: numbers that nobody measured, one sentence each, beside those marked `assumed`
            in the folder's twin.yaml.
        notes: fallbacks and what was left out, one sentence each.
        left: what of the moved surface no part explains; None = nobody measured.
        unbuilt: joints of parts that were decided on but not built, scene's frame.
    """

    scene: str
    layout: str
    exit_code: int
    twin: Twin
    counts: Mapping[str, float] = field(default_factory=dict)
    stage_seconds: Mapping[str, float] = field(default_factory=dict)
    plan: tuple[tuple[str, bool, str], ...] = ()
    curves: tuple[tuple[str, tuple[tuple[float, float], ...]], ...] = ()
    pictures: tuple[Picture, ...] = ()
    splats: tuple[Gaussians, ...] = ()
    checks: Mapping[str, object] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    left: LeftOver | None = None
    unbuilt: tuple[Joint, ...] = ()


@dataclass(frozen=True)
class CheckRow:
    """One check: `name`, `status`, measured `value` against `limit`, `note`, what mends it."""

    name: str
    status: str
    value: str = ""
    limit: str = ""
    note: str = ""
    cause: str = ""


def check_rows(checks: Mapping[str, object]) -> tuple[CheckRow, ...]:
    """Return every mapping with a `status` inside `checks`, by its own `name` or its path."""
    return tuple(_walk_checks(checks, ()))


def check_notes(checks: Mapping[str, object]) -> tuple[str, ...]:
    """Return what the checks substituted, decimated or left out."""
    notes = checks.get("notes")
    return tuple(str(note) for note in notes) if isinstance(notes, list | tuple) else ()


def assumed_numbers(description: object) -> tuple[str, ...]:
    """Return one line for each `{value, source: assumed}` in the content of a twin.yaml."""
    return tuple(
        f"{path}: {_short(entry['value'])}" + (f" ({entry['note']})" if entry.get("note") else "")
        for path, entry in _walk_values(description, ())
        if entry.get("source") == "assumed"
    )


def _walk_checks(value: object, path: tuple[str, ...]) -> Iterator[CheckRow]:
    if isinstance(value, Mapping):
        if value.get("status") in STATUSES:
            yield _check_row(value, path)
        for key, inner in value.items():
            yield from _walk_checks(inner, (*path, str(key)))
    elif isinstance(value, list | tuple):
        for i, inner in enumerate(value):
            own = inner.get("name") if isinstance(inner, Mapping) else None
            yield from _walk_checks(inner, (*path, str(own or i)))


def _check_row(entry: Mapping[str, object], path: tuple[str, ...]) -> CheckRow:
    unit = str(entry.get("unit") or "")
    return CheckRow(
        name=str(entry.get("name") or " · ".join(path) or "verdict"),
        status=str(entry["status"]),
        value=_quantity(entry.get("value"), unit),
        limit=_quantity(entry.get("limit"), unit),
        note=str(entry.get("note") or entry.get("message") or ""),
        cause=str(entry.get("cause") or ""),
    )


def _short(value: object) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(_short(v) for v in value) + "]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _quantity(value: object, unit: str) -> str:
    if value is None or isinstance(value, Mapping | list | tuple):
        return ""
    return f"{value:.4g} {unit}".strip() if isinstance(value, float) else f"{value} {unit}".strip()


def _walk_values(
    value: object, path: tuple[str, ...]
) -> Iterator[tuple[str, Mapping[str, object]]]:
    if isinstance(value, Mapping):
        if "value" in value and "source" in value:
            yield ".".join(path), value
            return
        for key, inner in value.items():
            yield from _walk_values(inner, (*path, str(key)))
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            own = inner.get("name") if isinstance(inner, Mapping) else None
            yield from _walk_values(inner, (*path, str(own or i)))
