"""Physics checks of an exported twin.

In: a twin folder or any MJCF file. Out: `result.CheckReport`, whose exit code CI reads.
Call: `check`.
"""

import typing

if typing.TYPE_CHECKING:
    from part2gs_robotics.sim_checks.runner import check

__all__ = ["check"]


def __getattr__(name: str) -> object:
    """Load the checks when they are called: who reads a report back needs no engine."""
    if name != "check":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from part2gs_robotics.sim_checks.runner import check as found

    return found
