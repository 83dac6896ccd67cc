"""A room drawn ray by ray: a table with a pattern, boxes on it, papered walls, known cameras."""

from __future__ import annotations

import cv2
import numpy as np

SIZE, FOCAL = (480, 360), 420.0
K = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1.0]])
TABLE = 1.1  # half its side; the world stands on it, z up
WALL = 4.0  # half the room's side
# Boxes (lo, hi, colour, share of pattern) in a frame of their own.
BODY = ((-0.3, -0.25, 0.0), (0.3, 0.2, 0.4), (70, 90, 160), 0.25)
DOOR = ((0.0, -0.03, 0.02), (0.6, 0.0, 0.38), (170, 60, 60), 0.9)
HINGE = np.array([-0.3, -0.25, 0.0])


def pattern(seed: int, side: int = 1024) -> np.ndarray:
    """Return [S, S] noise of many sizes, mean 0, deviation 1."""
    rng, out = np.random.default_rng(seed), np.zeros((side, side), np.float32)
    for level in range(3, 10):
        grid = rng.normal(size=(2**level, 2**level)).astype(np.float32)
        out += cv2.resize(grid, (side, side), interpolation=cv2.INTER_CUBIC) * 0.8**level
    return out / out.std()


def door_pose(angle: float) -> np.ndarray:
    """Return world_from_door of a door opened by an angle about its upright hinge."""
    c, s = np.cos(-angle), np.sin(-angle)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]], HINGE
    return out


def walk(count: int, seed: int, radius: float = 1.7) -> np.ndarray:
    """Return camera_from_world [V, 4, 4] of two rounds about the table's middle."""
    rng, out = np.random.default_rng(seed), []
    for i in range(count):
        turn = 4 * np.pi * i / count + rng.normal(0, 0.02) + seed
        rise = np.deg2rad(22 if i < count // 2 else 45) + rng.normal(0, 0.03)
        eye = radius * np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn),
                                 np.sin(rise)])
        ahead = np.array([0, 0, 0.18]) + rng.normal(0, 0.02, 3) - eye
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], 1)
        pose[:3, 3] = eye
        out.append(np.linalg.inv(pose))
    return np.stack(out)


def photograph(viewmat: np.ndarray, boxes: list, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return a photo [H, W, 3] uint8 and the true mask of the boxes [H, W] bool.

    Args:
        viewmat: camera_from_world.
        boxes: (box, world_from_box) as BODY with a pose.
        seed: of the noise.
    """
    y, x = np.mgrid[0:SIZE[1], 0:SIZE[0]] + 0.5
    pose = np.linalg.inv(viewmat)
    rays = np.stack([(x - K[0, 2]) / FOCAL, (y - K[1, 2]) / FOCAL, np.ones_like(x)], -1)
    rays = (rays @ pose[:3, :3].T).reshape(-1, 3)
    eye = pose[:3, 3]
    color, far = _walls(eye, rays)
    reach = np.where(rays[:, 2] < 0, -eye[2] / np.minimum(rays[:, 2], -1e-9), np.inf)
    at = eye + np.where(np.isfinite(reach), reach, 0)[:, None] * rays
    on = np.isfinite(reach) & (np.abs(at[:, :2]) < TABLE).all(1) & (reach < far)
    color[on] = _paint(at[on][:, :2] / (2 * TABLE) + 0.5, (150, 120, 80), 0.2, 1)
    far = np.where(on, reach, far)
    mask = np.zeros(len(rays), bool)
    for number, (box, place) in enumerate(boxes):
        near, where, face = _box(eye, rays, box, place)
        hit = near < far
        shade = np.array([0.75, 0.9, 1.0])[face[hit]]
        paint = _paint(where[hit], box[2], box[3], 2 + number, face[hit])
        color[hit], far = paint * shade[:, None], np.minimum(near, far)
        mask |= hit
    noise = np.random.default_rng(seed).normal(0, 2.0, color.shape)
    shape = SIZE[1], SIZE[0]
    return (np.clip(color + noise, 0, 255).astype(np.uint8).reshape(*shape, 3),
            mask.reshape(shape))


PATTERNS = [pattern(seed) for seed in range(10)]


def _paint(uv: np.ndarray, base: tuple, contrast: float, which: int,
           face: np.ndarray | None = None) -> np.ndarray:
    """Return colours [N, 3] of a base colour with a pattern at uv of 0..1, another per face."""
    shift = 0 if face is None else 317 * (face + which)
    picture = PATTERNS[which % len(PATTERNS)]
    i, j = (np.floor(uv * 1023).astype(int) + np.atleast_1d(shift)[:, None]).T % 1024
    return np.array(base) * np.exp(contrast * picture[i, j])[:, None]


def _walls(eye: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return colours of the room's six sides and how far they are."""
    with np.errstate(divide="ignore"):
        steps = np.where(rays > 0, (WALL - eye) / rays, (-WALL - eye) / rays)
    side = steps.argmin(1)
    far = steps.min(1)
    at = eye + far[:, None] * rays
    across = np.stack([np.take_along_axis(at, ((side + k) % 3)[:, None], 1)[:, 0]
                       for k in (1, 2)], 1) / (2 * WALL) + 0.5
    turned = 2 * side + (np.take_along_axis(at, side[:, None], 1)[:, 0] > 0)
    color = np.zeros((len(rays), 3))
    for wall in range(6):  # no two walls alike: cameras are lost between alike ones
        here = turned == wall
        color[here] = _paint(across[here], (120, 118, 105), 0.3, 4 + wall)
    return color, far


def _box(eye: np.ndarray, rays: np.ndarray, box: tuple, place: np.ndarray,
         ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how far a box is along rays (inf: missed), where on its face, and which axis."""
    back = np.linalg.inv(place)
    start, along = eye @ back[:3, :3].T + back[:3, 3], rays @ back[:3, :3].T
    with np.errstate(divide="ignore"):
        a, b = (np.array(box[0]) - start) / along, (np.array(box[1]) - start) / along
    first, last = np.minimum(a, b), np.maximum(a, b)
    face, near = first.argmax(1), first.max(1)
    near = np.where((near < last.min(1)) & (near > 0), near, np.inf)
    at = start + np.where(np.isfinite(near), near, 0)[:, None] * along
    other = np.stack([np.take_along_axis(at, ((face + k) % 3)[:, None], 1)[:, 0]
                      for k in (1, 2)], 1)
    return near, other, face


def two_states(count: int, body: tuple = BODY, door: tuple = DOOR,
               angles: tuple[float, float] = (0.1, 1.2)) -> tuple[list, list, list]:
    """Return per state: photos, true masks and camera_from_world."""
    photos, masks, views = [], [], []
    for state in (0, 1):
        boxes = [(body, np.eye(4)), (door, door_pose(angles[state]))]
        views.append(walk(count, state))
        shots = [photograph(view, boxes, i) for i, view in enumerate(views[-1])]
        photos.append([rgb for rgb, _ in shots])
        masks.append([mask for _, mask in shots])
    return photos, masks, views
