"""True stops of hinges: where true meshes meet beyond both observed states, beside derived limits.

True meshes are open and cut each other, so nothing is said of solids: points spread over the part
are turned on their circles until they reach a triangle of anything else, and the other way round.
What is near the other surface where it was seen (hinges, seals) counts as meeting already. The stop
is the angle at which a small share of the part's surface has gone deeper than a hair.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from geometry_kit import Case, sampled

COUNT = 15_000  # points of either side
NEAR = 0.005  # of the size: meets already where it was seen
DEEP = 0.001  # of the size: as deep as a point must get behind what it reached
SHARE = 1e-3  # of the part's surface that is this deep where it stops: a strip, not a stray face
SHARPER, BLUNTER = 3e-4, 5e-3  # other shares: a stop is sharp if both tell the same angle
WITHIN = 1.5  # degrees: angles alike
TINY = 1e-12  # square of a sine: a plane as level as that is met edge on


@dataclass(frozen=True)
class Stop:
    """One end of a hinge's way; angles in degrees beyond the observed state there.

    Attributes:
        joint: of the data set.  end: 0 = beyond state 0, 1 = beyond state 1.
        limit: of the data set's model.  mesh: where true meshes meet, inf if they do not.
        sharp: whether the angle hardly depends on how much must meet.
        room: how far it may go until the whole way is 180 degrees.
        found: derived for the twin; None without the part.
    """

    joint: str
    end: int
    limit: float
    mesh: float
    sharp: bool
    room: float
    found: float | None = None

    @property
    def kind(self) -> str | None:
        """Who tells the stop: the data set where its meshes show it, else the meshes alone."""
        if not self.mesh <= self.room or self.mesh < WITHIN:
            return None
        if abs(self.mesh - self.limit) <= WITHIN:
            return "limit"
        return "mesh" if self.sharp else None

    @property
    def error(self) -> float | None:
        """How far the derived end is from the true one, outward positive."""
        true = {"limit": self.limit, "mesh": self.mesh}.get(self.kind or "")
        return None if true is None or self.found is None else self.found - true

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        found = {name: None if value is None or not np.isfinite(value) else round(float(value), 2)
                 for name, value in (("limit", self.limit), ("mesh", self.mesh),
                                     ("found", self.found), ("error", self.error))}
        return {"joint": self.joint, "end": self.end, "kind": self.kind, **found}


def stops(case: Case) -> dict[str, Any]:
    """Return every end of every hinge of an object."""
    return {"stops": [stop.to_dict() for stop in all_stops(case)]}


def all_stops(case: Case, twin: Any = None) -> list[Stop]:
    """Return every end of every hinge, with what a twin (the exported one) has there."""
    out = []
    names = [row.get("twin_part") for row in case.score["parts"]]
    for index, true in enumerate(case.true.parts, 1):
        if true["type"] == "prismatic":
            continue
        ways = derived(twin or case.twin, names[index - 1])
        limits = data_set_limits(case, true)
        room = 180.0 - np.rad2deg(true["motion"])
        for end in (0, 1):
            mesh, sharp = true_stop(case, index, end)
            out.append(Stop(true["joint"], end, limits[end], mesh, sharp, room,
                            None if ways is None else ways[end]))
    return out


def derived(twin: Any, name: str | None) -> tuple[float, float] | None:
    """Return how far a part of the twin goes beyond state 0 and state 1, degrees."""
    for part in twin.parts:
        if part.name == name and part.joint.turns:
            low, high = np.rad2deg(part.limits)
            value = np.rad2deg(part.joint.value)
            return (-low, high - value) if value >= 0 else (high, value - low)
    return None


def data_set_limits(case: Case, true: dict[str, Any]) -> tuple[float, float]:
    """Return how far the data set's own model lets a hinge go beyond both states, degrees."""
    low, high = np.rad2deg(joint_range(case, true))
    first, last = np.rad2deg(true["q"])
    return (first - low, high - last) if last >= first else (high - first, last - low)


def joint_range(case: Case, true: dict[str, Any]) -> tuple[float, float]:
    """Return the range of a joint in the data set's own model, in the numbers of its states."""
    import mujoco

    path = case.kit / "objects" / case.true.info["object"] / "model.xml"
    model = mujoco.MjModel.from_xml_path(str(path))
    joint = model.joint(true["joint"])
    low, high = joint.range if model.jnt_limited[joint.id] else (-np.inf, np.inf)
    return float(low), float(high)


