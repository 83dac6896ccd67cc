"""Render Gaussians and differentiate: the one door to the rasteriser that the corridor uses.

The CPU kernels are the only device; render_reference has the same arguments and is the truth of the
tests. Importing this module loads Numba, so it is imported by the rooms that render, when they run.
"""

from __future__ import annotations

from part2gs_robotics.render_cpu import Gradients, Rendered, render, render_backward

__all__ = ["Gradients", "Rendered", "render", "render_backward"]
