"""The device that renders in this process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

Device = Literal["cpu", "cuda"]
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
