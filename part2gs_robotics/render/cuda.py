"""The images and gradients of render_cpu on an NVIDIA GPU, drawn by gsplat (an optional extra).

Projection, low-pass, near plane, alpha threshold and order are the same. What differs:
float32 whatever the inputs are; sums in an order that changes from run to run; opacities above
0.99 are drawn as 0.99; and the Gaussian that would take a pixel's transmittance below 1e-4 is left
out instead of being the last one, so that up to 1 % of the background shines through.
Source: gsplat 1.5.3, RasterizeToPixels3DGSFwd.cu and ProjectionEWA3DGSFused.cu.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from part2gs_robotics.errors import FitError
from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.rendered import Floats, Gradients, Rendered

if TYPE_CHECKING:
    from torch import Tensor


DEVICE = "cuda"
NEAR = 0.01  # internal units, as in render_cpu
LOW_PASS = 0.3  # pixels^2 added to the 2-D covariance, as in render_cpu
OPACITY_MAX = 0.99  # as in cpu.py: 1 % of light is lost at most, with gsplat 1.5.3's 0.999 a tenth
TINY = 1e-30  # squared norm: below, float32 has no direction left to normalise


@dataclass(frozen=True)
class Saved:
    """What stays on the GPU for gradients and questions.

    Attributes:
        leaves: means, quats, scales, opacities and channels (colors, extra) as drawn.
        means2d: [1, N, 2] projected centres, pixels.
        image: [1, H, W, 3 + C + 1] colour, extra, sum w z.
        alpha: [1, H, W, 1].
        camera: that they were drawn for.
    """

    leaves: tuple[Tensor, ...]
    means2d: Tensor
    image: Tensor
    alpha: Tensor
    camera: Camera

    def median_depth(self) -> Floats:
        """Return the median depth, drawn by the CPU's kernels: gsplat has none."""
        from part2gs_robotics.render import cpu as render_cpu

        means, quats, scales, opacities, channels = map(_numpy, self.leaves)
        splats = Splats(means, quats, scales, opacities, channels[:, :3])
        return render_cpu.render(splats, self.camera).median_depth


def render(splats: Splats, camera: Camera, *, extra: Floats | None = None,
           background: ArrayLike | None = None) -> Rendered:
    """Render Gaussians into one pinhole camera, in float32.

    Args:
        splats: N Gaussians, rounded to float32; opacities above 0.99 are drawn as 0.99, with the
            gradient of 0.99.
        camera: pinhole.
        extra: [N, C] further channels to blend.
        background: [3] colour behind everything; black without.

    Returns:
        The images. A Gaussian with a value that is not finite is left out.

    Raises:
        FitError: the GPU's memory is full.
    """
    if not len(splats):  # gsplat divides by the number of Gaussians
        from part2gs_robotics.render import cpu as render_cpu

        return render_cpu.render(splats, camera, extra=extra, background=background)
    import torch

    channels = (splats.colors if extra is None
                else np.concatenate([splats.colors, extra], axis=1))
    with _enough_memory(len(splats)):
        leaves = tuple(torch.tensor(a, device=DEVICE, requires_grad=True)
                       for a in _drawable(splats, channels))
        image, alpha, means2d, radii = _rasterize(leaves, camera, background)
    drawn = _numpy(image)[0]
    saved = Saved(leaves, means2d, image, alpha, camera)
    return Rendered(np.ascontiguousarray(drawn[..., :3]), _numpy(alpha)[0, ..., 0],
                    np.ascontiguousarray(drawn[..., -1]), np.ascontiguousarray(drawn[..., 3:-1]),
                    (_numpy(radii)[0] > 0).all(-1), saved)


