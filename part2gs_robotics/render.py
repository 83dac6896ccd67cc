"""Render Gaussians: one signature, on the GPU through gsplat or on the CPU through our kernels."""

from __future__ import annotations

from part2gs_robotics.render_cpu import Gradients, Rendered, render, render_backward

__all__ = ["Gradients", "Rendered", "render", "render_backward"]
