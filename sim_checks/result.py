"""What a check says: one row per finding, one report per model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from part2gs_robotics.agree.catalogue import CHECKS
from part2gs_robotics.agree.finding import CheckResult as CheckResult
from part2gs_robotics.agree.finding import Status as Status
from part2gs_robotics.agree.finding import measured
from part2gs_robotics.agree.finding import passed as passed

WORST: tuple[Status, ...] = ("fail", "incomplete", "warn", "pass", "skipped")  # first found wins


@dataclass(frozen=True)
class Curve:
    """Exact overlap and engine contact along one joint.

    Attributes:
        joint: name.  positions: rad or units.  overlap_volume: units^3.
        overlap_depth, contact_depth: units; contact = what the engine's convex hulls report.
    """

    joint: str
    positions: tuple[float, ...]
    overlap_volume: tuple[float, ...]
    overlap_depth: tuple[float, ...]
    contact_depth: tuple[float, ...]

    def to_dict(self) -> dict[str, object]:
        """Return plain lists for JSON."""
        return {
            "joint": self.joint,
            "positions": list(self.positions),
            "overlap_volume": list(self.overlap_volume),
            "overlap_depth": list(self.overlap_depth),
            "contact_depth": list(self.contact_depth),
        }


@dataclass(frozen=True)
class CheckReport:
    """All results of one model.

    Attributes:
        path: what was checked.  engine: name and version.  results: rows.  joints: names tested.
        curves: sweep of every joint.  losses: optimiser's losses beside measured numbers, per part.
        pieces: how far the collision hulls of every part are from its true surface.
        notes: what was substituted, decimated or left out.  seconds: wall time.
        size: scene units; NaN = not known.
        unusable: why the asset could not be checked at all; "" = it was.
        stress: numbers and pictures of `--stress`, plain values; empty without.
    """

    path: str
    engine: str
    results: tuple[CheckResult, ...]
    joints: tuple[str, ...] = ()
    curves: tuple[Curve, ...] = ()
    losses: tuple[dict[str, object], ...] = ()
    pieces: tuple[dict[str, object], ...] = ()
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    size: float = field(default=float("nan"))
    unusable: str = ""
    stress: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """True when nothing failed and nothing was left unmeasured."""
        return all(r.status in ("pass", "warn", "skipped") for r in self.results)

    @property
    def exit_code(self) -> int:
        """0 when ok, 2 where the asset cannot be used, else 1."""
        return 2 if self.unusable else 0 if self.ok else 1

    def verdict(self, joint: str) -> Status:
        """Return the worst status among the rows about a joint."""
        return worst([r for r in self.results if r.subject == joint])

    def to_dict(self) -> dict[str, object]:
        """Return plain values for report.json."""
        return {
            "path": self.path,
            "engine": self.engine,
            "ok": self.ok,
            "exit_code": self.exit_code,
            "size": self.size if self.size == self.size else None,
            "seconds": round(self.seconds, 3),
            "joints": {name: self.verdict(name) for name in self.joints},
            "checks": [r.to_dict() for r in self.results],
            "curves": [c.to_dict() for c in self.curves],
            "losses": list(self.losses),
            "pieces": list(self.pieces),
            "notes": list(self.notes),
            **({"error": self.unusable} if self.unusable else {}),
            **({"stress": dict(self.stress)} if self.stress else {}),
        }


def worst(results: list[CheckResult]) -> Status:
    """Return the worst status of some rows; skipped when there are none."""
    found = {r.status for r in results}
    return next((s for s in WORST if s in found), "skipped")


def format_text(report: CheckReport) -> str:
    """Return the report as lines for a terminal, failures last so that they stay in sight."""
    order = {"skipped": 0, "pass": 1, "warn": 2, "incomplete": 3, "fail": 4}
    lines = [f"{report.path} ({report.engine}, {report.seconds:.1f} s)"]
    lines += [format_row(r) for r in sorted(report.results, key=lambda r: order[r.status])]
    lines += [f"  note: {note}" for note in report.notes]
    lines += [f"  joint {name}: {report.verdict(name)}" for name in report.joints]
    lines.append(f"  verdict: {'pass' if report.ok else 'FAIL'}")
    return "\n".join(lines) + "\n"


def format_row(r: CheckResult) -> str:
    """Return one row as text, its cause on a line of its own."""
    numbers = "" if r.value is None else f" {r.value:.4g}"
    numbers += "" if r.limit is None else f" (limit {r.limit:.4g})"
    unit = f" {r.unit}" if r.unit and numbers else ""
    line = f"  {r.status:<10} {r.name:<16} {r.subject:<18}{numbers}{unit}  {r.detail}".rstrip()
    return f"{line}\n             cause: {r.cause}" if r.cause else line


def report_of(tree: Mapping[str, Any]) -> CheckReport:
    """Return the report that `CheckReport.to_dict` wrote.

    Raises:
        KeyError, TypeError: the tree is something else.
    """
    rows = tuple(CheckResult(*(row[key] for key in (
        "check", "subject", "status", "value", "limit", "unit", "note", "cause")))
        for row in tree["checks"])
    curves = tuple(Curve(c["joint"], *(tuple(c[key]) for key in (
        "positions", "overlap_volume", "overlap_depth", "contact_depth"))) for c in tree["curves"])
    return CheckReport(
        tree["path"], tree["engine"], rows, tuple(tree["joints"]), curves, tuple(tree["losses"]),
        tuple(tree["pieces"]), tuple(tree["notes"]), tree["seconds"],
        float("nan") if tree["size"] is None else tree["size"], tree.get("error", ""),
        tree.get("stress", {}))


def with_causes(rows: Iterable[CheckResult]) -> list[CheckResult]:
    """Return the rows; what failed and does not know why gets what usually mends it."""
    return [replace(r, cause=CHECKS[r.name].change)
            if r.status in ("fail", "incomplete") and not r.cause and r.name in CHECKS else r
            for r in rows]


def row(
    name: str, subject: str, value: float, limit: float, unit: str, detail: str = ""
) -> CheckResult:
    """Return a row that passes when value <= limit; NaN fails."""
    return measured(name, subject, (value, limit, unit), detail)
