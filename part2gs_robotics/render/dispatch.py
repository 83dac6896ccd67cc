"""Render Gaussians and differentiate: the one door to the rasterisers that the corridor uses.

device.rendering_on picks the rasteriser of a block; render_reference has the same arguments and is
the truth of the tests. Importing this module loads Numba, so it is imported by the rooms that
render, when they run; Torch and gsplat are loaded by the first rendering on CUDA.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.render import cuda as render_cuda
from part2gs_robotics.render.rendered import Floats, Gradients, Rendered
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.device import current_device


def render(means: Floats, quats: Floats, scales: Floats, opacities: Floats, colors: Floats,
           viewmat: ArrayLike, K: ArrayLike, width: int, height: int, *,
           extra: Floats | None = None, background: ArrayLike | None = None,
           workspace: Workspace | None = None) -> Rendered:
    """Render Gaussians on the device of the enclosing rendering_on.

    Args:
        means: [N, 3] world frame, scene units.
        quats: [N, 4] wxyz of any length.
        scales: [N, 3] standard deviations, scene units.
        opacities: [N] in [0, 1].
        colors: [N, 3].
        viewmat: [4, 4] camera_from_world, OpenCV axes.
        K: [3, 3] pixels, no skew, pixel centres at +0.5.
        width: pixels.
        height: pixels.
        extra: [N, C] further channels to blend.
        background: [3] colour behind everything; black without.
        workspace: buffers to use again, see render_cpu.render; CUDA has its own.

    Returns:
        The images: on the CPU in the dtype of means, on CUDA in float32.
    """
    gaussians = (means, quats, scales, opacities, colors)
    if current_device() == "cuda":
        return render_cuda.render(*gaussians, viewmat, K, width, height, extra=extra,
                                  background=background)
    return render_cpu.render(*gaussians, viewmat, K, width, height, extra=extra,
                             background=background, workspace=workspace)


def render_backward(rendered: Rendered, d_color: Floats | None, d_alpha: Floats | None = None,
                    d_depth: Floats | None = None, d_extra: Floats | None = None) -> Gradients:
    """Return the gradients of a loss from those of its images, on the device that drew them.

    Args:
        rendered: what render returned.
        d_color: [H, W, 3] dL/dcolor; None where the loss does not use an image, here and below.
        d_alpha: [H, W].
        d_depth: [H, W].
        d_extra: [H, W, C].
    """
    drawn_by = render_cuda if isinstance(rendered.saved, render_cuda.Saved) else render_cpu
    return drawn_by.render_backward(rendered, d_color, d_alpha, d_depth, d_extra)


__all__ = ["Gradients", "Rendered", "render", "render_backward"]
