"""Render Gaussians and differentiate: the one door to the rasterisers that the corridor uses.

runtime.device.rendering_on picks the rasteriser of a block. Importing this module loads Numba, so
it is imported by the rooms that render, when they run; Torch and gsplat are loaded by the first
rendering on CUDA.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.render import cuda as render_cuda
from part2gs_robotics.render.rendered import Floats, Gradients, Near, Rendered
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.device import current_device


def render(splats: Splats, camera: Camera, *, extra: Floats | None = None,
           background: ArrayLike | None = None, workspace: Workspace | None = None,
           near: Near | None = None) -> Rendered:
    """Render Gaussians on the device of the enclosing rendering_on.

    Args:
        splats: N Gaussians.
        camera: pinhole.
        extra: [N, C] further channels to blend.
        background: [3] colour behind everything; black without.
        workspace: buffers to use again, see cpu.render; CUDA has its own.
        near: what of the image is asked for, None = all; CUDA draws all.

    Returns:
        The images: on the CPU in the dtype of means, on CUDA in float32.
    """
    if current_device() == "cuda":
        return render_cuda.render(splats, camera, extra=extra, background=background)
    return render_cpu.render(splats, camera, extra=extra, background=background,
                             workspace=workspace, near=near)


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


__all__ = ["Gradients", "Near", "Rendered", "render", "render_backward"]
