"""Checks that need no time: meshes, masses, limits, observed states."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.exporters.twin_yaml import TwinSummary
from part2gs_robotics.model.solids import defect
from part2gs_robotics.sim_checks.geometry import body_solid, collision_pieces
from part2gs_robotics.sim_checks.interpenetration import LIMIT, Poser, deepest_of
from part2gs_robotics.sim_checks.result import CheckResult, Status, passed, row
from part2gs_robotics.sim_checks.subject import Subject

COVERED = 0.5  # of a part: gaps to neighbours take a tenth of boards; half collides like none
LIKE = 0.5  # intersection over union; parts of thirty finished twins reach 0.62 at least
BEYOND = 0.06  # of the size that pieces may stick out; those of thirty finished twins 0.042
TRIANGLE = 1e-6  # relative slack of A + B >= C: the engine's own rounding
STATES = ("state_0", "state_1")


def check_meshes(subject: Subject) -> list[CheckResult]:
    """Return one row per body: are its true surfaces closed solids; of others' a warning."""
    rows = []
    for body, meshes in subject.meshes.items():
        reasons = [reason for mesh in meshes if (reason := defect(mesh)) is not None]
        faces = sum(len(m.faces) for m in meshes)
        detail = reasons[0] if reasons else f"closed, {faces} faces"
        rows.append(CheckResult("mesh", subject.body(body), _judged(subject, not reasons),
                                detail=detail))
    return rows


def _judged(subject: Subject, good: bool) -> Status:
    """Return fail for a defect of our own twin, warn for what others may mean to do."""
    return "pass" if good else "fail" if subject.ours else "warn"


def check_inertia(subject: Subject) -> list[CheckResult]:
    """Return one row per moving body: positive mass and A + B >= C."""
    model, rows = subject.model, []
    jointed = {int(model.jnt_bodyid[j.index]) for j in subject.joints}
    for body in sorted({b for joint in subject.joints for b in joint.moved}):
        # a frame that only carries others may be massless, what a joint moves may not
        carrier = body not in jointed or model.body_subtreemass[body] > 0
        if model.body_mass[body] == 0 and carrier:
            continue
        low, middle, high = np.sort(model.body_inertia[body])
        mass = float(model.body_mass[body])
        gap = float((low + middle - high) / high) if high > 0 else -1.0
        good = mass > 0 and low > 0 and gap >= -TRIANGLE
        detail = f"mass {mass:.4g} kg, principal moments {low:.3g} {middle:.3g} {high:.3g}"
        status = passed(good)
        rows.append(
            CheckResult("inertia", subject.body(body), status, gap, 0.0, "(A+B-C)/C >=", detail)
        )
    return rows


def check_limits(subject: Subject) -> list[CheckResult]:
    """Return one row per joint: a range that is one and holds the observed states."""
    rows = []
    for joint in subject.joints:
        seen = {k: float(v[joint.qpos]) for k, v in subject.states.items() if k in STATES}
        slack = 1e-6 * max(joint.span, 1e-12)
        outside = [
            f"{k} = {q:.4g}"
            for k, q in seen.items()
            if not joint.low - slack <= q <= joint.high + slack
        ]
        declared = bool(subject.model.jnt_limited[joint.index])
        detail = f"{joint.low:.4g} .. {joint.high:.4g} {joint.unit}"
        detail += "" if declared else " (none declared)"
        detail += f"; outside: {', '.join(outside)}" if outside else ""
        bad = bool(outside) or not joint.span > 0
        rows.append(CheckResult("limits", joint.name, passed(not bad), detail=detail))
    return rows


