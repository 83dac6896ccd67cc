"""Tasks side by side: where kernels are too short to be worth two threads, whole tasks are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

import numba

from part2gs_robotics.runtime.device import current_device

T = TypeVar("T")
SAFE = "tbb", "omp"  # layers of Numba that take kernels from several threads; workqueue aborts


def side_by_side(tasks: Sequence[Callable[[], T]]) -> list[T]:
    """Return what the tasks return, in order; each runs its kernels on its share of the threads.

    A kernel of a millisecond gains little by a second thread, and between kernels there is none.
    Kernels give the same bits on any number of threads, so tasks do.

    Args:
        tasks: that do not wait for each other. One that runs tasks itself runs them in turn.
    """
    total = numba.get_num_threads()
    threads = min(total, len(tasks))
    if threads < 2 or current_device() == "cuda" or _layer() not in SAFE:
        return [task() for task in tasks]
    # Threads start without the caller's context, which holds the device.
    ready = [(copy_context(), task) for task in tasks]
    share = total // threads
    with ThreadPoolExecutor(threads, "task", numba.set_num_threads, (share,)) as pool:
        return list(pool.map(lambda pair: pair[0].run(pair[1]), ready))


def _layer() -> str:
    """Return the threading layer of Numba; empty while no kernel has run yet."""
    try:
        return str(numba.threading_layer())
    except ValueError:
        return ""
