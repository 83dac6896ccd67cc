"""Which bodies of a model its author lets meet: contact bits, excludes, the parent filter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

Pair = tuple[int, int]


def meeting_pairs(model: mujoco.MjModel) -> frozenset[Pair]:
    """Return the pairs of bodies (lower first) that the engine looks for contacts of."""
    geoms: dict[int, list[tuple[int, int]]] = {}
    for g in range(model.ngeom):
        bits = int(model.geom_contype[g]), int(model.geom_conaffinity[g])
        geoms.setdefault(int(model.geom_bodyid[g]), []).append(bits)
    out = {p for p in combinations(sorted(geoms), 2)
           if not _filtered(model, p) and any(a[0] & b[1] or b[0] & a[1]
                                              for a in set(geoms[p[0]]) for b in set(geoms[p[1]]))}
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    out -= {(min(p), max(p)) for p in excluded}
    named = [sorted(int(model.geom_bodyid[g]) for g in (model.pair_geom1[k], model.pair_geom2[k]))
             for k in range(model.npair)]
    return frozenset(out | {(a, b) for a, b in named})


def _filtered(model: mujoco.MjModel, pair: Pair) -> bool:
    """Whether the parent filter, if on, hides a pair: a moving body and what hangs on it."""
    import mujoco

    if int(model.opt.disableflags) & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
        return False
    weld = [int(model.body_weldid[b]) for b in pair]
    up = [int(model.body_weldid[model.body_parentid[w]]) for w in weld]
    return 0 not in weld and (up[0] == weld[1] or up[1] == weld[0])


def keep_apart(spec: mujoco.MjSpec, bases: Sequence[mujoco.MjsBody]) -> None:
    """Exclude contacts between bodies about to lose their free joint and what hangs on them.

    The parent filter hides those while a base floats, not once it stands still.
    """
    for base in bases:
        rigid: list[mujoco.MjsBody] = [base]
        hung: list[mujoco.MjsBody] = []
        for body in rigid:  # grows while it is gone through
            for child in body.bodies:
                (hung if child.joints else rigid).append(child)
        for body in list(hung):
            hung += _rigid_below(body)
        for one in rigid:
            for two in hung:
                if one.name and two.name:
                    spec.add_exclude(bodyname1=one.name, bodyname2=two.name)


def _rigid_below(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    found = [child for child in body.bodies if not child.joints]
    return found + [one for child in found for one in _rigid_below(child)]
