"""Physics checks of an exported twin."""

from part2gs_robotics.sim_checks.result import CheckReport, CheckResult, Curve, format_text
from part2gs_robotics.sim_checks.runner import GROUPS, check

__all__ = ["GROUPS", "CheckReport", "CheckResult", "Curve", "check", "format_text"]
