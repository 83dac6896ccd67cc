"""The verdict of a build in four sentences: what was found, how sure, what is wrong, what to do."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from part2gs_robotics.model.kinematics import moving_parts
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.report.data import CheckRow, ReportData

NAMED = 4  # moving parts told one by one: a sentence a reader takes in at one look
MOST = 14.0  # prices: beyond, odds are a million to one and say no more to anybody
NOUNS = {"revolute": "hinge", "prismatic": "slide", "screw": "screw"}


def sentences(data: ReportData, rows: Sequence[CheckRow]) -> dict[str, str]:
    """Return heading -> sentence, plain text, in the order to read them."""
    left = "" if data.left is None or data.left.complete else f"{incomplete(data.left.share)}. "
    return {"Found": left[:1].upper() + left[1:] + found(data.twin), "How sure": sure(data),
            "What is wrong": wrong(data, rows), "What to do": to_do(data, rows)}


def unit_of(twin: Twin) -> tuple[float, str]:
    """Return (factor, name) of the lengths people read: centimetres where the scale is known."""
    return (1.0, "units") if twin.meters_per_unit is None else (100.0 * twin.meters_per_unit, "cm")


def incomplete(share: float) -> str:
    """Return the verdict on a twin that does not explain a share of what moved."""
    return f"incomplete: {100 * share:.0f} % of what moved is not explained"


def found(twin: Twin) -> str:
    """Return what moves, and how."""
    movers = [twin.parts[i] for i in moving_parts(twin)]
    if not movers:
        return "Nothing that moves was found."
    if len(movers) > NAMED:
        return f"{len(movers)} moving parts: {_kinds(movers)}."
    ways = ", ".join(_way(part, twin) for part in movers)
    return f"{len(movers)} moving part{'s' * (len(movers) > 1)}: {ways}."


def sure(data: ReportData) -> str:
    """Return how well the joints are known, by the least sure of each kind."""
    twin = data.twin
    joints = [(twin.parts[i].name, joint) for i in moving_parts(twin)
              if (joint := twin.parts[i].joint) is not None]
    factor, unit = unit_of(twin)
    turns = [joint.sigma_value for _, joint in joints if joint.turns]
    slides = [joint.sigma_value for _, joint in joints if not joint.turns]
    said = [_spread("axes", [joint.sigma_axis for _, joint in joints], 180 / math.pi, "°"),
            _spread("turns", turns, 180 / math.pi, "°"),
            _spread("slides", slides, factor, f" {unit}")]
    known = ", ".join(filter(None, said))
    lost = [name for name, joint in joints
            if not math.isfinite(joint.sigma_axis) or not math.isfinite(joint.sigma_value)]
    out = f"One standard deviation, of the least sure joint: {known}. " if known else ""
    if lost:
        out += f"The photos do not say how sure {', '.join(lost)} {'are' if lost[1:] else 'is'}. "
    out += _number(twin)
    worst = [points[-1][1] for _, points in data.curves if points]
    if worst and math.isfinite(min(worst)):
        out += f"Photos that no fit saw are drawn to {min(worst):.1f} dB or better."
    return out.strip() or "Nothing was measured."


def _number(twin: Twin) -> str:
    """Return how sure the number of parts is: the odds of the set against that without one."""
    gaps = {part.name: gap for i in moving_parts(twin) if math.isfinite(
        gap := (part := twin.parts[i]).diagnostics.get("prices_saved", math.nan))}
    if not gaps:
        return ""
    name = min(gaps, key=lambda key: gaps[key])
    odds = math.exp(min(gaps[name], MOST))
    return (f"Without {name}, the least sure part, photos and surfaces would cost {gaps[name]:.1f} "
            f"prices of a part more: odds of {odds:.2g} to 1, if a price is a factor e. ")


def wrong(data: ReportData, rows: Sequence[CheckRow]) -> str:
    """Return which checks do not pass, and what is made up or assumed."""
    bad = [row for row in rows if row.status in ("fail", "incomplete")]
    if bad:
        names = ", ".join(row.name for row in bad[:3]) + (", …" if bad[3:] else "")
        out = f"{len(bad)} of {len(rows)} checks do not pass: {names}."
    else:
        out = f"All {len(rows)} checks pass." if rows else "No check was made."
    unseen = max(data.twin.parts, key=lambda part: part.mesh.synthesised)
    if unseen.mesh.synthesised > 0.005:  # what rounds to a percent or more
        out += (f" No photo shows {100 * unseen.mesh.synthesised:.0f} % of the surface of "
                f"{unseen.name}: it is made up.")
    if data.twin.meters_per_unit is None:
        out += " Nobody said how large it is: masses are assumed."
    return out


def to_do(data: ReportData, rows: Sequence[CheckRow]) -> str:
    """Return the next step."""
    bad = [row for row in rows if row.status in ("fail", "incomplete")]
    if bad:
        cause = next((row.cause for row in bad if row.cause), "")
        return (f"{cause[:1].upper()}{cause[1:].rstrip('.')}. " if cause else "") + (
            "Every check that does not pass is listed below with what it measured.")
    if data.twin.meters_per_unit is None:
        return ("Build again with --known-length (metres of the longest side) or --scale; then "
                "open scene.xml in MuJoCo.")
    return ("Open scene.xml in MuJoCo, load twin.urdf, or move it by hand with "
            "`part2gs-robot view`.")


def _kinds(movers: Sequence[Part]) -> str:
    counts = Counter(part.joint.kind for part in movers if part.joint is not None)
    words = [f"{n} {NOUNS[kind]}{'s' * (n > 1)}" for kind, n in counts.items()]
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def _way(part: Part, twin: Twin) -> str:
    joint = part.joint
    assert joint is not None  # a moving part has one
    factor, unit = unit_of(twin)
    length = f"{abs(joint.value if not joint.turns else joint.rise) * factor:.3g} {unit}"
    turn = f"turns by {abs(math.degrees(joint.value)):.1f}°"
    way = {"prismatic": f"slides by {length}", "screw": f"{turn} and rises by {length}"}
    carried = f" on {twin.parts[part.parent].name}" if part.parent > 0 else ""
    return f"{part.name} {way.get(joint.kind, turn)}{carried}"


def _spread(noun: str, sigmas: Sequence[float], factor: float, unit: str) -> str:
    known = [sigma for sigma in sigmas if math.isfinite(sigma)]
    return f"{noun} ± {max(known) * factor:.2g}{unit}" if known else ""
