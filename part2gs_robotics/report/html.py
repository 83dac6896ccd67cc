"""The HTML page of a report: one file, its script inlined, nothing loaded from outside."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics import __version__
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.twin import Part
from part2gs_robotics.report.data import CheckRow, Picture, ReportData, check_notes, check_rows
from part2gs_robotics.report.figures import bars_html, curve_svg, png_uri
from part2gs_robotics.report.first import photo_button, verdict_html, viewer_html
from part2gs_robotics.report.scene_json import scene_json
from part2gs_robotics.report.script import json_script, page_script, policy
from part2gs_robotics.report.style import STYLE
from part2gs_robotics.report.unexplained import marked, unexplained
from part2gs_robotics.report.verdict import incomplete

_VERDICTS = {0: ("pass", "built, checks pass"), 1: ("fail", "built, checks fail")}  # by exit code
_CHOICE = (
    '<fieldset><legend>render of</legend><label><input type="radio" name="wiped" value="splats" '
    'checked> Gaussians</label><label><input type="radio" name="wiped" value="mesh"> textured '
    "meshes</label></fieldset>")
_TALL = 14  # rows above which a list starts folded


def render_html(data: ReportData, assumed: Sequence[str], engines: Mapping[str, str]) -> str:
    """Return the whole page; every text of the input is escaped."""
    rows = check_rows(data.checks)
    sections = (
        _section("Photo against render", _pictures(data)),
        _section("What the joints do not explain", _unexplained(data)),
        _section("Joints", _joints(data)),
        _section("Checks in MuJoCo and on the exact meshes", _checks(rows)),
        _section("Overlap along every joint", _sweeps(data.checks.get("curves"))),
        _section("Optimiser's losses beside what was measured", _losses(data.checks.get("losses"))),
        _section("Parts", _parts(data)),
        _section("Error against time", _curve(data)),
        _section("Where the time went", bars_html(data.stage_seconds)),
        _section("Plan: what was used and what was left out", _plan(data)),
        _section("Assumed numbers", _bullets(assumed)),
        _section("Notes", _bullets(_all_notes(data))),
        _section("Made with", _pairs({"part2gs-robotics": __version__, **engines})),
    )
    title, code = escape(data.scene), page_script()
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy(code)}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}: twin report</title><style>{STYLE}</style></head><body><main>"
        f"{_header(data, rows)}{viewer_html(data)}{_tiles(data, rows)}{''.join(sections)}</main>"
        f"{json_script('twin', scene_json(data))}<script>{code}</script></body></html>\n"
    )


def _header(data: ReportData, rows: Sequence[CheckRow]) -> str:
    status, verdict = _VERDICTS.get(data.exit_code, ("fail", f"exit code {data.exit_code}"))
    if data.left is not None and not data.left.complete:
        status, verdict = "fail", incomplete(data.left.share)
    return (
        f'<header><h1>{escape(data.scene)}</h1>{_pill(status, verdict)}'
        f"{verdict_html(data, rows)}{_left(data)}</header>"
    )


def _left(data: ReportData) -> str:
    """Return the photos that show most of what no part explains, marked; "" where all is."""
    body = "".join(
        f'<figure><img class="marked" alt="not explained" src="{png_uri(marked(p.photo, p.left))}">'
        f"<figcaption>{escape(p.caption)} {photo_button(i, p)}</figcaption></figure>"
        for i, p in enumerate(data.pictures) if p.left is not None)
    hint = ('<p class="muted">What moved and no part explains: <b class="differs">magenta</b>, in '
            "the photo of each state that shows most of it.</p>")
    return f'{hint}<div class="pictures">{body}</div>' if body else ""


def _tiles(data: ReportData, rows: Sequence[CheckRow]) -> str:
    moving = sum(p.joint is not None for p in data.twin.parts)
    passed = sum(r.status == "pass" for r in rows)
    tiles = {
        "moving parts": str(moving),
        "checks passed": f"{passed} of {len(rows)}" if rows else "none run",
        "build time": _duration(sum(data.stage_seconds.values())),
        **{str(k).replace("_", " "): f"{v:,.6g}" for k, v in data.counts.items()},
    }
    cells = "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
        for name, value in tiles.items()
    )
    return (
        f'<div class="tiles">{cells}</div>'
        f'<p class="muted">Two observed states, read in the {escape(data.layout)} layout.</p>'
    )


def _all_notes(data: ReportData) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*data.twin.notes, *data.notes, *check_notes(data.checks))))


def _section(title: str, body: str) -> str:
    return f"<section><h2>{escape(title)}</h2>{body}</section>" if body else ""


def _pictures(data: ReportData) -> str:
    body = "".join(_wipe(i, picture, picture.render) for i, picture in enumerate(data.pictures)
                   if picture.render is not None)
    hint = ('<p class="muted">Photos that no fit has seen, beside what the fitted Gaussians, or '
            "the twin's textured meshes, show there: photo left of the line, render right.</p>")
    if any(picture.mesh is not None for picture in data.pictures):
        hint += _CHOICE
    return f'{hint}<div class="pictures">{body}</div>' if body else ""


def _wipe(index: int, picture: Picture, render: NDArray[np.uint8]) -> str:
    """Return a photo under its render, the render cut off at the slider that lies over both."""
    caption = escape(picture.caption)
    return (
        f'<figure><div class="wipe"><img alt="photo" src="{png_uri(picture.photo)}">'
        f'<img alt="render" class="over splats" src="{png_uri(render)}">{_mesh(picture)}'
        '<input type="range" min="0" max="100" value="50" '
        f'aria-label="share of the photo shown, {caption}"></div>'
        f"<figcaption>{caption} {photo_button(index, picture)}</figcaption></figure>"
    )


def _mesh(picture: Picture) -> str:
    if picture.mesh is None:
        return ""
    return f'<img alt="render of the meshes" class="over mesh" src="{png_uri(picture.mesh)}">'


def _unexplained(data: ReportData) -> str:
    body = ""
    for index, picture in enumerate(data.pictures):
        if (found := unexplained(picture)) is not None:
            told = (f"{100 * found.differs:.1f} % differs, {100 * found.hidden:.1f} % was hidden "
                    f"in state {1 - picture.state}")
            body += (f'<figure><img class="marked" alt="{told}" src="{png_uri(found.image)}">'
                     f"<figcaption>{escape(picture.caption)}: {told} "
                     f"{photo_button(index, picture)}</figcaption></figure>")
    hint = ('<p class="muted">Held-out photos, and what the other state\'s Gaussians show there '
            'once the joints have moved them: <b class="differs">magenta</b> where they differ by '
            'more than a tenth or show what is not there, <b class="hidden-then">blue</b> where '
            "the other state saw nothing, such as the inside of a drawer.</p>")
    return f'{hint}<div class="pictures">{body}</div>' if body else ""


def _joints(data: ReportData) -> str:
    head = ("part", "type", "axis", "origin", "state 0 → 1", "range", "confidence")
    return _table(head, [_joint_row(p) for p in data.twin.parts if p.joint is not None])


def _joint_row(part: Part) -> list[str]:
    joint = part.joint
    assert joint is not None  # filtered above
    turning = joint.kind in ("revolute", "screw")
    factor, unit = (180 / math.pi, "°") if turning else (1.0, " units")
    low, high = (limit * factor for limit in part.limits)
    axis = ", ".join(f"{v:.4f}" for v in joint.axis)
    origin = ", ".join(f"{v:.4g}" for v in joint.origin) if turning else "—"
    return [
        escape(part.name),
        escape(joint.kind),
        f"{axis}{_sigma(joint.sigma_axis * 180 / math.pi, '°')}",
        origin + (_sigma(joint.sigma_origin, " units") if turning else ""),
        f"{joint.value * factor:.4g}{unit}{_sigma(joint.sigma_value * factor, unit)}{_rise(joint)}",
        f"{low:.4g} … {high:.4g}{unit} ({escape(part.limits_source)})",
        "—" if math.isnan(joint.confidence) else f"{joint.confidence:.2f}",
    ]


def _rise(joint: Joint) -> str:
    if joint.kind != "screw":
        return ""
    rise = joint.pitch * joint.value
    return f", rising {rise:.4g} units{_sigma(joint.sigma_rise, ' units')}"


def _sigma(value: float, unit: str) -> str:
    return f' <span class="muted">± {value:.2g}{unit}</span>' if math.isfinite(value) else ""


def _checks(rows: Sequence[CheckRow]) -> str:
    """Return what did not pass in sight, and what passed below, folded when it is long."""
    passed = [row for row in rows if row.status == "pass"]
    table = _check_table([row for row in rows if row.status != "pass"])
    if len(passed) <= _TALL:
        return table + _check_table(passed)
    title = f"<summary>{len(passed)} checks passed</summary>"
    return f"{table}<details>{title}{_check_table(passed)}</details>"


def _check_table(rows: Sequence[CheckRow]) -> str:
    head = ("check", "status", "measured", "limit", "note")
    body = [
        [escape(r.name), _pill(r.status, r.status), *map(escape, (r.value, r.limit, r.note))]
        for r in rows
    ]
    return _table(head, body)


def _sweeps(curves: object) -> str:
    """Return one chart per joint: exact depth beside what the engine's convex pieces report."""
    charts = []
    for curve in curves if isinstance(curves, list) else []:
        q = curve["positions"]
        lines = [
            ("exact meshes", list(zip(q, curve["overlap_depth"], strict=True))),
            ("engine contacts", list(zip(q, curve["contact_depth"], strict=True))),
        ]
        if max(curve["overlap_depth"] + curve["contact_depth"], default=0.0) == 0:
            charts.append(f"<p>{escape(curve['joint'])}: no overlap and no contact anywhere.</p>")
            continue
        label = f"position of {curve['joint']}, rad or scene units"
        charts.append(curve_svg(lines, label, "overlap depth, units"))
    return "".join(charts)


