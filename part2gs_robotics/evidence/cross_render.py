"""Cross rendering: one state's Gaussians, moved part by part, against the other state's images.

The depth maps propose parts; the images decide. A part is real only if moving its Gaussians by its
joint makes them look more like what the cameras saw in the other state.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.light import Light
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F32, F64
from part2gs_robotics.model.gaussians import Gaussians, Splats
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.render.dispatch import render
from part2gs_robotics.render.project import ALPHA_MIN
from part2gs_robotics.runtime.buffers import Workspace
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel
from part2gs_robotics.runtime.side_by_side import side_by_side

Floats = NDArray[np.floating]
COLOR_SCALE = 0.25  # a colour error of a quarter is as wrong as it gets: light turns with nothing
MISSING_COST = 0.3  # per uncovered pixel: mostly interior that the source state never saw
# Per pixel of a far side, paint unknown: one turned over saved 0.008 without it, lost 0.018 with.
FAR_SIDE_COST = 0.1
BEHIND = 0.1, 0.3  # cosines between which a face is seen from behind: normals are off by degrees


def move_gaussians(gaussians: Gaussians, labels: NDArray[np.int64], moves: list[F64]) -> Splats:
    """Return the Gaussians as they are drawn, each moved by its label's motion [4, 4]."""
    means, quats = gaussians.means.copy(), gaussians.quats.copy()
    for k, move in enumerate(moves):
        own = labels == k
        if k and own.any():
            means[own] = se3.apply(move, gaussians.means[own].astype(np.float64))
            quats[own] = se3.quat_multiply(
                se3.quat_from_rotation(move[:3, :3]), gaussians.quats[own]
            )
    return Splats(means.astype(np.float32), quats.astype(np.float32), gaussians.scales,
                  gaussians.opacities, gaussians.colors)


def cross_cost(
    moved: Splats, views: SmallViews, normals: F64 | None = None,
) -> float:
    """Return the mean cost per object pixel, 0 = the moved Gaussians look as photographed.

    Args:
        moved: Gaussians of one state where they have moved to, see `move_gaussians`.
        views: small views of the other state; their floor is not charged.
        normals: [N, 3] of the side that the source state saw, where they have moved to; the colour
            of another side is not compared. None = every side was seen.
    """
    total = 0.0
    for costs in cross_errors(moved, views, normals):
        total += float(costs.sum(dtype=np.float64))
    return total / max(float(views.alphas.sum()), 1.0)


def cross_errors(moved: Splats, views: SmallViews, normals: F64 | None = None) -> Iterator[F32]:
    """Yield [H, W] the cost of every pixel of every view. Arguments as of `cross_cost`."""
    work, drawn = Workspace(), moved.opacities >= ALPHA_MIN
    moved, normals = moved.select(drawn), None if normals is None else normals[drawn]
    for v in range(len(views)):
        behind = None if normals is None else _behind(moved.means, normals, views.viewmats[v])
        out = render(moved, views.camera(v), extra=behind, workspace=work)
        far = np.zeros_like(out.alpha) if behind is None else out.extra[..., 0]
        costs = np.zeros_like(out.alpha)
        _pixel_costs(out.color, out.alpha, far, views.colors[v], views.alphas[v], costs)
        least = 0.0 if views.floor is None else views.floor[v]
        yield np.maximum(costs - least, 0.0)


def _behind(means: Floats, normals: F64, view: F64) -> NDArray[np.float32]:
    """Return [N, 1] 0..1, how far a camera sees Gaussians from behind."""
    out = np.zeros((len(means), 1), np.float32)
    _fill_behind(means, normals, -view[:3, :3].T @ view[:3, 3], *BEHIND, out)
    return out


@kernel
def _fill_behind(means: Floats, normals: F64, eye: F64, low: float, high: float,
                 out: Floats) -> None:
    """Fill out [N, 1] by the cosine between a normal and the ray from the eye."""
    for_each(len(means), _fill_behind_at, (means, normals, eye, low, high, out))


