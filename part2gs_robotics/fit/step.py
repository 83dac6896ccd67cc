"""One state's fit in progress: parameters, losses with gradients, one optimiser step."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.fit.image_loss import photometric
from part2gs_robotics.model.arrays import F32
from part2gs_robotics.model.gaussians import SH_C0, Gaussians, Splats, opacities_of
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.model.se3 import unit_quats
from part2gs_robotics.render.dispatch import Gradients, Rendered, render, render_backward
from part2gs_robotics.runtime.adam import require_finite
from part2gs_robotics.runtime.buffers import Workspace

Params = dict[str, F32]


def params_of(gaussians: Gaussians) -> Params:
    """Return writable copies of the optimised arrays, quaternions made unit."""
    return {"means": gaussians.means.copy(), "quats": unit_quats(gaussians.quats),
            "log_scales": gaussians.log_scales.copy(),
            "logit_opacities": gaussians.logit_opacities.copy(), "sh0": gaussians.sh0.copy()}


def gaussians_of(params: Params) -> Gaussians:
    """Return the Gaussians of optimised arrays, quaternions made unit."""
    quats = unit_quats(params["quats"])
    return Gaussians(params["means"].copy(), quats.astype(np.float32),
                     params["log_scales"].copy(), params["logit_opacities"].copy(),
                     params["sh0"].copy(), np.zeros((len(quats), 0, 3), np.float32))


def draw(params: Params, camera: Camera, background: F32,
         workspace: Workspace | None = None) -> Rendered:
    """Render optimised arrays from one camera."""
    opacities = opacities_of(params["logit_opacities"])
    colors = np.maximum(np.float32(0.5) + np.float32(SH_C0) * params["sh0"], 0)
    splats = Splats(params["means"], params["quats"], np.exp(params["log_scales"]), opacities,
                    colors)
    return render(splats, camera, background=background, workspace=workspace)


def chain(params: Params, gradients: Gradients) -> Params:
    """Carry gradients of activated values to the optimised arrays."""
    opacities = opacities_of(params["logit_opacities"])
    lit = params["sh0"] > np.float32(-0.5 / SH_C0)
    with np.errstate(over="ignore", invalid="ignore"):  # `require_finite` says which overflows
        by_logs = gradients.scales * np.exp(params["log_scales"])
    return {"means": gradients.means, "quats": gradients.quats, "log_scales": by_logs,
            "logit_opacities": gradients.opacities * opacities * (1 - opacities),
            "sh0": np.where(lit, np.float32(SH_C0) * gradients.colors, 0).astype(np.float32)}


def opacity_term(logits: F32, weight: float) -> tuple[float, F32]:
    """Return weight * mean o (1 - o) and its gradient by the logits."""
    o = opacities_of(logits)
    spread = o * (1 - o)
    grad = weight / len(o) * spread * (1 - 2 * o)
    return weight * float(spread.mean()), np.asarray(grad, logits.dtype)


def alpha_term(alpha: F32, target: F32, weight: float) -> tuple[float, F32]:
    """Return weight * mean |alpha - target| and its gradient by alpha."""
    diff = alpha - target
    return weight * float(np.abs(diff).mean()), np.float32(weight / diff.size) * np.sign(diff)


def depth_term(rendered: Rendered, depth: F32, diagonal: float, weight: float,
               ) -> tuple[float, F32, F32]:
    """Return weight * mean log(1 + |d - d_gt| / diagonal), gradients by sum w z and by alpha.

    d = sum w z / alpha on pixels with depth and alpha > 0.5. Source: ArtGS's depth loss.
    """
    valid = (depth > 0) & (rendered.alpha > 0.5)
    alpha = np.maximum(rendered.alpha, 0.5)
    mean = rendered.depth / alpha
    error = np.where(valid, mean - depth, 0) / np.float32(diagonal)
    scale = np.float32(weight / max(1, int(valid.sum())))
    by_mean = scale * np.sign(error) / (1 + np.abs(error)) / np.float32(diagonal)
    loss = float(scale * np.log1p(np.abs(error)).sum())
    return loss, (by_mean / alpha).astype(np.float32), (-by_mean * mean / alpha).astype(np.float32)


def image_terms(rendered: Rendered, target: F32, alpha: F32, alpha_weight: float,
                workspace: Workspace | None = None) -> tuple[dict[str, float], F32, F32]:
    """Return named losses and their gradients by colour and alpha, on the busy box only."""
    # Outside the box image and target are the same background: their errors are zero.
    box = _busy_box(rendered.alpha, alpha)
    loss, d_color = photometric(rendered.color, target, box=box, workspace=workspace)
    mask, by_alpha = alpha_term(rendered.alpha[box], alpha[box], alpha_weight)
    share = np.float32(by_alpha.size / alpha.size)
    d_alpha = np.zeros_like(alpha)
    d_alpha[box] = by_alpha * share
    return {"image": loss, "mask": mask * float(share)}, d_color, d_alpha


def _busy_box(rendered: F32, target: F32) -> tuple[slice, slice]:
    """Return the box of pixels that are not empty in both, with room for the SSIM window."""
    busy = np.maximum(rendered, target) > 0
    rows, cols = np.flatnonzero(busy.any(1)), np.flatnonzero(busy.any(0))
    if not len(rows):
        return slice(0, busy.shape[0]), slice(0, busy.shape[1])
    pad = 5
    return (slice(max(0, int(rows[0]) - pad), min(busy.shape[0], int(rows[-1]) + pad + 1)),
            slice(max(0, int(cols[0]) - pad), min(busy.shape[1], int(cols[-1]) + pad + 1)))


__all__ = ["chain", "depth_term", "draw", "gaussians_of", "image_terms", "opacity_term",
           "params_of", "render_backward", "require_finite"]
