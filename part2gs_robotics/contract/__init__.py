"""What files of a twin may say at all, and how they must look: beside what they say alike.

In: a twin folder whose XML was inspected. Out: rows. Call: `contract`.
"""

from part2gs_robotics.contract.rows import contract

__all__ = ["contract"]