@inlined
def _fill_behind_at(i: int, means: Floats, normals: F64, eye: F64, low: float, high: float,
                    out: Floats) -> None:
    along, squared = 0.0, 0.0
    for a in range(3):
        ray = means[i, a] - eye[a]
        along += ray * normals[i, a]
        squared += ray * ray
    along /= max(np.sqrt(squared), 1e-12)
    out[i, 0] = min(max((along - low) / (high - low), 0.0), 1.0)


def floor_of(own: Gaussians, views: SmallViews) -> F32:
    """Return [V, H, W] what a state's own Gaussians leave unexplained in its own photos.

    A halo of a pixel along every silhouette, blur, what a few small Gaussians cannot show: most of
    the cost at the true motions, and no motion changes it.

    Args:
        own: Gaussians of a state.
        views: of the same state.
    """
    out, work = np.zeros(views.alphas.shape, np.float32), Workspace()
    for v in range(len(views)):
        seen = render(own.splats, views.camera(v), workspace=work)
        _pixel_costs(seen.color, seen.alpha, np.zeros_like(seen.alpha), views.colors[v],
                     views.alphas[v], out[v])
    return out


@kernel
def _pixel_costs(color: Floats, alpha: Floats, far: Floats, photo: Floats, mask: Floats,
                 costs: Floats) -> None:
    """Fill the cost of every pixel of an image against its photo."""
    for_each(len(costs), _pixel_costs_at, (color, alpha, far, photo, mask, costs))


@inlined
def _pixel_costs_at(y: int, color: Floats, alpha: Floats, far: Floats, photo: Floats, mask: Floats,
                    costs: Floats) -> None:
    for x in range(alpha.shape[1]):
        excess = alpha[y, x] - mask[y, x]
        # Colour of what is there; nothing is compared where nothing was rendered.
        tint = 0.0
        for c in range(3):
            tint += abs(color[y, x, c] - alpha[y, x] * photo[y, x, c])
        hidden = far[y, x] / max(alpha[y, x], 1e-6)
        tint = (1.0 - hidden) * min(tint / (3 * COLOR_SCALE), 1.0)
        cost = tint + FAR_SIDE_COST * far[y, x] + min(2.0 * max(excess, 0.0), 1.0)
        costs[y, x] = cost - MISSING_COST * min(excess, 0.0)


def both_cost(
    gaussians: tuple[Gaussians, Gaussians],
    labels: tuple[NDArray[np.int64], NDArray[np.int64]],
    moves: list[F64],
    views: tuple[SmallViews, SmallViews],
    source_weight: tuple[float, float],
    light: Light | None = None,
) -> float:
    """Return the weighted cross cost of state 0 shown as state 1 and of state 1 shown as state 0.

    The weights favour the richer state as the source (Part2GS eq. 3): a closed cabinet cannot show
    the inside of its drawers, an open one can show how it looks closed. Turned parts are as bright
    as the light makes them, and their far side is no evidence.
    """

    def cost(source: int) -> float:
        there = moves if source == 0 else [se3.inverse(m) for m in moves]
        moved, normals = shown(source, gaussians[source], labels[source], there, light)
        return cross_cost(moved, views[1 - source], normals)

    # A direction that counts for less than 2 % is not worth its renders.
    asked = [source for source in (0, 1) if source_weight[source] > 0.02]
    costs = side_by_side([partial(cost, source) for source in asked])
    return sum(source_weight[s] * c for s, c in zip(asked, costs, strict=True))


def shown(source: int, gaussians: Gaussians, labels: NDArray[np.int64], there: list[F64],
          light: Light | None) -> tuple[Splats, F64 | None]:
    """Return a state's Gaussians moved, as bright as the light makes them, and their normals there.

    Args:
        source: their state.
        gaussians: of that state.
        labels: [N] part of each.
        there: [4, 4] per label, to the other state.
        light: None = faces keep their brightness, and every side was seen.
    """
    moved = move_gaussians(gaussians, labels, there)
    if light is None:
        return moved, None
    moved = replace(moved, colors=light.colors(source, gaussians, labels, there))
    return moved, light.turned(source, labels, there)
