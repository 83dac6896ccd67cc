"""Tasks in threads: while a simulation steps or an image is decoded, Python is free for another.

For what uses one core each; `side_by_side` is for tasks that share out the threads of kernels.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")


def in_threads(tasks: Sequence[Callable[[], T]], most: int = 0,
               stop: Callable[[], None] | None = None) -> list[T]:
    """Return what the tasks return, in order.

    Args:
        tasks: that share what they use only to read it; one that changes it takes a copy.
        most: tasks that run at once; 0 = as many as there are cores.
        stop: ends tasks that run, called when one fails or the program is interrupted.
    """
    threads = min(len(tasks), most or _cores())
    if threads < 2:
        return [task() for task in tasks]
    with ThreadPoolExecutor(threads, "task") as pool:
        waiting = [pool.submit(task) for task in tasks]
        try:
            return [one.result() for one in waiting]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # what has not begun never does
            if stop is not None:
                stop()
            raise


def _cores() -> int:
    """Return the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
