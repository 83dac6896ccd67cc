"""Refine part identities: evidence per Gaussian, smooth over neighbours, alike in both states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from part2gs_robotics.model.arrays import F32, F64, I64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import part_motions
from part2gs_robotics.model.points import tree_of
from part2gs_robotics.model.se3 import apply, inverse
from part2gs_robotics.paper.neighbourhood import (
    END_TEMPERATURE,
    gaussian_normals,
    is_hard,
    part_neighbors,
    part_temperature,
)
from part2gs_robotics.runtime.adam import direction

TINY = 1e-30  # a softmax may underflow to 0; well above float32's least 1e-38, log stays finite
ADAM_BETAS, ADAM_EPSILON = (0.9, 0.99), 1e-8  # 40 soft steps: squares forget sooner


@dataclass(frozen=True)
class IdentityConfig:
    """Settings of `refine_identities`; costs are nats (negative log likelihoods)."""

    num_steps: int = 60
    """Steps, the last third hard; 90 gave the same accuracy within 0.1 %."""
    learning_rate: float = 0.1
    """Adam's step on the embeddings, nats: 40 soft steps outweigh any capped evidence."""
    part_weight: float = 3.0
    """lambda_part; swept here: 1 leaves wrong evidence standing, 20 eats thin parts."""
    cross_weight: float = 3.0
    """Worth of the other state's agreement under a part's motion, nats; 0 = states apart.
    Swept here: it settles flush seams, which neighbours alone cannot."""
    num_neighbors: int = 8
    """k of the neighbourhood."""
    unary_cap: float = 3.0
    """Nats; no single Gaussian's evidence leaves less than exp(-3) = 5 % doubt."""
    floor: float = 0.02
    """Least share a part has in any neighbourhood, so that it costs at most 4 nats there."""
    normal_weight: float = 4.0
    """See `neighbourhood.part_neighbors`."""
    color_weight: float = 4.0
    """See `neighbourhood.part_neighbors`."""
    reach_spacings: float = 2.0
    """A moved Gaussian agrees with the other state within this many median spacings."""
    annealed: bool = True
    """Cool the softmax and end with hard labels; False = temperature 1 throughout."""


# Eq. 4 as printed, evidence in place of rendering; 0.1: lambda_part of its nearest published kin.
PAPER = IdentityConfig(part_weight=0.1, cross_weight=0.0, floor=1e-6, normal_weight=0.0,
                       color_weight=0.0, annealed=False)


def refine_identities(
    unary0: NDArray[np.floating],
    unary1: NDArray[np.floating],
    gaussians: tuple[Gaussians, Gaussians],
    joints: Sequence[Joint],
    config: IdentityConfig | None = None,
    parents: Sequence[int] | None = None,
) -> tuple[F32, F32]:
    """Return part probabilities [N_s, K+1] of both states, float32; column 0 = base.

    Minimises sum_i sum_k F_ik (u_ik - w s_ik) + lambda_part sum_i KL(F_i || mean_N(i) F) over the
    embeddings rho (d = K+1, W = 1, b = 0, started at -u) by Adam with an annealed softmax, then
    label by label in the last third. s_ik is the other state's probability of part k where part
    k's motion carries Gaussian i. Deterministic.

    Args:
        unary0: [N_0, K+1] cost of each part for each Gaussian of state 0, nats, lower = better;
            a constant row knows nothing; +inf forbids a part (up to the cap).
        unary1: [N_1, K+1] the same for state 1.
        gaussians: state 0 and state 1, world frame.
        joints: K joints; `value` is the joint position at state 1.
        config: None = defaults.
        parents: K parents (0 = base); None = all on the base.

    Source: Part2GS eq. 4 with the evidence it needs (method 6.5); analytic gradient.
    """
    config = config or IdentityConfig()
    unary = [
        _capped(u, len(g), len(joints) + 1, config.unary_cap)
        for u, g in zip((unary0, unary1), gaussians, strict=True)
    ]
    if not joints:
        return np.ones((len(unary[0]), 1), np.float32), np.ones((len(unary[1]), 1), np.float32)
    graphs = [_graph(g, config) for g in gaussians]
    landings = _landings(gaussians, part_motions(joints, parents), config.reach_spacings)
    probs = _optimised(unary, landings, graphs, config)
    if not config.annealed:
        return probs[0], probs[1]
    return _posterior(probs, unary, landings, graphs, config)


def soft_objective(
    embeddings: F32, costs: F32, graph: csr_array, config: IdentityConfig, temperature: float
) -> tuple[float, F32]:
    """Return sum F u + lambda_part sum KL(F || A F), and its gradient [N, K+1].

    Args:
        embeddings: [N, K+1] rho.
        costs: [N, K+1] evidence, nats.
        graph: [N, N] A, rows = mean over the neighbours.
        config: part_weight and floor.
        temperature: of the softmax F.
    """
    probs = _softmax(embeddings / temperature)
    around = graph @ probs + config.floor
    log_ratio = np.log(np.maximum(probs, TINY)) - np.log(around)
    value = float((probs * (costs + config.part_weight * log_ratio)).sum())
    slope = costs + config.part_weight * (log_ratio + 1.0 - graph.T @ (probs / around))
    centred = slope - (probs * slope).sum(1, keepdims=True)
    return value, probs * centred / temperature


