"""Terms of Part2GS on one joint, Gaussians frozen: as printed and corrected, one number each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.model.arrays import F64, Labels
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.paper import losses
from part2gs_robotics.paper.matching import match_hungarian
from part2gs_robotics.paper.repel import repel_forces, repel_points

TERMS = ("articulation", "vector_field", "repel", "velocity", "contact")
ART_WEIGHT, PHYS_WEIGHT, ROT_WEIGHT = 1.0, 0.1, 0.1  # the paper's are unknown; method 1.5
SAMPLE = 1500  # points per part and state: the losses are means, 3 % noise, 20 ms a step
BESIDE = 0.01  # of the diagonal: a surfel speaks for the surface this far beside it
AGREE = 12  # nearest surfels: of 4 to 16, their contact loss ranks measured overlap best, 0.96
SWEEP = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the joint value at which contact is asked
REPEL_VOXEL = 0.01  # diagonals; the paper's strength, a volume, is meant for an object of one unit
REPEL_CLAMP = 0.1  # diagonals; tau_max of the paper


class Base:
    """Signed distance to the static part: inside is what lies behind all surfels near it.

    One surfel alone errs beside edges: a point before one face lies behind the plane of another.
    """

    def __init__(self, points: F64, normals: F64, diag: float) -> None:
        self.points, self.normals, self.diag = points, normals, diag
        self.tree = cKDTree(points)

    def __call__(self, points: Tensor) -> Tensor:
        """Return [...] distances of points [..., 3], negative behind the surface."""
        if len(self.points) == 0:  # no static surface was seen: nothing to touch
            return torch.full_like(points[..., 0], torch.inf)
        count = min(AGREE, len(self.points))
        near, index = self.tree.query(points.detach().numpy(), list(range(1, count + 1)))
        gap = points[..., None, :] - torch.from_numpy(self.points[index])
        along = (gap * torch.from_numpy(self.normals[index])).sum(-1).amax(-1)
        # Far along the tangent the plane of one surfel says nothing: call it free.
        reach = 3.0 * along.detach().abs() + BESIDE * self.diag
        return torch.where(torch.from_numpy(near[..., 0]) > reach, along.abs(), along)


@dataclass(frozen=True)
class Part:
    """What the terms know of one moving part, world frame, scene units.

    Attributes:
        zero: [n, 3] its points in state 0.  one: [m, 3] its points in state 1.
        base: signed distance to the static part.
        repels: [M, 3] repel points.
        pairs: [p, 3] and [p, 3] pairs of eq. 2 that start in the part; printed terms only.
        tau: matching distance.  diag: diagonal of the object.
    """

    zero: F64
    one: F64
    base: Base
    repels: F64
    pairs: tuple[F64, F64]
    tau: float
    diag: float


def terms_on(config: ArticulateConfig) -> tuple[str, ...]:
    """Return the names of the terms that pull on joints."""
    return tuple(name for name in TERMS if getattr(config, name))


def parts_of(study: Study, hard: Labels, count: int, paper: bool) -> list[Part]:
    """Return what the terms need of parts 1..count.

    Args:
        study: both states.
        hard: [N0 + N1] surfel labels.
        count: number of moving parts.
        paper: whether to find the pairs of eq. 2, which takes 2 s.
    """
    n0 = len(study.surfels[0])
    labels = hard[:n0], hard[n0:]
    static = study.surfels[0].select(labels[0] == 0)
    base = Base(static.points, static.normals, study.diag)
    first, second = (s.points for s in study.surfels)
    pairs = match_hungarian(first, second) if paper else np.zeros((0, 2), np.int64)
    parts = []
    for k in range(1, count + 1):
        zero, one = (s.points[own == k] for s, own in zip(study.surfels, labels, strict=True))
        own = pairs[labels[0][pairs[:, 0]] == k]
        seams = [(base.points, _sampled(cloud)) for cloud in (zero, one)]
        # Not thinned: the distance to the nearest point of `one` would be its spacing.
        parts.append(Part(_sampled(zero), one, base, repel_points(seams),
                          (first[own[:, 0]], second[own[:, 1]]), study.tau, study.diag))
    return parts


def _sampled(points: F64) -> F64:
    return points[:: max(1, len(points) // SAMPLE)]


class Pull:
    """The weighted sum of the terms that are on, as a function of the joint."""

    def __init__(self, part: Part, joint: Joint, config: ArticulateConfig) -> None:
        self.part, self.paper = part, config.paper_mode
        self.slides, self.pitch = joint.kind == "prismatic", joint.pitch  # a screw's pitch is held
        self.terms = terms_on(config)
        self.zero, self.one = torch.from_numpy(part.zero), torch.from_numpy(part.one)
        self.tree = cKDTree(part.one)
        there = joint.transform(joint.value)
        gap, index = self.tree.query(part.zero @ there[:3, :3].T + there[:3, 3])
        self.close = torch.from_numpy(gap < part.tau)  # matched once: the spread stays comparable
        self.partners = self.one[torch.from_numpy(index)]

    def __call__(self, axis: Tensor, origin: Tensor, value: Tensor) -> Tensor:
        """Return the loss of a joint: axis [3], origin [3] in scene units, value rad or units."""
        values = self.values(axis, origin, value)
        total = value * 0.0
        for name, loss in values.items():
            plain = name == "articulation" or (name == "vector_field" and not self.paper)
            total = total + (ART_WEIGHT if plain else PHYS_WEIGHT) * loss
        return total

    def values(self, axis: Tensor, origin: Tensor, value: Tensor) -> dict[str, Tensor]:
        """Return every term that is on, unweighted; lengths in diagonals or matching distances."""

        def carried(points: Tensor, shares: tuple[float, ...] = (1.0,)) -> Tensor:
            steps = torch.tensor(shares, dtype=torch.float64) * value
            still = torch.zeros_like(steps)
            turns, slides = (still, steps) if self.slides else (steps, self.pitch * steps)
            return losses.moved_points(points, axis, origin, turns, slides)

        frame = carried(torch.cat([torch.zeros(1, 3), torch.eye(3)]).double())[0]
        move = (frame[1:] - frame[0]).T, frame[0]
        if self.paper:
            return self._printed(*move)
        path = carried(self.zero, SWEEP)
        return {name: self._corrected(name, path, *move) for name in self.terms}

    def _corrected(self, name: str, path: Tensor, rot: Tensor, trans: Tensor) -> Tensor:
        part, sigma = self.part, 0.5 * self.part.tau
        if name == "vector_field":
            eye, none = torch.eye(3).double()[None], torch.zeros(1, 3).double()
            return losses.vector_field_loss(path[-1], self.one, eye, none,
                                            torch.ones(len(self.zero), 1).double(),
                                            losses.Form(sigma=sigma))
        if name == "articulation":
            index = torch.from_numpy(self.tree.query(path[-1].detach().numpy())[1])
            return losses.articulation_loss(rot, trans, (self.zero, self.one[index]),
                                            rot_weight=ROT_WEIGHT, form=losses.Form(sigma=sigma))
        if name == "contact":
            return losses.contact_loss(path, sdf=part.base, margin=sigma) / sigma**2
        if name == "velocity":
            own = self.close
            spread = losses.velocity_loss(self.zero[own], self.partners[own],
                                          torch.ones(int(own.sum()), 1).double(),
                                          rotations=rot[None])
            return spread / sigma**2
        repels = torch.from_numpy(part.repels / part.diag)
        energy = losses.repel_loss(path[-1] / part.diag, repels, REPEL_VOXEL)
        return energy / (sigma / part.diag) ** 2

    def _printed(self, rot: Tensor, trans: Tensor) -> dict[str, Tensor]:
        """Return the terms as printed, lengths in diagonals: their weights have no other unit."""
        diag, trans = self.part.diag, trans / self.part.diag
        first, second = (torch.from_numpy(p) / diag for p in self.part.pairs)
        zero = self.zero / diag
        # Eq. 5 moves every Gaussian after the joint has: y = R x + t + F.
        second = second - self._push(first @ rot.T + trans)
        there = zero @ rot.T + trans
        there = there + self._push(there)
        return {name: self._printed_one(name, rot, trans, (first, second), (zero, there))
                for name in self.terms}

    def _printed_one(self, name: str, rot: Tensor, trans: Tensor, pairs: tuple[Tensor, Tensor],
                     points: tuple[Tensor, Tensor]) -> Tensor:
        if name == "articulation":
            return losses.articulation_loss(rot, trans, pairs, rot_weight=ROT_WEIGHT,
                                            form=losses.Form(paper=True))
        if name == "vector_field":
            ones = torch.ones(len(pairs[0]), 1).double()
            return losses.vector_field_loss(*pairs, rot[None], trans[None], ones,
                                            losses.Form(paper=True))
        if name == "velocity":
            return losses.velocity_loss(*points, torch.ones(len(points[0]), 1).double(), paper=True)
        if name == "contact":
            static = torch.from_numpy(self.part.base.points / self.part.diag)
            return losses.contact_loss(points[1], static_points=static, paper=True)
        return points[1].sum() * 0.0  # repel points act through the other terms

    def _push(self, points: Tensor) -> Tensor:
        """Return [n, 3] displacements by repel points, constant in the gradient; 0 if off."""
        if "repel" not in self.terms:
            return torch.zeros_like(points)
        repels = self.part.repels / self.part.diag
        force = torch.from_numpy(repel_forces(points.detach().numpy(), repels, 1.0, paper=True))
        length = force.norm(dim=-1, keepdim=True)
        return force * (REPEL_CLAMP / length.clamp_min(REPEL_CLAMP))
