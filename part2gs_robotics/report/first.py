"""The first screen of the page: the verdict, the twin in 3D with its sliders, photos beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from part2gs_robotics.model.kinematics import moving_parts
from part2gs_robotics.model.twin import Part
from part2gs_robotics.report.data import CheckRow, Picture, ReportData
from part2gs_robotics.report.figures import png_uri
from part2gs_robotics.report.scene_json import MOST_SPLATS
from part2gs_robotics.report.script import json_script
from part2gs_robotics.report.verdict import sentences, unit_of

_SHOWN = {"surface": "photos' colours", "pieces": "collision pieces", "splats": "Gaussians"}
_KEYS = ("Twin in 3D. Arrow keys turn it, plus and minus come nearer and go farther, 0 is the "
         "first view again.")
_FLAT = ("This browser draws no 3D (WebGL is off or missing), so the twin does not move here. "
         "Everything else of the report is below.")


def verdict_html(data: ReportData, rows: Sequence[CheckRow]) -> str:
    """Return the sentences of the verdict."""
    lines = "".join(f"<dt>{escape(head)}</dt><dd>{escape(text)}</dd>"
                    for head, text in sentences(data, rows).items())
    return f'<dl class="verdict">{lines}</dl>'


def viewer_html(data: ReportData) -> str:
    """Return the 3D view with its controls, and one photo of each state."""
    factor, unit = unit_of(data.twin)
    return (
        '<section class="first" aria-label="Twin and photos"><div class="stage">'
        f'<canvas id="view" tabindex="0" role="application" aria-label="{escape(_KEYS)}"></canvas>'
        f'<p class="no3d" role="alert">{escape(_FLAT)}</p>'
        f'<noscript><p>{escape(_FLAT)}</p></noscript>{_camera_buttons()}</div>'
        f'<div class="controls">{_states()}{_sliders(data)}{_choices(data)}</div>'
        f'<div class="beside">{_photos(data.pictures)}</div></section>'
        f'{json_script("units", {"factor": factor, "unit": unit})}')


def photo_button(index: int, picture: Picture) -> str:
    """Return the button that looks at the twin from where a photo was taken."""
    if picture.world_from_camera is None:
        return ""
    return (f'<button type="button" class="needs3d" data-camera="{index}" data-far="1">'
            "look from here in 3D</button>")


def _states() -> str:
    return ('<div class="row needs3d" role="group" aria-label="Observed states">'
            '<button type="button" id="state-0">state 0</button>'
            '<button type="button" id="state-1">state 1</button>'
            '<button type="button" id="play" aria-pressed="false">play</button></div>')


def _sliders(data: ReportData) -> str:
    curves = {str(curve["joint"]): curve for curve in _listed(data.checks, "curves")}
    limits = [row["limit"] for row in _listed(data.checks, "checks")
              if row.get("check") == "overlap" and isinstance(row.get("limit"), float)]
    out = ""
    for i in moving_parts(data.twin):
        part = data.twin.parts[i]
        curve = curves.get(f"{part.name}_joint")
        out += _slider(i, part, _strip(part.limits, curve, limits[0] if limits else 0.0))
    return out


def _listed(checks: Mapping[str, object], key: str) -> list[Mapping[str, Any]]:
    found = checks.get(key)
    return [row for row in found if isinstance(row, Mapping)] if isinstance(found, list) else []


def _strip(limits: tuple[float, float], curve: Mapping[str, Any] | None, most: float) -> str:
    """Return where along a joint the exact meshes overlap, and where by more than a check allows.

    Args:
        limits: of the joint.
        curve: positions and overlap depths that the checks measured; None = not measured.
        most: depth that the check allows.
    """
    if curve is None or limits[1] <= limits[0]:
        return ""
    places, depths = curve["positions"], curve["overlap_depth"]
    wide = 100.0 / max(len(places), 1)
    spans = "".join(
        f'<i class="{"bad" if depth > most else "some"}" style="width:{wide:.2f}%;'
        f'left:{100 * (q - limits[0]) / (limits[1] - limits[0]) - wide / 2:.2f}%"></i>'
        for q, depth in zip(places, depths, strict=True) if depth > 0)
    some, bad = sum(d > 0 for d in depths), sum(d > most for d in depths)
    told = (f"of {len(places)} positions checked, the exact meshes overlap at {some}, by more than "
            f"the check allows at {bad}")
    return f'<div class="strip" role="img" aria-label="{told}" title="{told}">{spans}</div>'


def _slider(index: int, part: Part, strip: str) -> str:
    """Return one joint's slider, with marks where the states are."""
    joint = part.joint
    assert joint is not None  # a moving part has one
    low, high = part.limits
    ways = {"prismatic": "slides", "revolute": "turns", "screw": "screws"}
    marks = "".join(f'<i style="left:{100 * (q - low) / (high - low):.2f}%">{state}</i>'
                    for state, q in enumerate((0.0, joint.value)) if high > low)
    return (
        f'<div class="joint needs3d" title="{escape(part.limits_source)} range">'
        f'<label for="joint-{index}"><b>{escape(part.name)}</b> '
        f'{ways[joint.kind]}</label><output id="value-{index}" for="joint-{index}"></output>'
        f'<input type="range" id="joint-{index}" min="0" max="1000" value="0" step="1">'
        f'{strip}<div class="marks" aria-hidden="true">{marks}</div></div>')


def _choices(data: ReportData) -> str:
    """Return what can be shown; Gaussians only where there are some, and how many of them."""
    choices = "".join(
        f'<label><input type="radio" name="shown" value="{key}"{" checked" * (key == "surface")}>'
        f" {escape(name)}</label>" for key, name in _SHOWN.items()
        if key != "splats" or data.splats)
    note = ""
    if data.splats:
        note = ('<p class="muted small">Gaussians: the solid ones of state 0, at most '
                f"{MOST_SPLATS:,}, as round discs.</p>")
    return (f'<fieldset class="needs3d"><legend>show</legend>{choices}<label>'
            f'<input type="checkbox" id="axes"> joint axes</label>{note}</fieldset>')


def _camera_buttons() -> str:
    return ('<div class="corner needs3d"><button type="button" id="nearer" aria-label="nearer">+'
            '</button><button type="button" id="farther" aria-label="farther">−</button>'
            '<button type="button" id="home" aria-label="first view">⌂</button></div>')


def _photos(pictures: Sequence[Picture]) -> str:
    """Return the first photo of each state."""
    out = ""
    for state in (0, 1):
        found = next(((i, p) for i, p in enumerate(pictures) if p.state == state), None)
        if found:
            index, picture = found
            out += (f'<figure><img alt="photo of state {state}" src="{png_uri(picture.photo)}">'
                    f"<figcaption>photo, state {state} {photo_button(index, picture)}"
                    "</figcaption></figure>")
    return out
