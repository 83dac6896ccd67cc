"""Fit the Gaussians of one state to its images: the loop."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import FitConfig, StereoConfig
from part2gs_robotics.fit.brightness import WHEN, evened, gains_of
from part2gs_robotics.fit.density import Density
from part2gs_robotics.fit.depth_smooth import smooth_term
from part2gs_robotics.fit.hull import Hull, carve
from part2gs_robotics.fit.start import first_gaussians
from part2gs_robotics.fit.step import (
    chain,
    depth_term,
    draw,
    gaussians_of,
    image_terms,
    opacity_term,
    params_of,
)
from part2gs_robotics.fit.tones import Tones, tones_of
from part2gs_robotics.fit.training_photos import Views
from part2gs_robotics.fit.view_color import held_out_psnr, with_view_dependence
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Camera, StateViews
from part2gs_robotics.render.dispatch import Rendered, render_backward
from part2gs_robotics.runtime.adam import Adam, require_finite
from part2gs_robotics.runtime.buffers import Workspace

Floats = NDArray[np.floating]
# step, steps, last held-out PSNR, and who returns the Gaussians so far
Progress = Callable[[int, int, float, Callable[[], Gaussians]], None]


@dataclass(frozen=True)
class FitResult:
    """Gaussians of one state and how the fit went.

    Attributes:
        gaussians: the fit, in the world frame.
        hull: the visual hull it started from, None when it started from given Gaussians.
        curve: (seconds since the start, PSNR of the held-out views in dB, Gaussians) over time.
        gains: [V, 3] how much more light each photo got than the middle one, None = all alike.
    """

    gaussians: Gaussians
    hull: Hull | None
    curve: list[tuple[float, float, int]]
    gains: F64 | None = None


def fit_state(state: StateViews, init: Hull | Gaussians | None = None,
              config: FitConfig | None = None, progress: Progress | None = None,
              name: str = "state", stereo: StereoConfig | None = None) -> FitResult:
    """Fit Gaussians to the images of one state.

    Args:
        state: posed views; the held-out ones only measure.
        init: where to start; None = carve the visual hull here.
        config: None = the standard preset.
        progress: called after each step.
        name: what messages call this state.
        stereo: None = the standard preset.

    Raises:
        FitError: the masks do not meet, or a loss or parameter is no longer finite.
    """
    config = config or FitConfig()
    start = time.perf_counter()
    hull: Hull | None = None
    tones = tones_of(state)
    if isinstance(init, Gaussians):
        first = tones.forward(init)
    else:
        hull = init or carve(state, resolution=config.hull_resolution)
        first = first_gaussians(hull, tones.even(state), config, stereo)
    run = FitRun(state, tones, first, hull, config, name)
    curve = [(time.perf_counter() - start, run.held_out_psnr(), len(first))]
    marks = {round(config.steps * k / 8) for k in range(1, 9)}  # eight points make a curve
    looks = {round(config.steps * share) for share in WHEN}
    for step in range(1, config.steps + 1):
        run.step(step)
        if step in looks and not run.make_alike():
            looks.clear()
        if step in marks:
            curve.append((time.perf_counter() - start, run.held_out_psnr(), run.count))
        if progress is not None:
            progress(step, config.steps, curve[-1][1], run.gaussians)
    found, state = run.gaussians(), run.state
    if config.view_color:
        found = with_view_dependence(found, state, run.natural, config.alpha_weight, config.seed)
    if found.shN.shape[1]:
        curve.append((time.perf_counter() - start, held_out_psnr(found, state, run.natural),
                      len(found)))
    return FitResult(found, hull, curve, run.gains)


# Per step, means in diagonals; colours 2 to 8 x 3DGS; 26 % less error than quats 5e-3, scales 2e-2.
RATES = {"means": 5e-4, "quats": 1e-3, "log_scales": 1e-2, "logit_opacities": 1e-1, "sh0": 2e-2}
NATURAL_FROM = 0.85  # of all steps: depth is settled by then, blended colours are not
HARDEN_FROM = 0.5  # of all steps
MEANS_END = 0.05  # the rate of the means falls to this share: large moves first, then polish
CHANGE_EVERY = 50  # steps between prune and split rounds
CHANGE_UNTIL = 0.6  # of all steps: the rest lets the last halves settle


class FitRun:
    """Everything that changes while one state is fitted; step(k) for k from 1 on fits it."""

    def __init__(self, state: StateViews, tones: Tones, first: Gaussians, hull: Hull | None,
                 config: FitConfig, name: str) -> None:
        self.state, self.tones, self.config, self.name = state, tones, config, name
        self.natural, self.views = Views(state), Views(tones.even(state))
        self.taken = state, self.natural
        self.gains: F64 | None = None
        self.even = True
        self.rng = np.random.default_rng(config.seed)
        self.params = params_of(first)
        self.diagonal = hull.diagonal if hull is not None else _diagonal(first)
        self.adam = Adam({**RATES, "means": RATES["means"] * self.diagonal})
        self.density = Density(hull, config.max_gaussians)
        self.start = len(first)
        self.train = np.flatnonzero(~state.held_out)
        self.queue: list[int] = []
        self.work = Workspace()

    @property
    def count(self) -> int:
        """Number of Gaussians."""
        return len(self.params["means"])

    def gaussians(self) -> Gaussians:
        """Return the fit so far, in natural tones."""
        found = gaussians_of(self.params)
        return self.tones.back(found) if self.even else found

    def make_alike(self) -> bool:
        """Make the photos alike in brightness; return whether they were not."""
        found = gains_of(self.gaussians(), *self.taken)
        if found is not None:
            self.gains, self.state = found, evened(self.taken[0], found)
            self.natural, self.views = Views(self.state), Views(self.tones.even(self.state))
        return found is not None

    def step(self, step: int) -> None:
        """Render one training view, go back through it, update, sometimes prune and split."""
        if self.even and step > NATURAL_FROM * self.config.steps:
            self.params["sh0"] = self.gaussians().sh0.copy()
            self.even, self.views = False, self.natural
        if not self.queue:
            self.queue = self.rng.permutation(self.train).tolist()
        view, level = self.queue.pop(), int(step <= self.config.half_steps)
        background = self.rng.random(3, dtype=np.float32)
        target, alpha, intrinsics = self.views.target(view, level, background, self.work)
        height, width = alpha.shape
        camera = Camera(self.state.viewmats[view], intrinsics, width, height)
        rendered = draw(self.params, camera, background, self.work)
        losses, d_color, d_alpha = image_terms(rendered, target, alpha,
                                               self.config.alpha_weight, self.work)
        name, loss, d_depth, more = self._depth_loss(rendered, view, level, alpha)
        if d_depth is not None:
            losses[name] = loss
            d_alpha += more
        gradients = render_backward(rendered, d_color, d_alpha, d_depth, None)
        grads = chain(self.params, gradients)
        done = step / self.config.steps
        # Opacities are free at first, so that lids can fade before they are pushed to 0 or 1.
        harden = self.config.opacity_weight if done > HARDEN_FROM else 0.0
        losses["opacity"], more = opacity_term(self.params["logit_opacities"], harden)
        grads["logit_opacities"] += more
        require_finite({**self.params, **losses}, self.name, step)
        require_finite({f"gradient of {key}": value for key, value in grads.items()}, self.name,
                       step)
        grads["means"] *= np.float32(self.diagonal)  # Adam's epsilon is the same in every unit
        self.adam.rates["means"] = RATES["means"] * self.diagonal * MEANS_END**done
        self.adam.step(self.params, grads if self.even else {"sh0": grads["sh0"]})
        self.density.add(gradients.means2d_abs * (width / self.state.width),
                         gradients.visible)
        if step % CHANGE_EVERY == 0 and done <= CHANGE_UNTIL:
            grown = self.start + (self.config.max_gaussians - self.start) * done / CHANGE_UNTIL
            self.params = self.density.change(self.params, self.adam, int(grown))

    def _depth_loss(self, rendered: Rendered, view: int, level: int, alpha: Floats,
                    ) -> tuple[str, float, Floats | None, Floats]:
        """Return the depth term, or without depth images the smoothness, and its gradients.

        The gradient by depth is None where there is no such term: at half size, and in natural
        tones, when only colours change.
        """
        depths, config = self.state.depths, self.config
        weight = config.smooth_weight if depths is None else config.depth_weight
        if level or not self.even or weight == 0:
            return "", 0.0, None, alpha
        if depths is not None:
            return "depth", *depth_term(rendered, depths[view], self.diagonal, weight)
        photo = self.views.photo(view, level)
        return "smooth", *smooth_term(rendered, photo, alpha, self.diagonal, weight, self.work)

    def held_out_psnr(self) -> float:
        """Return the mean PSNR over the held-out views in their natural tones."""
        return held_out_psnr(self.gaussians(), self.state, self.natural)


def _diagonal(gaussians: Gaussians) -> float:
    """Return the diagonal of the centres, at least the size of a Gaussian where they coincide."""
    spread = float(np.linalg.norm(np.ptp(gaussians.means, axis=0)))
    return max(spread, 2 * float(np.median(gaussians.scales.max(1))))
