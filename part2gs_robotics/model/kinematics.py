"""Kinematics: where every part of a twin is, for given joint positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise, permutations

import numpy as np

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.se3 import inverses
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.model.twin import Part, Twin

MOST_POSES = 160  # poses per sweep; more would step less than half a voxel at 192 voxels
COARSE_POSES = 17  # of a path: enough to measure how long it is
FEWEST_POSES = 21  # the simulator checks measure interpenetration at 21 joint values
ABOVE = 0.4  # of the level way: 22 degrees, how a standing person sees a cupboard
STEEP = 0.3  # of a way: what is less level than that, 17 degrees from upright, has no front
REST = Joint("fixed", np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.0)  # of a part without a joint


def moving_parts(twin: Twin) -> tuple[int, ...]:
    """Return the indices of the parts that have a degree of freedom, in order."""
    return tuple(i for i, p in enumerate(twin.parts) if moves(p))


def moves(part: Part) -> bool:
    """Say whether a part has a degree of freedom."""
    return part.joint is not None and part.joint.kind != "fixed"


def part_transforms(twin: Twin, positions: Sequence[float]) -> list[F64]:
    """Return per part [4, 4] world_at_q_from_world_at_0.

    Args:
        twin: base first, parents before children.
        positions: one per moving part, rad or scene units.
    """
    at = dict(zip(moving_parts(twin), positions, strict=True))
    joints = [part.joint or REST for part in twin.parts[1:]]
    parents = [max(part.parent, 0) for part in twin.parts[1:]]
    values = [at.get(i, 0.0) for i in range(1, len(twin.parts))]
    return [chain(i, joints, parents, values) for i in range(len(twin.parts))]


def at_state_1(twin: Twin) -> list[F64]:
    """Return [V, 3] places of every part's vertices in state 1."""
    return [part.mesh.vertices @ move[:3, :3].T + move[:3, 3]
            for part, move in zip(twin.parts, to_state(twin, 1), strict=True)]


def to_state(twin: Twin, state: int) -> list[F64]:
    """Return per part [4, 4] world_at_a_state_from_world_at_0."""
    values = [joint.value for i in moving_parts(twin) if (joint := twin.parts[i].joint) is not None]
    return part_transforms(twin, [state * value for value in values])


def facing(twin: Twin) -> F64:
    """Return [3] the direction from which to look: where parts have gone to, a little from above.

    Straight where they went where that is up or down.
    """
    places = at_state_1(twin)
    middle = bounds((twin.parts[0].mesh,)).mean(0)
    gone = [(low + high) / 2 - middle
            for low, high in ((place.min(0), place.max(0)) for place in places[1:])]
    way, up = np.mean(gone, 0) if gone else np.ones(3), up_of(twin)
    flat = way - (way @ up) * up
    if np.linalg.norm(flat) > STEEP * np.linalg.norm(way):
        way = flat / np.linalg.norm(flat) + ABOVE * up
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-300))


def up_of(twin: Twin) -> F64:
    """Return [3] up as known, else as exporters assume it."""
    return np.array([0.0, 0.0, 1.0]) if twin.up is None else twin.up


def subtree(twin: Twin, index: int) -> tuple[int, ...]:
    """Return the part and everything it carries."""
    carried = {index}
    for i, part in enumerate(twin.parts):
        if part.parent in carried:
            carried.add(i)
    return tuple(sorted(carried))


def children(twin: Twin, index: int) -> tuple[int, ...]:
    """Return the parts directly carried by a part."""
    return tuple(i for i, p in enumerate(twin.parts) if p.parent == index)


def chain(part: int, joints: Sequence[Joint], parents: Sequence[int],
          positions: Sequence[float] | F64) -> F64:
    """Return [4, 4] world_at_q_from_world_at_0 of a part, carried by its parents.

    world_q_from_0(child) = world_q_from_0(parent) joint(q).

    Args:
        part: 0 = base.
        joints: of parts 1..K.
        parents: parent part of parts 1..K.
        positions: joint positions of parts 1..K.
    """
    return chains(part, joints, parents, np.asarray(positions, np.float64)[None])[0]


def chains(part: int, joints: Sequence[Joint], parents: Sequence[int], positions: F64) -> F64:
    """Return [P, 4, 4] `chain` of [P, K] joint positions."""
    out = np.tile(np.eye(4), (len(positions), 1, 1))
    while part > 0:
        out = joints[part - 1].transforms(positions[:, part - 1]) @ out
        part = parents[part - 1]
    return out


def ancestors(part: int, parents: Sequence[int]) -> list[int]:
    """Return the part and the moving parts that carry it, innermost first."""
    out = []
    while part > 0:
        out.append(part)
        part = parents[part - 1]
    return out


def sweep(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
          corners: F64, step: float) -> F64:
    """Return the poses of all `ways`, one after the other: [P, 4, 4] part_from_carrier."""
    return np.concatenate(ways(part, carrier, joints, parents, corners, step))


