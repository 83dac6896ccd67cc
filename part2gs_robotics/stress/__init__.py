"""Stiff and extreme: where a model's simulation stops being right, and what accuracy costs.

In: a checked model. Out: rows, and `Study`, whose numbers and pictures go into the report.
Call: `stress`.
"""

from part2gs_robotics.stress.study import stress

__all__ = ["stress"]
