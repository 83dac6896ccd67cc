"""Depth smoothness: planes are free, jumps cost, photo edges excuse them, gradients are true."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.fit.depth_smooth import smooth_term
from part2gs_robotics.fit.depth_smooth_kernels import DEAD, EDGE, SOFT, SPANS

SIDE, DIAGONAL = 24, 1.7


def drawn(inverse: np.ndarray, alpha: float = 0.9) -> SimpleNamespace:
    """Return what a renderer would give for inverse depths at one alpha."""
    full = np.full(inverse.shape, alpha)
    return SimpleNamespace(depth=full / inverse, alpha=full)


def term(inverse: np.ndarray, photo: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    mask = np.ones(inverse.shape)
    return smooth_term(drawn(inverse), photo, mask, DIAGONAL, 1.0)  # type: ignore[arg-type]


def plane() -> np.ndarray:
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    return 0.4 + 0.004 * x - 0.003 * y


PLAIN = np.full((SIDE, SIDE, 3), 0.5)


def test_a_slanted_plane_costs_nothing() -> None:
    loss, by_depth, by_alpha = term(plane(), PLAIN)
    assert loss < 1e-12
    # Rounding of the second differences (1e-16) has a sign: its pull is bounded, not zero.
    assert np.isfinite(by_depth).all()
    assert np.isfinite(by_alpha).all()


def test_a_jump_costs_unless_the_photo_has_an_edge_there() -> None:
    inverse, photo = plane(), PLAIN.copy()
    inverse[:, 12:] *= 0.8
    bare = term(inverse, photo)[0]
    photo[:, 12:] = 0.9
    assert bare > 0.01
    assert term(inverse, photo)[0] < 0.01 * bare  # e^-4.85, the edge is 4.85 EDGE


def test_a_jump_is_pulled_together() -> None:
    inverse = plane()
    inverse[8:16, 8:16] *= 1.1  # a patch in front of the plane, as a lid over a hollow
    _, by_depth, _ = term(inverse, PLAIN)
    assert by_depth[8:16, 8:16].sum() < 0  # descending moves the patch away from the camera


def reference(inverse: np.ndarray, held: np.ndarray, photo: np.ndarray) -> float:
    """Return the loss of the equation, `held` = the inverse depth whose square is constant."""
    total = 0.0
    for u, d, c in ((inverse, 1 / held, photo),
                    (inverse.T, 1 / held.T, photo.transpose(1, 0, 2))):
        step = np.maximum(np.abs(np.diff(c, axis=1)).max(-1) - DEAD, 0)
        edges = np.concatenate([np.zeros((len(u), 1)), np.cumsum(step, 1)], 1)
        for s in SPANS:
            bend = np.abs(u[:, :-2 * s] - 2 * u[:, s:-s] + u[:, 2 * s:])
            edge = edges[:, 2 * s:] - edges[:, :-2 * s]
            weight = np.where(edge <= 5 * EDGE, np.exp(-edge / EDGE), 0)
            total += (weight * SOFT * np.log1p(bend * d[:, s:-s] ** 2 / (DIAGONAL * SOFT))).sum()
    return float(total / inverse.size)


def test_loss_and_gradient_follow_the_equation() -> None:
    rng = np.random.default_rng(0)
    inverse = plane() * rng.uniform(0.9, 1.1, (SIDE, SIDE))
    photo = rng.uniform(0.45, 0.55, (SIDE, SIDE, 3))
    loss, by_depth, by_alpha = term(inverse, photo)
    assert loss == pytest.approx(reference(inverse, inverse, photo), rel=1e-10)
    alpha = np.full(inverse.shape, 0.9)
    depth = alpha / inverse
    for grad, which in ((by_depth, 0), (by_alpha, 1)):
        for _ in range(20):
            move = 1e-7 * rng.normal(size=inverse.shape)
            ends = []
            for sign in (1, -1):
                d, a = depth + sign * move * (1 - which), alpha + sign * move * which
                ends.append(reference(a / d, inverse, photo))
            # The gradients are exact; the differences lose 1e-16 / 1e-7.
            assert (ends[0] - ends[1]) / 2 == pytest.approx(float((grad * move).sum()), rel=1e-4,
                                                            abs=1e-12)


def test_an_empty_mask_costs_nothing() -> None:
    loss, by_depth, by_alpha = smooth_term(  # type: ignore[arg-type]
        drawn(plane()), PLAIN, np.zeros((SIDE, SIDE)), DIAGONAL, 1.0)
    assert (loss, np.abs(by_depth).max(), np.abs(by_alpha).max()) == (0.0, 0.0, 0.0)
