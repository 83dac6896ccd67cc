"""Mend: what the checks found goes back, and the meshes are carved where parts overlap.

In: a twin whose checks fail. Out: the twin with room made at the poses that failed, and what each
round brought. Call: `mended`.
"""

from part2gs_robotics.mend.rounds import mendable, mended

__all__ = ["mendable", "mended"]
