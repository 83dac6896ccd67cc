"""Minimum cut of a sparse graph: which of two things every node does, at the least cost of all.

Trees grow from the sink until they touch what hangs on the source, the path between is filled, and
what it cuts off looks for a new parent (Boykov and Kolmogorov, "An experimental comparison of
min-cut/max-flow algorithms", 2004). Capacities are whole numbers, so a cut is the same on every
machine. A decision takes a thousand and more of them; SciPy's maximum flow takes several times as
long each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import Mask
from part2gs_robotics.runtime.jit import inlined, kernel

Ints = NDArray[np.int32]
Bytes = NDArray[np.int8]
Net = tuple[Ints, Ints, Ints, Ints]  # first arc of every node; node, arc back, capacity of an arc
Trees = tuple[Bytes, Ints, Ints, Ints]  # of every node: tree, arc to its parent, stamp, steps
Line = tuple[Ints, Mask, Ints]  # nodes that may grow: a ring, who waits in it, its two ends
FREE, SOURCE, SINK = 0, 1, 2  # trees
ROOT, ORPHAN, NONE = -1, -2, -3  # in the place of the arc to a parent


def minimum_cut(net: Net, ends: Ints) -> Mask:
    """Return [N] which nodes lie on the sink's side of the least cut with fewest nodes there.

    Args:
        net: first [N + 1] arc of every node, and for every arc its node, the arc back, and its
            capacity; used up.
        ends: [N] capacity from the source, or to the sink below zero; used up.
    """
    taken = np.zeros(len(ends), np.bool_)
    _cut(net, ends, taken)
    return taken


@kernel
def _cut(net: Net, ends: Ints, taken: Mask) -> None:
    """Mark the nodes on the sink's side. Arguments as of `minimum_cut`."""
    count = len(ends)
    trees = (np.zeros(count, np.int8), np.full(count, NONE, np.int32),
             np.zeros(count, np.int32), np.zeros(count, np.int32))
    line = np.zeros(count + 1, np.int32), np.zeros(count, np.bool_), np.zeros(2, np.int32)
    orphans = np.zeros(count + 1, np.int32)
    _planted(ends, trees, line)
    clock, grows = 1, -1
    while True:
        if grows < 0 or trees[0][grows] == FREE:
            grows = _first_of(trees[0], line)
            if grows < 0:
                break
        bridge = _grown(grows, net, trees, line)
        if bridge < 0:
            grows = -1
            continue
        clock += 1
        lost = _filled(bridge, net, trees[1], ends, orphans)
        _adopted(lost, net, trees, line, orphans, clock)
    for i in range(count):
        taken[i] = trees[0][i] == SINK


@inlined
def _planted(ends: Ints, trees: Trees, line: Line) -> None:
    """Make every node beside source or sink a root, and let those of the sink grow.

    The sink's tree alone finds every path: most nodes are beside the source, and far from any cut.
    """
    tree, parent, stamp, steps = trees
    for i in range(len(ends)):
        if ends[i]:
            tree[i] = SOURCE if ends[i] > 0 else SINK
            parent[i], stamp[i], steps[i] = ROOT, 1, 1
            if ends[i] < 0:
                _waits(i, line)


@inlined
def _waits(i: int, line: Line) -> None:
    """Let a node grow later."""
    ring, waiting, marks = line
    if not waiting[i]:
        ring[marks[1]], waiting[i] = i, True
        marks[1] = (marks[1] + 1) % len(ring)


@inlined
def _first_of(tree: Bytes, line: Line) -> int:
    """Return the next node of a tree that may grow, -1 = none does."""
    ring, waiting, marks = line
    while marks[0] != marks[1]:
        i = ring[marks[0]]
        marks[0] = (marks[0] + 1) % len(ring)
        waiting[i] = False
        if tree[i] != FREE:
            return int(i)
    return -1


@inlined
def _left(arc: int, own: int, sister: Ints, cap: Ints) -> int:
    """Return what flows on along an arc away from the root of a tree."""
    return int(cap[arc] if own == SOURCE else cap[sister[arc]])


