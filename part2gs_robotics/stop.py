"""Stop: Ctrl-C and a polite kill end a command in one way, wherever they meet it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def stoppable() -> Iterator[Callable[[], bool]]:
    """Let a polite kill take the way of Ctrl-C: locks and temporary files are cleaned up.

    Yields:
        Whether either was asked for. What a callback from C raises is lost, so that something else
        fails later in its place: the compiler of kernels does.
    """
    asked: list[int] = []

    def stop(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    before = {}
    try:
        before[signal.SIGTERM] = signal.signal(signal.SIGTERM, stop)
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else it is not heard
            before[signal.SIGINT] = signal.signal(signal.SIGINT, stop)
    except ValueError:  # not the main thread: whoever started it owns the signals
        pass
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
