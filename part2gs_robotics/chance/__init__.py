"""Chances: what the standard deviations of a twin's joints mean for its physics.

In: a twin folder. Out: rows with the probability that joints drawn from their standard deviations
are free of collision and reach their states. Call: `chances`.
"""

from part2gs_robotics.chance.rows import chances

__all__ = ["chances"]
