"""Robust ICP on the joint manifold: a few parameters, second-order steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.evidence.landing import HIDDEN_COST, Landing, land
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint, JointKind

STIFF = 1e9  # of the curvature: a held axis moves by a billionth of a step
STEPS = 4  # per matching distance; twice as many change nothing across faces
TANGENT_WEIGHT = 0.15  # flat faces say nothing sideways; colour edges and rims a little


def joint_move(kind: JointKind, params: F64) -> F64:
    """Return the [4, 4] motion of (axis 3 of any length, origin 3, value 1, slide of a screw 1)."""
    axis = params[:3] / np.linalg.norm(params[:3])
    if kind != "prismatic":
        slide = float(params[7]) if kind == "screw" else 0.0
        return se3.screw_motion(axis, params[3:6], float(params[6]), slide)
    return se3.make(np.eye(3), axis * params[6])


def refine(
    guess: Joint,
    sets: tuple[Surfels, Surfels],
    lands: tuple[Landing, Landing],
    taus: tuple[float, ...],
    steps: int = STEPS,
) -> Joint:
    """Return the motion after Gauss-Newton on point-to-plane residuals of both directions.

    Args:
        guess: start.
        sets: surfels of state 0 and state 1 that may belong to the part.
        lands: landing grids of state 0 and state 1.
        taus: matching distances in scene units, decreasing.
        steps: Gauss-Newton steps per distance.
    """
    ends = [guess.value] if guess.kind != "screw" else [guess.value, guess.rise]
    params = np.concatenate([guess.axis, guess.origin, ends])
    carrier = np.eye(4) if guess.carrier is None else guess.carrier
    for tau in taus:
        for _ in range(steps):
            zero, zero_n, one, one_n = matches(carrier @ joint_move(guess.kind, params), sets,
                                               lands, tau)
            if len(zero) < 12:  # fewer than twice the parameters: nothing to refine on
                return _refined(guess, params)
            # Where the carrier would not have moved.
            pairs = zero, zero_n, se3.apply(se3.inverse(carrier), one), one_n @ carrier[:3, :3]
            params = _step(guess.kind, params, pairs, tau, guess.held)
    return _refined(guess, params)


def misfit(h: Joint, own: tuple[Surfels, Surfels], lands: tuple[Landing, Landing],
           tau: float) -> float:
    """Return what it costs to land a part's surfels of both states in the other one."""
    ways = (h.move, own[0], lands[1]), (se3.inverse(h.move), own[1], lands[0])
    return sum(float(land(*way, tau)[0].sum()) for way in ways)


def _refined(guess: Joint, params: F64) -> Joint:
    axis = guess.axis if guess.held else params[:3] / np.linalg.norm(params[:3])
    # A screw that does not turn is a slide, and has no pitch.
    pitch = float(params[7] / params[6]) if guess.kind == "screw" and params[6] else 0.0
    return replace(guess, axis=axis, origin=params[3:6].copy(), value=float(params[6]), pitch=pitch)


def matches(
    move: F64, sets: tuple[Surfels, Surfels], lands: tuple[Landing, Landing], tau: float
) -> tuple[F64, F64, F64, F64]:
    """Return matched points and normals of state 0, then of state 1, each [M, 3]."""
    cost, index, _ = land(move, sets[0], lands[1], tau)
    ok = (index >= 0) & (cost < HIDDEN_COST)
    back, back_index, _ = land(se3.inverse(move), sets[1], lands[0], tau)
    back_ok = (back_index >= 0) & (back < HIDDEN_COST)
    s0, s1 = lands[0].surfels, lands[1].surfels
    zero = np.concatenate([sets[0].points[ok], s0.points[back_index[back_ok]]])
    zero_n = np.concatenate([sets[0].normals[ok], s0.normals[back_index[back_ok]]])
    one = np.concatenate([s1.points[index[ok]], sets[1].points[back_ok]])
    one_n = np.concatenate([s1.normals[index[ok]], sets[1].normals[back_ok]])
    return zero, zero_n, one, one_n


def _step(kind: JointKind, params: F64, pairs: tuple[F64, F64, F64, F64], tau: float,
          held: bool) -> F64:
    scale = float(np.ptp(pairs[0], axis=0).max()) + 1e-12
    count = len(params)
    end = 1e-4 * scale if kind == "prismatic" else 1e-4
    step = np.array([1e-4] * 3 + [1e-4 * scale] * 3 + [end])
    step = np.concatenate([step, np.full(count - 7, 1e-4 * scale)])

    def residuals(p: F64) -> F64:
        move = joint_move(kind, p)
        gap = se3.apply(move, pairs[0]) - pairs[2]
        plane = (gap * pairs[3]).sum(1)
        return np.concatenate([plane, TANGENT_WEIGHT * (gap - plane[:, None] * pairs[3]).ravel()])

    base = residuals(params)
    matched = len(pairs[0])
    gap2 = base[:matched] ** 2 + (base[matched:].reshape(-1, 3) ** 2).sum(1)
    weight = (
        1.0 / (1.0 + gap2 / (0.25 * tau * tau))
    ) ** 2  # Geman-McClure, half the matching distance
    weights = np.concatenate([weight, np.repeat(weight, 3)])
    jac = np.stack(
        [(residuals(params + np.eye(count)[i] * step[i]) - base) / step[i] for i in range(count)], 1
    )
    scaled = jac * step / 1e-4
    normal = scaled.T @ (scaled * weights[:, None])
    # Gauge directions (axis length, origin along the axis) and unseen ones are held by the damping.
    normal += np.eye(count) * 1e-4 * np.trace(normal) / count
    if held:
        normal[:3, :3] += np.eye(3) * STIFF * np.trace(normal)
    delta = -np.linalg.solve(normal, scaled.T @ (weights * base)) * step / 1e-4
    return _normalised(params + delta, pairs[0].mean(0))


def _normalised(params: F64, centre: F64) -> F64:
    axis = params[:3] / np.linalg.norm(params[:3])
    origin = params[3:6] + axis * (axis @ (centre - params[3:6]))
    return np.concatenate([axis, origin, params[6:]])
