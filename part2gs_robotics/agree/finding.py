"""One row of a check: what was found, what is allowed, and what to change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from part2gs_robotics.agree.catalogue import check_id

Status = Literal["pass", "warn", "fail", "skipped", "incomplete"]


@dataclass(frozen=True)
class CheckResult:
    """One measured number beside its limit.

    Attributes:
        name: the check.  subject: joint, part, file or pair it is about; "" = whole model.
        status: incomplete = it could not be measured.  value, limit, unit: None when not numeric.
        detail: one sentence for people.  cause: what to change, in which file; "" if all is well.
    """

    name: str
    subject: str
    status: Status
    value: float | None = None
    limit: float | None = None
    unit: str = ""
    detail: str = ""
    cause: str = ""

    def to_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        return {
            "name": f"{self.name}: {self.subject}" if self.subject else self.name,
            "check": self.name,
            "id": check_id(self.name),
            "subject": self.subject,
            "status": self.status,
            "value": finite(self.value),
            "limit": finite(self.limit),
            "unit": self.unit,
            "note": self.detail,
            "cause": self.cause,
        }


def finite(value: float | None) -> float | None:
    """Return a number that JSON can say, None for others."""
    return value if value is not None and math.isfinite(value) else None


def passed(good: bool) -> Status:
    """Return pass or fail."""
    return "pass" if good else "fail"


def passes(check: str, subject: str, detail: str) -> CheckResult:
    """Return a row about which nothing is wrong."""
    return CheckResult(check, subject, "pass", detail=detail)


def fails(check: str, subject: str, detail: str, cause: str) -> CheckResult:
    """Return a failure that is no matter of degree."""
    return CheckResult(check, subject, "fail", detail=detail, cause=cause)


def measured(check: str, subject: str, amount: tuple[float, float, str], detail: str,
             cause: str = "") -> CheckResult:
    """Return a row that passes while its value stays within a limit; NaN fails.

    Args:
        check: id.
        subject: what it is about.
        amount: value, limit, unit.
        detail: what was found.
        cause: what to change if it fails; "" = what usually mends it.
    """
    value, limit, unit = amount
    status = passed(value <= limit)
    return CheckResult(check, subject, status, float(value), float(limit), unit, detail,
                       cause if status == "fail" else "")