def _optimised(
    unary: list[F32], landings: tuple[I64, I64], graphs: list[csr_array], config: IdentityConfig
) -> list[F32]:
    """Return identities [N_s, K+1] after the soft and the hard steps; one-hot if annealed."""
    embeddings = [-u for u in unary]
    moments = [(np.zeros_like(u), np.zeros_like(u)) for u in unary]
    probs = [_softmax(e) for e in embeddings]
    for step in range(config.num_steps):
        hard = config.annealed and is_hard(step, config.num_steps)
        if hard:
            probs = [_one_hot(p.argmax(1), p.shape[1]) for p in probs]
        support = [_support(landings[s], probs[1 - s]) for s in (0, 1)]
        costs = [u - config.cross_weight * s for u, s in zip(unary, support, strict=True)]
        temperature = part_temperature(step, config.num_steps) if config.annealed else 1.0
        for s in (0, 1):
            if hard:
                probs[s] = _relabelled(probs[s], costs[s], graphs[s], config, step)
                continue
            _, gradient = soft_objective(embeddings[s], costs[s], graphs[s], config, temperature)
            way = direction(moments[s], gradient, step, ADAM_BETAS, ADAM_EPSILON)
            embeddings[s] = embeddings[s] - config.learning_rate * way
            probs[s] = _softmax(embeddings[s] / temperature)
    return probs


def _capped(unary: NDArray[np.floating], rows: int, parts: int, cap: float) -> F32:
    """Return costs above each row's best, at most the cap."""
    assert unary.shape == (rows, parts), f"unary costs are {unary.shape}, expected {(rows, parts)}"
    assert (unary > -np.inf).all(), "unary costs hold NaN or -inf; a constant row says 'unknown'"
    finite = np.minimum(unary, np.finfo(np.float32).max)
    above = finite - finite.min(1, keepdims=True)
    return np.minimum(above, cap).astype(np.float32)


def _graph(gaussians: Gaussians, config: IdentityConfig) -> csr_array:
    """Return the [N, N] matrix whose row i averages over the neighbours of i."""
    neighbors = part_neighbors(
        gaussians.means,
        config.num_neighbors,
        gaussian_normals(gaussians),
        gaussians.colors,
        config.normal_weight,
        config.color_weight,
    )
    n, k = neighbors.shape
    values = np.full(n * k, 1.0 / max(k, 1), np.float32)
    return csr_array((values, neighbors.ravel(), np.arange(n + 1) * k), shape=(n, n))


def _landings(
    gaussians: tuple[Gaussians, Gaussians], motions: list[F64], reach_spacings: float
) -> tuple[I64, I64]:
    """Return per state [K+1, N_s]: the other state's Gaussian where each part lands, -1 if none."""
    points = [g.means.astype(np.float64) for g in gaussians]
    trees = [tree_of(p) for p in points]
    found = []
    for state, moves in ((0, motions), (1, [inverse(m) for m in motions])):
        other, kept = trees[1 - state]
        reach = reach_spacings * _spacing(other)
        index = np.stack(
            [other.query(apply(m, points[state]), distance_upper_bound=reach)[1] for m in moves]
        )
        found.append(np.append(kept, -1)[index].astype(np.int64))  # n stands for none
    return found[0], found[1]


def _spacing(tree: cKDTree) -> float:
    """Return the median distance between neighbouring places (infinite for a single one)."""
    if tree.n < 2:
        return float("inf")
    return float(np.median(tree.query(tree.data, k=2)[0][:, 1]))


def _support(landing: I64, other_probs: F32) -> F32:
    """Return [N, K+1] the other state's belief in part k where part k lands; 0 where nothing is."""
    if len(other_probs) == 0:
        return np.zeros(landing.T.shape, np.float32)
    columns = [
        np.where(index >= 0, other_probs[index, part], 0.0) for part, index in enumerate(landing)
    ]
    return np.stack(columns, 1).astype(np.float32)


def _hard_costs(probs: F32, costs: F32, graph: csr_array, config: IdentityConfig) -> F32:
    """Return [N, K+1] the objective's change for Gaussian i taking label k, others fixed."""
    around = graph @ probs + config.floor
    return np.asarray(costs - config.part_weight * np.log(around), np.float32)


def _relabelled(probs: F32, costs: F32, graph: csr_array, config: IdentityConfig, step: int) -> F32:
    """Give every other Gaussian its cheapest label; alternating halves cannot swap for ever."""
    turn = np.arange(len(probs)) % 2 == step % 2
    best = _hard_costs(probs, costs, graph, config).argmin(1)
    return np.where(turn[:, None], _one_hot(best, probs.shape[1]), probs)


def _posterior(
    probs: list[F32],
    unary: list[F32],
    landings: tuple[I64, I64],
    graphs: list[csr_array],
    config: IdentityConfig,
) -> tuple[F32, F32]:
    """Return softmax of the final costs: the label's own share tells how sure it is."""
    final = []
    for s in (0, 1):
        costs = unary[s] - config.cross_weight * _support(landings[s], probs[1 - s])
        final.append(_softmax(-_hard_costs(probs[s], costs, graphs[s], config) / END_TEMPERATURE))
    return final[0], final[1]


def _one_hot(labels: I64, parts: int) -> F32:
    return np.eye(parts, dtype=np.float32)[labels]


def _softmax(logits: NDArray[np.floating]) -> F32:
    shifted = np.exp(logits - logits.max(1, keepdims=True))
    return np.asarray(shifted / shifted.sum(1, keepdims=True))