def ways(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
         corners: F64, step: float) -> list[F64]:
    """Return ways [P, 4, 4] part_from_carrier: a point of the carrier's frame in the moving part's.

    Every joint of either chain runs through its range with the others at state 0 and at state 1,
    and all of them together from state 0 to state 1.

    Args:
        part: the part that sweeps.
        carrier: the part that is swept.
        joints: of parts 1..K.
        parents: of parts 1..K.
        corners: [8, 3] box of the sweeping part, to bound how far it moves.
        step: no corner may move further between two poses, scene units.
    """
    values = np.array([j.value for j in joints])
    involved = sorted(set(ancestors(part, parents)) ^ set(ancestors(carrier, parents)))
    paths = [(np.zeros(len(joints)), values)]
    if len(involved) > 1:
        for mover in involved:
            for others in (np.zeros(len(joints)), values):
                start, end = others.copy(), others.copy()
                start[mover - 1], end[mover - 1] = 0.0, values[mover - 1]
                paths.append((start, end))
    seen = _seen_from(part, carrier, joints, parents)
    return [_along(seen, path, corners, step) for path in paths]


def orders(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
           corners: F64, step: float) -> list[F64]:
    """Return ways from state 0 to state 1: all joints at once, and one by one in every order.

    Args: see `ways`.
    """
    values = np.array([j.value for j in joints])
    involved = sorted(set(ancestors(part, parents)) ^ set(ancestors(carrier, parents)))
    seen, out = _seen_from(part, carrier, joints, parents), list[F64]()
    for turns in [[involved], *([[n] for n in row] for row in permutations(involved))]:
        nodes = [np.zeros(len(joints))]
        for movers in turns:
            nodes.append(np.where(np.isin(np.arange(len(joints)) + 1, movers), values, nodes[-1]))
        out.append(np.concatenate([_along(seen, path, corners, step)
                                   for path in pairwise(nodes)]))
    return out if len(involved) > 1 else out[:1]


def _seen_from(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
               ) -> Callable[[F64], F64]:
    """Return what makes [P, K] joint positions poses [P, 4, 4] part_from_carrier."""
    def relative(q: F64) -> F64:
        return np.asarray(inverses(chains(part, joints, parents, q))
                          @ chains(carrier, joints, parents, q))

    return relative


def _along(seen: Callable[[F64], F64], path: tuple[F64, F64], corners: F64, step: float) -> F64:
    """Return poses [P, 4, 4] on the straight way between two joint positions."""
    def relative(count: int) -> F64:
        return seen(path[0] + np.linspace(0, 1, count)[:, None] * (path[1] - path[0]))

    return relative(_pose_count(relative, corners, step))


def both_ways(part: int, carrier: int, joints: Sequence[Joint], parents: Sequence[int],
              corners: F64, step: float) -> list[F64]:
    """Return the poses [4, 4, 4] part_from_carrier at the corners of every stride of two joints.

    Where one of them slides, what lies between the four corners is what the part sweeps however
    far the slide is out. Empty unless exactly two joints lie between the parts and one slides.

    Args: see `ways`.
    """
    involved = sorted(set(ancestors(part, parents)) ^ set(ancestors(carrier, parents)),
                      key=lambda n: joints[n - 1].turns)
    if len(involved) != 2 or joints[involved[0] - 1].turns:
        return []
    slide, other = involved
    values = np.array([j.value for j in joints])

    def relative(count: int, out: float) -> F64:
        q = np.zeros((count, len(joints)))
        q[:, slide - 1] = out * values[slide - 1]
        q[:, other - 1] = np.linspace(0, 1, count) * values[other - 1]
        return np.asarray(inverses(chains(part, joints, parents, q))
                          @ chains(carrier, joints, parents, q))

    if not joints[other - 1].turns:
        return [np.concatenate([relative(2, 0.0), relative(2, 1.0)])]
    count = max(_pose_count(partial(relative, out=out), corners, step) for out in (0.0, 1.0))
    ends = np.stack([relative(count, 0.0), relative(count, 1.0)], 1)
    return [ends[i : i + 2].reshape(4, 4, 4) for i in range(count - 1)]


def _pose_count(relative: Callable[[int], F64], corners: F64, step: float) -> int:
    """Return how many poses keep every corner's move below a step."""
    coarse = inverses(relative(COARSE_POSES))
    path = np.einsum("pij,nj->pni", coarse[:, :3, :3], corners) + coarse[:, None, :3, 3]
    longest = float(np.linalg.norm(np.diff(path, axis=0), axis=2).sum(0).max())
    return int(np.clip(np.ceil(longest / step) + 1, FEWEST_POSES, MOST_POSES))


def part_motions(joints: Sequence[Joint], parents: Sequence[int] | None = None) -> list[F64]:
    """Return K+1 [4, 4] state1_from_state0 in the world; the base first, chains composed."""
    parents = [0] * len(joints) if parents is None else parents
    values = [joint.value for joint in joints]
    return [chain(part, joints, parents, values) for part in range(len(joints) + 1)]
