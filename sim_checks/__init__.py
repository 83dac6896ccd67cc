"""Physics checks of an exported twin.

In: a twin folder or any MJCF file. Out: `result.CheckReport`, whose exit code CI reads.
Call: `check`.
"""

from part2gs_robotics.sim_checks.runner import check

__all__ = ["check"]
