"""Rooms of joint positions in which nothing touches, kept for all simulations of its shapes."""

from __future__ import annotations

from threading import Lock

import numpy as np

from part2gs_robotics.model.arrays import F64

Room = tuple[F64, F64, F64]  # origin, even, odd [J]: even @ |q - origin| + odd @ (q - origin) < 1
MOST = 1024  # rooms: looking through them takes a fiftieth of a look with a margin
DEEP = 0.8  # of the way from the middle of a room: nearer its end another look lasts longer


class Rooms:
    """Rooms of one set of shapes; safe to use from many threads."""

    def __init__(self, joints: int) -> None:
        """Know none yet.

        Args:
            joints: J, their number.
        """
        self.count, self.lock = 0, Lock()
        self.origin, self.even, self.odd = np.zeros((3, MOST, joints))

    def add(self, room: Room) -> None:
        """Keep a room, unless there are too many."""
        with self.lock:
            if self.count < MOST:
                k = self.count
                self.origin[k], self.even[k], self.odd[k] = room
                self.count = k + 1  # last: who reads meanwhile sees whole rooms

    def around(self, qpos: F64) -> Room | None:
        """Return the room in which joints [J] lie deepest, None where none reaches far enough."""
        if not (n := self.count):
            return None
        way = qpos - self.origin[:n]
        used = (self.even[:n] * np.abs(way) + self.odd[:n] * way).sum(1)
        k = int(used.argmin())
        return (self.origin[k], self.even[k], self.odd[k]) if used[k] < DEEP else None
