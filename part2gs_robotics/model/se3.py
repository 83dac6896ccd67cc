"""Rigid motions in float64: exponential, logarithm, screws."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64

SMALL_ANGLE = 1e-6  # below: Taylor series, whose next term is < 1e-13, float64's own error
SHORT = 1e-16  # of a quaternion: the squares of shorter ones lose digits in float32


def hat(w: F64) -> F64:
    """Return the [3, 3] cross-product matrix of w."""
    x, y, z = w
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_from_rotvec(w: F64) -> F64:
    """Return the [3, 3] rotation exp(hat(w)), w in radians (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    k = hat(np.asarray(w, float))
    if angle < SMALL_ANGLE:
        return np.eye(3) + k + 0.5 * k @ k
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * k @ k


def rotvec_from_rotation(rot: F64) -> F64:
    """Return w with exp(hat(w)) = rot, |w| <= pi; exact near 0 and near pi."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(rot).as_rotvec(), float)


def turn(motion: F64) -> float:
    """Return by how many radians, 0 to pi, a [4, 4] rigid motion turns."""
    return float(np.linalg.norm(rotvec_from_rotation(motion[:3, :3])))


def make(rot: F64, trans: F64) -> F64:
    """Return the [4, 4] rigid motion x -> rot x + trans."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rot, trans
    return out


def inverse(a_from_b: F64) -> F64:
    """Return b_from_a of a [4, 4] rigid motion."""
    rot = a_from_b[:3, :3].T
    return make(rot, -rot @ a_from_b[:3, 3])


def apply(a_from_b: F64, points: F64) -> F64:
    """Map [..., 3] points from frame b to frame a."""
    return np.asarray(points @ a_from_b[:3, :3].T + a_from_b[:3, 3])


def screw_motion(axis: F64, origin: F64, turn: float, slide: float) -> F64:
    """Return [4, 4]: turn (rad) about the line (origin, axis), then slide along it."""
    axis = np.asarray(axis, float)
    rot = rotation_from_rotvec(axis * turn)
    origin = np.asarray(origin, float)
    return make(rot, origin - rot @ origin + slide * axis)


def screw_motions(axis: F64, origin: F64, turns: F64, slides: F64) -> F64:
    """Return [P, 4, 4]: `screw_motion` of a unit axis for [P] turns (rad) and slides."""
    axis, origin = np.asarray(axis, float), np.asarray(origin, float)
    k, out = hat(axis), np.tile(np.eye(4), (len(turns), 1, 1))
    sine, rest = np.sin(turns)[:, None, None], (1 - np.cos(turns))[:, None, None]
    out[:, :3, :3] += sine * k + rest * (k @ k)
    out[:, :3, 3] = origin - out[:, :3, :3] @ origin + np.asarray(slides)[:, None] * axis
    return out


def inverses(moves: F64) -> F64:
    """Return the inverses of [P, 4, 4] rigid motions."""
    out = np.tile(np.eye(4), (len(moves), 1, 1))
    out[:, :3, :3] = moves[:, :3, :3].transpose(0, 2, 1)
    out[:, :3, 3] = -np.einsum("pij,pj->pi", out[:, :3, :3], moves[:, :3, 3])
    return out


def screw_of(motion: F64, near: F64, least: float = SMALL_ANGLE,
             ) -> tuple[F64, F64, float, float]:
    """Return (axis, origin, turn, slide) of a [4, 4] motion; screw_motion makes it again.

    Args:
        motion: rigid.
        near: [3] point beside which the origin lies; the origin of a motion without a turn.
        least: rad; a smaller turn is none, and the motion the slide of `near`.

    Returns:
        Unit axis, [3] origin, turn in [0, pi], slide along the axis; of no turn at all the axis
        is the way, and zeros where nothing moves.
    """
    rotvec = rotvec_from_rotation(motion[:3, :3])
    turn, way = float(np.linalg.norm(rotvec)), apply(motion, near) - near
    if turn < least:
        length = float(np.linalg.norm(way))
        return (way / length if length else way), near, 0.0, length
    axis = rotvec / turn
    slide = float(axis @ way)
    across = way - slide * axis
    return axis, near + 0.5 * (across + np.cross(axis, across) / np.tan(0.5 * turn)), turn, slide


def quat_from_rotation(rot: F64) -> F64:
    """Return the unit quaternion wxyz, w >= 0, of a [3, 3] rotation."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rot).as_quat()
    return np.array([w, x, y, z]) * (1.0 if w >= 0 else -1.0)


def unit_quats(quats: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return [..., 4] unit quaternions; one shorter than SHORT has no direction: identity."""
    norm = np.linalg.norm(quats, axis=-1, keepdims=True)
    unit = quats / np.maximum(norm, quats.dtype.type(SHORT))
    return np.where(norm > SHORT, unit, np.array([1, 0, 0, 0], quats.dtype))


def rotation_from_quats(quats: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return [N, 3, 3] rotations of [N, 4] quaternions wxyz (normalised here)."""
    w, x, y, z = np.moveaxis(unit_quats(quats), -1, 0)
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return np.stack(rows, -1).reshape(*quats.shape[:-1], 3, 3)


def quat_multiply(a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the product a b of quaternions wxyz, [..., 4], broadcasting."""
    aw, ax, ay, az = np.moveaxis(a, -1, 0)
    bw, bx, by, bz = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        -1,
    )