@inlined
def _grown(i: int, net: Net, trees: Trees, line: Line) -> int:
    """Let a node take its free neighbours; return the arc to the sink's tree if they touch."""
    first, to, sister, cap = net
    tree, parent, stamp, steps = trees
    own = tree[i]
    for arc in range(first[i], first[i + 1]):
        if _left(arc, own, sister, cap) <= 0:
            continue
        j = to[arc]
        if tree[j] == FREE:
            tree[j] = own
            _waits(j, line)
        elif tree[j] != own:
            return int(arc if own == SOURCE else sister[arc])
        elif stamp[j] > stamp[i] or steps[j] <= steps[i]:
            continue  # as near to its root as it would be
        parent[j], stamp[j], steps[j] = sister[arc], stamp[i], steps[i] + 1
    return -1


@inlined
def _filled(bridge: int, net: Net, parent: Ints, ends: Ints, orphans: Ints) -> int:
    """Fill the path through a bridge from source to sink; return how many it makes orphans."""
    _, to, sister, cap = net
    sides = ((to[sister[bridge]], 1), (to[bridge], -1))
    least = cap[bridge]
    for i, sign in sides:
        while parent[i] != ROOT:
            arc = parent[i]
            least = min(least, cap[sister[arc]] if sign > 0 else cap[arc])
            i = to[arc]
        least = min(least, sign * ends[i])
    cap[bridge] -= least
    cap[sister[bridge]] += least
    count = 0
    for i, sign in sides:
        while True:
            arc = parent[i]
            if arc == ROOT:
                ends[i] -= sign * least
                used = ends[i] == 0
            else:
                cap[arc] += sign * least
                cap[sister[arc]] -= sign * least
                used = (cap[sister[arc]] if sign > 0 else cap[arc]) == 0
            if used:
                parent[i], orphans[count] = ORPHAN, i
                count += 1
            if arc == ROOT:
                break
            i = to[arc]
    return count


@inlined
def _adopted(lost: int, net: Net, trees: Trees, line: Line, orphans: Ints, clock: int) -> None:
    """Give every orphan a parent whose root still stands, or set it and its children free."""
    first, to, sister, cap = net
    tree, parent, stamp, steps = trees
    at = 0
    while at < lost:
        i = orphans[at]
        at += 1
        best, fewest = NONE, len(orphans) + 1
        for arc in range(first[i], first[i + 1]):
            if tree[to[arc]] == tree[i] and _left(sister[arc], tree[i], sister, cap) > 0:
                far = _rooted(to[arc], to, parent, stamp, steps, clock)
                if 0 <= far < fewest:
                    best, fewest = arc, far
        if best != NONE:
            parent[i], stamp[i], steps[i] = best, clock, fewest + 1
            continue
        for arc in range(first[i], first[i + 1]):
            j = to[arc]
            if tree[j] == tree[i]:
                if _left(sister[arc], tree[i], sister, cap) > 0:
                    _waits(j, line)
                if parent[j] >= 0 and to[parent[j]] == i:
                    parent[j], orphans[lost] = ORPHAN, j
                    lost += 1
        tree[i], parent[i] = FREE, NONE


@inlined
def _rooted(i: int, to: Ints, parent: Ints, stamp: Ints, steps: Ints, clock: int) -> int:
    """Return how many arcs away the root of i is, -1 = it hangs on an orphan.

    The way is stamped: what was seen to hang on a root in this round needs no second walk.
    """
    far, j = 0, i
    while stamp[j] != clock:
        far += 1
        if parent[j] == ROOT:
            stamp[j], steps[j] = clock, 1
            far -= 1
            break
        if parent[j] < 0:
            return -1
        j = to[parent[j]]
    far += steps[j]
    left, j = far, i
    while stamp[j] != clock:
        stamp[j], steps[j] = clock, left
        left -= 1
        j = to[parent[j]]
    return far
