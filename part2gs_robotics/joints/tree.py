"""Tree of moving parts: joints, and the part that carries each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from part2gs_robotics.model.arrays import Labels
from part2gs_robotics.model.joint import Joint, move_of


@dataclass(frozen=True)
class Tree:
    """Joints with what carries them.

    Attributes:
        joints: of parts 1..K, carriers' motions within.  parents: part that carries each, 0 = base.
        hard: [N0 + N1] surfel labels.
        known: of every part, its number in the search on the base, 0 = found since.
    """

    joints: list[Joint]
    parents: tuple[int, ...]
    hard: Labels
    known: tuple[int, ...]


def flat(joints: list[Joint], hard: Labels) -> Tree:
    """Return the tree of parts that all hang on the base."""
    return Tree(joints, (0,) * len(joints), hard, tuple(range(1, len(joints) + 1)))


def ordered(tree: Tree) -> Tree:
    """Return the tree with carriers before what they carry."""
    order = sorted(range(len(tree.joints)), key=lambda k: tree.parents[k] > 0)
    place = np.zeros(len(order) + 1, np.int64)
    place[np.array(order, np.int64) + 1] = np.arange(1, len(order) + 1)
    return Tree([tree.joints[k] for k in order],
                tuple(int(place[tree.parents[k]]) for k in order),
                place[tree.hard], tuple(tree.known[k] for k in order))


def carried(tree: Tree) -> Tree:
    """Return the tree with every carrier's motion as its joint is now."""
    joints = list(tree.joints)
    for k, parent in enumerate(tree.parents):
        if parent:
            joints[k] = replace(joints[k], carrier=move_of(joints[parent - 1]))
    return replace(tree, joints=joints)