def check_states(subject: Subject, required: bool) -> list[CheckResult]:
    """Return one row per observed state: its keyframe exists and nothing overlaps there."""
    rows, poser = [], Poser(subject)
    for name in STATES:
        if name not in subject.states:
            status: Status = "fail" if required and subject.joints else "skipped"
            rows.append(CheckResult("observed state", name, status, detail="no such keyframe"))
            continue
        poser.pose(subject.states[name])
        found = poser.overlaps(poser.pairs)
        worst = deepest_of(found)
        detail = "no overlap"
        if found:
            pair = " and ".join(subject.body(b) for b in worst.pair)
            detail = f"{pair} overlap by {worst.volume:.3g} units^3"
        limit = LIMIT * subject.size
        rows.append(row("observed state", name, worst.depth, limit, "units", detail))
    return rows


def pieces_table(subject: Subject) -> list[dict[str, object]]:
    """Return how far the collision hulls of every body are from its true surface.

    Phantom is hull volume outside the part, missing is part outside the hulls, in units^3.
    """
    from part2gs_robotics.model.solids import bound_of

    table: list[dict[str, object]] = []
    for body, meshes in subject.meshes.items():
        pieces = collision_pieces(subject.model, body)
        solid = subject.solids.get(body) if subject.ours else body_solid(meshes)
        if solid is None or not pieces:
            continue
        found = bound_of(solid, tuple(pieces))
        table.append(
            {
                "part": subject.body(body),
                "pieces": len(pieces),
                "phantom_volume": found.phantom,
                "phantom_depth": found.phantom_depth,
                "missing_volume": found.missing,
                "covered_share": 1.0 - found.missing / max(found.volume, 1e-300),
                "beyond_surface": found.beyond,
                "short_of_surface": found.short,
                "intersection_over_union": found.overlap,
            }
        )
    return table


def check_pieces(subject: Subject, table: list[dict[str, object]]) -> list[CheckResult]:
    """Return one row per part: do its collision pieces stand for it.

    Args:
        subject: the model under test.
        table: of `pieces_table`.
    """
    rows, size = [], subject.size
    for entry in table:
        covered, like = _number(entry, "covered_share"), _number(entry, "intersection_over_union")
        far, beyond = (_number(entry, key) for key in ("short_of_surface", "beyond_surface"))
        detail = (f"{entry['pieces']} pieces cover {100 * covered:.0f} % of the part, which sticks "
                  f"out by at most {100 * far / size:.2g} % of the size")
        detail += f", they by {100 * beyond / size:.2g} %; intersection over union {like:.2f}"
        good = covered >= COVERED and like >= LIKE and beyond <= BEYOND * size
        status = _judged(subject, good)
        measured = (covered, COVERED, "share >=")
        if covered >= COVERED and not good:  # the number that fails is the one to show
            measured = (like, LIKE, "IoU >=") if like < LIKE else (
                beyond / size, BEYOND, "of size beyond")
        cause = "" if good else (f"make the pieces of {entry['part']} again from its visual mesh: "
                                 f"assets/{entry['part']}_piece_*.obj, and boxes in every file")
        rows.append(CheckResult("collision", str(entry["part"]), status, *measured, detail, cause))
    return rows


def _number(entry: dict[str, object], name: str) -> float:
    value = entry[name]
    assert isinstance(value, int | float)  # pieces_table writes numbers
    return float(value)


def losses_table(
    subject: Subject, summary: TwinSummary | None, results: list[CheckResult]
) -> list[dict[str, object]]:
    """Return the optimiser's losses beside the measured overlap, one entry per moving part."""
    if summary is None:
        return []
    table: list[dict[str, object]] = []
    for joint in subject.joints:
        part = subject.body(int(subject.model.jnt_bodyid[joint.index]))
        losses = summary.diagnostics(part)
        depth = [r.value for r in results if r.name == "overlap" and r.subject == joint.name]
        table.append(
            {
                "part": part,
                "joint": joint.name,
                "contact_loss": losses.get("contact_loss"),
                "overlap_depth": depth[0] if depth else None,
                "vector_field_loss": losses.get("vector_field_loss"),
                "motion_residual": losses.get("motion_residual"),
            }
        )
    return table
