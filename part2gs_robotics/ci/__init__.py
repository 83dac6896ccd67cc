"""Continuous integration: many assets at once, cached, with what is known and accepted.

In: paths and wishes. Out: `sim_checks.result.CheckReport` per asset. Call: `check_assets`; pytest
finds `pytest_plugin.py` by itself.
"""

from part2gs_robotics.ci.assets import Wishes, check_assets

__all__ = ["Wishes", "check_assets"]
