"""Buffers that one caller's successive renderings share, so that none allocates memory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from part2gs_robotics.runtime.jit import LINE

ROOM = 1 << 15  # pairs, 0.5 MB: a small view of 14,000 Gaussians has 20,000; it grows as needed


class Workspace:
    """Named buffers that grow and never shrink; what they hold is valid until they are taken again.

    Attributes:
        generation: number of renderings so far; tells whether a rendering's arrays still stand.
        room: pairs of tile and Gaussian that each thread has room to list.
    """

    def __init__(self) -> None:
        self.generation, self.room = 0, ROOM
        self._buffers: dict[str, NDArray[np.uint8]] = {}

    def take(self, name: str, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
        """Return an array of a name, with whatever it held before."""
        dtype = np.dtype(dtype)
        size = math.prod(shape) * dtype.itemsize
        buffer = self._buffers.get(name)
        if buffer is None or len(buffer) < size + LINE:
            # A quarter more than asked for: Gaussians and pairs grow a little with every step.
            buffer = self._buffers[name] = np.zeros(size + size // 4 + LINE, np.uint8)
        start = -buffer.ctypes.data % LINE
        return buffer[start:start + size].view(dtype).reshape(shape)
