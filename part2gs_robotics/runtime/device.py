"""What this process holds: the device that renders, and memory of rooms that are left."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

Device = Literal["cpu", "cuda"]
APART = 4 << 20  # bytes: images of a step and shorter stay in the heap, where they cost no pages
MMAP_THRESHOLD = -3  # what glibc calls `APART`, in <malloc.h>
_device: ContextVar[Device] = ContextVar("device", default="cpu")


def current_device() -> Device:
    """Return the device that renders now; the CPU outside of rendering_on."""
    return _device.get()


@contextmanager
def rendering_on(device: Device) -> Iterator[None]:
    """Render on a device inside the block."""
    token = _device.set(device)
    try:
        yield
    finally:
        _device.reset(token)


def give_back() -> None:
    """Give memory that a room has freed back to the system; where the C library can, glibc's.

    glibc keeps freed arrays of up to 32 MB for the next of that size, and what lies between them
    keeps their pages. From here on grids and maps of a state go as soon as they are freed.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt") and hasattr(library, "malloc_trim"):
        library.mallopt(MMAP_THRESHOLD, APART)
        library.malloc_trim(0)