def true_stop(case: Case, index: int, end: int) -> tuple[float, bool]:
    """Return where true meshes meet beyond a state, degrees, and whether that is sharp."""
    parts = case.true.parts
    carried = {index}
    for child, part in enumerate(parts, 1):
        carried |= {child} if part["parent"] in carried else set()
    axis, origin = (np.array(parts[index - 1][key], float) for key in ("axis", "point"))
    if end and parts[index - 1]["parent"]:
        axis, origin = at_state_1(case, parts[index - 1]["parent"], axis, origin)
    turn = frame(axis)

    def triangles(kinds: list[int]) -> np.ndarray:
        meshes = [case.true.mesh(k, end) for k in kinds]
        return np.concatenate([((v - origin) @ turn.T)[f] for v, f in meshes])

    others = [k for k in range(len(parts) + 1) if k not in carried]
    angles = meeting(triangles(sorted(carried)), triangles(others), 1 if end else -1,
                     case.true.diag, (SHARPER, SHARE, BLUNTER))
    return angles[1], bool(angles[2] - angles[0] <= WITHIN)


def at_state_1(case: Case, parent: int, axis: np.ndarray,
               origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a hinge line where the part that carries it stands in state 1."""
    before, after = (case.true.mesh(parent, s)[0] for s in (0, 1))
    middle = before.mean(0), after.mean(0)
    u, _, vt = np.linalg.svd((before - middle[0]).T @ (after - middle[1]))
    turn = vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))]) @ u.T
    return turn @ axis, turn @ (origin - middle[0]) + middle[1]


def frame(axis: np.ndarray) -> np.ndarray:
    """Return a rotation that brings an axis to z."""
    up = axis / np.linalg.norm(axis)
    side = np.cross(np.eye(3)[np.argmin(np.abs(up))], up)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(up, side), up])


def meeting(part: np.ndarray, rest: np.ndarray, sign: int, size: float,
            shares: tuple[float, ...] = (SHARE,)) -> list[float]:
    """Return the angles, degrees, at which shares of a part that turns about z have met the rest.

    Args:
        part: [T, 3, 3] triangles that turn about the z axis.
        rest: [U, 3, 3] triangles that stand.
        sign: +1 counterclockwise, -1 clockwise.
        size: of the whole object, scene units.
        shares: of the part's surface.
    """
    from scipy.spatial import cKDTree

    sides = [sampled(t.reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3), COUNT, k)[0]
             for k, t in enumerate((part, rest))]
    areas = [float(np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum())
             for t in (part, rest)]
    met, weight = [], []
    for own, other, against, way in ((0, 1, rest, sign), (1, 0, part, -sign)):
        points = sides[own]
        points = points[cKDTree(sides[other]).query(points)[0] > NEAR * size]
        points = points[np.argsort(points[:, 2])]
        angle = first_hits(points, np.ascontiguousarray(against), float(way))
        there = np.isfinite(angle)
        radius = np.hypot(points[there, 0], points[there, 1])
        met.append(angle[there] + DEEP * size / np.maximum(radius, DEEP * size))
        weight.append(np.full(len(met[-1]), areas[own] / COUNT / areas[0]))
    angles, weights = np.concatenate(met), np.concatenate(weight)
    order = np.argsort(angles)
    summed = np.cumsum(weights[order])
    places = np.searchsorted(summed, shares)
    return [float(np.rad2deg(angles[order[k]])) if k < len(order) else np.inf for k in places]


@numba.njit(cache=False)
def first_hits(points: np.ndarray, triangles: np.ndarray, sign: float) -> np.ndarray:
    """Return the angle by which every point turns about z until it meets a triangle; inf if never.

    Args:
        points: [N, 3], in the order of z.
        triangles: [T, 3, 3].
        sign: +1 counterclockwise, -1 clockwise.
    """
    out = np.full(len(points), np.inf)
    radius = np.hypot(points[:, 0], points[:, 1])
    own = np.arctan2(points[:, 1], points[:, 0])
    height = np.ascontiguousarray(points[:, 2])
    for t in range(len(triangles)):
        a = triangles[t, 0]
        one, two = triangles[t, 1] - a, triangles[t, 2] - a
        normal = np.cross(one, two)
        level = np.hypot(normal[0], normal[1])
        if level * level <= TINY * (normal**2).sum():
            continue  # a circle lies in its plane or never meets it
        offset, phase = (normal * a).sum(), np.arctan2(normal[1], normal[0])
        aa, ab, bb = (one * one).sum(), (one * two).sum(), (two * two).sum()
        rest = aa * bb - ab * ab
        z = triangles[t, :, 2]
        first, last = np.searchsorted(height, z.min()), np.searchsorted(height, z.max(), "right")
        for i in range(first, last):
            along = (offset - normal[2] * height[i]) / level
            if abs(along) > radius[i]:
                continue
            swing = np.arccos(along / radius[i])
            for side in (-1.0, 1.0):
                angle = phase + side * swing
                x, y = radius[i] * np.cos(angle) - a[0], radius[i] * np.sin(angle) - a[1]
                h = height[i] - a[2]
                p = x * one[0] + y * one[1] + h * one[2]
                q = x * two[0] + y * two[1] + h * two[2]
                v, w = (bb * p - ab * q) / rest, (aa * q - ab * p) / rest
                turned = (sign * (angle - own[i])) % (2 * np.pi)
                if v >= 0 and w >= 0 and v + w <= 1 and turned < out[i]:
                    out[i] = turned
    return out
