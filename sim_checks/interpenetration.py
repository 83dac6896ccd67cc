"""Exact overlap of the true surfaces along every joint, beside the engine's contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.assets.driven import DrivenJoint
from part2gs_robotics.collision.depth import depth
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.solids import FLAKE
from part2gs_robotics.sim_checks.geometry import Overlap, overlap, place
from part2gs_robotics.sim_checks.result import CheckResult, Curve, row
from part2gs_robotics.sim_checks.subject import Subject

if TYPE_CHECKING:
    import mujoco
    from manifold3d import Manifold

SINGLE = 2.0**-23  # of the farthest coordinate: engines keep meshes in single precision
LIMIT = 0.002  # of the size: 2 mm on a metre, the noise of a good reconstruction
OTHERS = 5.0  # x the limit: a shallower overlap in assets of others warns; servos tell if it jams
Pair = tuple[int, int]


@dataclass(frozen=True)
class Worst:
    """The deepest overlap found: where, between whom, how much."""

    volume: float = 0.0
    depth: float = 0.0
    pair: Pair = (-1, -1)
    position: float = 0.0


class Poser:
    """Places bodies for joint positions and compares exact and engine overlap.

    Args:
        subject: the model under test.
    """

    def __init__(self, subject: Subject) -> None:
        """Reserve one data block for all poses."""
        import mujoco

        self.subject = subject
        self.data: mujoco.MjData = mujoco.MjData(subject.model)
        self.solids = {b: s for b, s in subject.solids.items() if s is not None}
        weld = subject.model.body_weldid
        self.pairs = [p for p in combinations(sorted(self.solids), 2) if weld[p[0]] != weld[p[1]]
                      and (subject.pairs is None or p in subject.pairs)]

    def pose(self, qpos: F64) -> None:
        """Move every body and find the engine's contacts."""
        import mujoco

        self.data.qpos[:] = qpos
        mujoco.mj_fwdPosition(self.subject.model, self.data)

    def placed(self, body: int) -> Manifold:
        """Return a body's solid in the world."""
        world_from_body = np.eye(4)
        world_from_body[:3, :3] = self.data.xmat[body].reshape(3, 3)
        world_from_body[:3, 3] = self.data.xpos[body]
        return place(self.solids[body], world_from_body)

    def overlaps(self, pairs: list[Pair]) -> dict[Pair, Overlap]:
        """Return the exact intersection of body pairs that overlap at the current pose."""
        at = {b: self.placed(b) for b in {b for p in pairs for b in p}}
        thin = {b: max(FLAKE * self.subject.size, SINGLE * np.abs(solid.bounding_box()).max())
                for b, solid in at.items() if not solid.is_empty()}
        found = {p: overlap(at[p[0]], at[p[1]], min(thin[p[0]], thin[p[1]]))
                 for p in pairs if thin.keys() >= set(p)}
        return {p: o for p, o in found.items() if o.solid is not None}

    def contact_depth(self, moved: frozenset[int]) -> float:
        """Return the deepest contact between a moved and another body, 0 if none.

        Only bodies with a closed surface count: without one there is nothing to compare with.
        """
        deepest = 0.0
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            bodies = [int(self.subject.model.geom_bodyid[g]) for g in contact.geom]
            closed = all(b in self.solids for b in bodies)
            if closed and len(moved.intersection(bodies)) == 1:
                deepest = max(deepest, -float(contact.dist))
        return deepest


Swept = tuple[Curve, Worst]


def check_interpenetration(
    subject: Subject, sweeps: dict[int, Swept]
) -> tuple[list[CheckResult], list[Curve]]:
    """Return rows and one curve per joint, of their sweeps."""
    rows, curves = [], []
    missing = [subject.body(b) for b, s in subject.solids.items() if s is None]
    if not subject.ours and len(missing) == len(subject.solids) > 1:
        detail = "nothing collides: no overlap to measure"
        rows.append(CheckResult("overlap", "", "warn", detail=detail))
    if missing and subject.ours:
        detail = f"no exact overlap for open meshes: {', '.join(missing)}"
        rows.append(CheckResult("overlap", "", "incomplete", detail=detail))
    for joint in subject.joints:
        curve, deepest = sweeps[joint.index]
        curves.append(curve)
        rows += _joint_rows(subject, joint, curve, deepest)
    return rows, curves


def sweep(poser: Poser, joint: DrivenJoint, steps: int) -> Swept:
    """Return exact overlap and contact depth at evenly spaced positions of one joint."""
    positions = np.linspace(joint.low, joint.high, steps)
    pairs = [p for p in poser.pairs if (p[0] in joint.moved) != (p[1] in joint.moved)]
    volumes, depths, contacts, worst = [], [], [], Worst()
    for q in positions:
        poser.pose(poser.subject.at({joint.qpos: float(q)}, joint))
        found = poser.overlaps(pairs)
        deepest = deepest_of(found, float(q))
        worst = max(worst, deepest, key=lambda w: w.depth)
        volumes.append(sum(o.volume for o in found.values()))
        depths.append(deepest.depth)
        contacts.append(poser.contact_depth(joint.moved))
    curve = Curve(
        joint.name,
        tuple(float(q) for q in positions),
        tuple(volumes),
        tuple(depths),
        tuple(contacts),
    )
    return curve, worst


def deepest_of(found: dict[Pair, Overlap], position: float = 0.0) -> Worst:
    """Return the deepest of some overlaps; only the thickest two are measured exactly."""
    worst = Worst(position=position)
    return max((worst, *measured(found, position)), key=lambda w: w.depth)


def measured(found: dict[Pair, Overlap], position: float = 0.0) -> list[Worst]:
    """Return the exact depths of the thickest two overlaps."""
    thickest = sorted(found, key=lambda p: found[p].thickness, reverse=True)[:2]
    out = []
    for pair in thickest:
        solid = found[pair].solid
        assert solid is not None  # empty overlaps are not kept
        out.append(Worst(found[pair].volume, depth(solid), pair, position))
    return out


def _joint_rows(
    subject: Subject, joint: DrivenJoint, curve: Curve, worst: Worst
) -> list[CheckResult]:
    limit = LIMIT * subject.size
    detail = "no overlap anywhere in the range"
    detail += ", the others at state 1" if joint.index in subject.around else ""
    if worst.volume:
        detail = f"{names(subject, worst.pair)} at {worst.position:.4g} {joint.unit}, "
        detail += f"{worst.volume:.3g} units^3"
    phantom = [
        max(0.0, c - d) for c, d in zip(curve.contact_depth, curve.overlap_depth, strict=True)
    ]
    at = curve.positions[int(np.argmax(phantom))]
    said = f"contact of convex pieces beyond the true surfaces, most at {at:.4g} {joint.unit}"
    return [
        graded(subject, row("overlap", joint.name, worst.depth, limit, "units", detail)),
        row("phantom contact", joint.name, max(phantom), limit, "units", said),
    ]


def graded(subject: Subject, result: CheckResult) -> CheckResult:
    """Return a failure as a warning where a shallow overlap is another author's affair."""
    shallow = (result.value or 0.0) <= OTHERS * LIMIT * subject.size
    mild = result.status == "fail" and not subject.ours and shallow
    return replace(result, status="warn") if mild else result


def names(subject: Subject, pair: Pair) -> str:
    """Return the names of two bodies."""
    return " and ".join(subject.body(b) for b in pair)