def _losses(rows: object) -> str:
    found = [row for row in rows if isinstance(row, Mapping)] if isinstance(rows, list) else []
    names = list(dict.fromkeys(key for row in found for key in row))
    body = [[escape(_cell(row.get(name))) for name in names] for row in found]
    return _table([escape(name.replace("_", " ")) for name in names], body)


def _cell(value: object) -> str:
    return "—" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)


def _parts(data: ReportData) -> str:
    names = sorted({key for p in data.twin.parts for key in p.diagnostics})
    head = ("part", "carried by", "triangles", "convex pieces", "Gaussians", "unseen surface")
    body = [
        [
            escape(p.name),
            escape(data.twin.parts[p.parent].name) if p.parent >= 0 else "world",
            f"{len(p.mesh.faces):,}",
            str(len(p.pieces)),
            f"{p.num_gaussians:,}",
            f"{100 * p.mesh.synthesised:.0f} %",
            *(f"{p.diagnostics[n]:.3g}" if n in p.diagnostics else "—" for n in names),
        ]
        for p in data.twin.parts
    ]
    return _table((*head, *(escape(n.replace("_", " ")) for n in names)), body)


def _curve(data: ReportData) -> str:
    chart = curve_svg(data.curves, "seconds since the start", "held-out PSNR, dB")
    hint = '<p class="muted">PSNR of photos that no fit has seen; higher is better.</p>'
    return hint + chart if chart else ""


def _plan(data: ReportData) -> str:
    body = [
        [
            escape(name),
            _pill("pass", "used") if used else _pill("skipped", "left out"),
            escape(reason),
        ]
        for name, used, reason in data.plan
    ]
    return _table(("stage or term", "", "reason"), body)


def _table(head: Iterable[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table of cells that are already HTML."""
    if not rows:
        return ""
    top = "".join(f'<th scope="col">{cell}</th>' for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    return f'<div class="scroll" tabindex="0"><table><tr>{top}</tr>{body}</table></div>'


def _pill(kind: str, text: str) -> str:
    return f'<span class="pill {kind}">{escape(text)}</span>'


def _bullets(lines: Sequence[str]) -> str:
    if not lines:
        return ""
    items = "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"
    if len(lines) <= _TALL:
        return items
    return f"<details><summary>{len(lines)} entries</summary>{items}</details>"


def _pairs(values: Mapping[str, str]) -> str:
    text = " · ".join(f"{escape(k)} {escape(v)}" for k, v in values.items())
    return f'<p class="muted">{text}</p>'


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min" if minutes else f"{rest} s"
