"""One thing that was compared: what was found, what is allowed, and what to change."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["pass", "warn", "fail", "incomplete"]


@dataclass(frozen=True)
class Finding:
    """A row of the group `files`.

    Attributes:
        check: its id.  subject: file, or part or joint in a file.  verdict.
        value, limit, unit: None where nothing is measured.
        detail: what was found.  cause: which file is at fault, and what to change in it.
    """

    check: str
    subject: str
    verdict: Verdict
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    detail: str = ""
    cause: str = ""


def fails(check: str, subject: str, detail: str, cause: str) -> Finding:
    """Return a failure that is no matter of degree."""
    return Finding(check, subject, "fail", detail=detail, cause=cause)


def measured(check: str, subject: str, amount: tuple[float, float, str], detail: str,
             cause: str) -> Finding:
    """Return a row that passes while its value stays within a limit; NaN fails.

    Args:
        check: id.
        subject: what it is about.
        amount: value, limit, unit.
        detail: what was found.
        cause: what to change if it fails.
    """
    value, limit, unit = amount
    good = value <= limit
    return Finding(check, subject, "pass" if good else "fail", value, limit, unit, detail,
                   "" if good else cause)