def render_backward(rendered: Rendered, d_color: Floats | None, d_alpha: Floats | None = None,
                    d_depth: Floats | None = None, d_extra: Floats | None = None) -> Gradients:
    """Return the gradients of a loss from those of its images.

    Args:
        rendered: what render returned.
        d_color: [H, W, 3] dL/dcolor; None where the loss does not use an image, here and below.
        d_alpha: [H, W].
        d_depth: [H, W].
        d_extra: [H, W, C].

    Returns:
        Gradients in float32; zero for Gaussians out of sight.

    Raises:
        TypeError: another device drew the images.
        FitError: the GPU's memory is full.
    """
    import torch

    s = rendered.saved
    if not isinstance(s, Saved):
        raise TypeError(f"these images were drawn with {type(s).__module__}. Expected images of "
                        "render_cuda; call part2gs_robotics.render.dispatch.render_backward.")
    d_image = np.zeros(s.image.shape, np.float32)
    d_cover = np.zeros(s.alpha.shape, np.float32)
    for part, gradient in ((d_image[0, ..., :3], d_color), (d_image[0, ..., 3:-1], d_extra),
                           (d_image[0, ..., -1], d_depth), (d_cover[0, ..., 0], d_alpha)):
        if gradient is not None:
            part[...] = gradient
    with _enough_memory(len(rendered.visible)):
        gradients = torch.autograd.grad(
            (s.image, s.alpha), (*s.leaves, s.means2d),
            tuple(torch.tensor(d, device=DEVICE) for d in (d_image, d_cover)), retain_graph=True)
    means, quats, scales, opacities, channels, means2d = map(_numpy, gradients)
    return Gradients(means, quats, scales, opacities, np.ascontiguousarray(channels[:, :3]),
                     np.ascontiguousarray(channels[:, 3:]), np.linalg.norm(means2d[0], axis=-1),
                     rendered.visible)


def draw_one() -> None:
    """Draw one Gaussian and differentiate: whatever is missing on this machine raises here."""
    one = np.ones((1, 3), np.float32)
    splats = Splats(one * (0, 0, 2), np.ones((1, 4), np.float32), 0.1 * one, 0.9 * one[0, :1], one)
    K = np.array([[40.0, 0, 8], [0, 40, 8], [0, 0, 1]])
    drawn = render(splats, Camera(np.eye(4), K, 16, 16))
    gradients = render_backward(drawn, np.ones_like(drawn.color))
    # The pixel beside the centre sees 0.85 of it, and more opacity means more light.
    if not (0.8 < float(drawn.alpha.max()) < 0.9 and gradients.opacities[0] > 0):
        raise RuntimeError(f"a Gaussian of opacity 0.9 is drawn with {drawn.alpha.max():.3f}")


def _rasterize(leaves: tuple[Tensor, ...], camera: Camera, background: ArrayLike | None,
               ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return image, alpha, projected centres [1, N, 2] and radii [1, N, 2] (0: out of sight)."""
    import torch
    from gsplat import rasterization

    behind = np.zeros((1, leaves[-1].shape[1]), np.float32)
    behind[0, :3] = 0 if background is None else background
    one, lens = (np.array(a, np.float32)[None] for a in (camera.viewmat, camera.K))
    view, K, behind_all = (torch.tensor(a, device=DEVICE) for a in (one, lens, behind))
    image, alpha, meta = rasterization(
        *leaves, view, K, camera.width, camera.height, near_plane=NEAR, eps2d=LOW_PASS,
        packed=False, backgrounds=behind_all, render_mode="RGB+D", rasterize_mode="classic")
    return image, alpha, meta["means2d"], meta["radii"]


def _drawable(splats: Splats, channels: Floats) -> tuple[F32, ...]:
    """Return float32 copies in which a Gaussian that is not finite is transparent instead."""
    arrays = tuple(np.array(a, np.float32) for a in (splats.means, splats.quats, splats.scales,
                                               splats.opacities, channels))
    finite = np.logical_and.reduce([np.isfinite(a.reshape(len(a), -1)).all(1) for a in arrays])
    sound = finite & ((arrays[1] * arrays[1]).sum(1) > TINY)
    for a in arrays:
        a[~sound] = 0
    arrays[1][~sound] = (1, 0, 0, 0)
    np.minimum(arrays[3], OPACITY_MAX, out=arrays[3])
    return arrays


def _numpy(tensor: Tensor) -> Floats:
    return tensor.detach().cpu().numpy()


@contextmanager
def _enough_memory(gaussians: int) -> Iterator[None]:
    """Turn a full GPU memory into an error that says what to do."""
    import torch

    try:
        yield
    except torch.cuda.OutOfMemoryError as err:
        raise FitError(f"--device is cuda: the GPU's memory is full with {gaussians} Gaussians. "
                       "Expected room for them; free the GPU, lower --max-side or --max-gaussians, "
                       "or use --device cpu.") from err
