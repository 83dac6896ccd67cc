"""Compile ahead: processes, as many as there are cores, that compile what no build has compiled.

Numba compiles a kernel when it is first called, one at a time in a process: most of a machine's
first build was one core's waiting for it. What a process compiles, others find on disk. Kernels of
late rooms are compiled while the first rooms work, on what these leave idle of the cores.
"""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
import time
from collections import deque
from contextlib import suppress
from typing import IO, cast

from part2gs_robotics.ahead.listed import Kernel, missing
from part2gs_robotics.ahead.worker import IDLE
from part2gs_robotics.runtime.jit_cache import alone_in, kept_in
from part2gs_robotics.runtime.log import Progress, log_stage
from part2gs_robotics.runtime.threads import in_threads

MOST = 4  # processes: each takes up to 355 MB, and a build keeps within 2 GB
WORTH = 3  # kernels: a process takes as long to start as one to compile
LATER = "later"  # folder whose lock tells who compiles for late rooms: a build need not wait for it
logger = logging.getLogger(__name__)
Worker = subprocess.Popen[str]


def compile_ahead() -> int:
    """Compile the kernels of a build that are not kept; returns how many were at once.

    Those of late rooms follow in the background. A kernel that cannot be compiled here is compiled
    where it is called, and fails there.

    Raises:
        ConfigError: NUMBA_CACHE_DIR names a folder that cannot be written.
    """
    done = _lead()
    if any(one.late for one in missing()):
        threading.Thread(target=_follow, daemon=True).start()
    return done


def _lead() -> int:
    """Compile the kernels of early rooms on all cores; returns how many were compiled."""
    if len(_missing(late=False)) < WORTH:
        return 0
    try:
        with alone_in(kept_in()):  # of builds that start together one compiles
            return _compiled(_missing(late=False))
    except OSError as err:  # a full disk
        logger.warning("kernels cannot be compiled ahead in %s (%s): they are compiled where they "
                       "are called", kept_in(), err)
        return 0


def _follow() -> None:
    """Compile the kernels of late rooms in one process that takes what others leave of a core.

    It ends with the thread that asks it, and that with the program.
    """
    with suppress(OSError), alone_in(kept_in() / LATER):  # a full disk: `_lead` has told of it
        _Crew(_missing(late=True)).work(IDLE)


def _missing(late: bool) -> list[Kernel]:
    return [one for one in missing() if one.late == late]


def _compiled(rest: list[Kernel]) -> int:
    """Compile kernels in as many processes as there are cores; returns how many were."""
    if len(rest) < WORTH:
        return 0
    began = time.monotonic()
    logger.info("compiling %d kernels for this machine, once", len(rest))
    crew = _Crew(rest)
    in_threads([crew.work] * min(MOST, len(rest)), stop=crew.stop)
    log_stage("kernels", time.monotonic() - began, f"{crew.done} compiled, kept in {kept_in()}")
    return crew.done


class _Crew:
    """Processes that compile what is left, each asked for one kernel at a time."""

    def __init__(self, rest: list[Kernel]) -> None:
        self.rest, self.total, self.done = deque(rest), len(rest), 0
        self.workers: list[Worker] = []
        self.choosing = threading.Lock()  # two may not look through what is left at once
        self.progress = Progress("compile kernels")

    def work(self, *how: str) -> None:
        """Let one process, told how to, compile as long as kernels are left."""
        if not self.rest:
            return
        command = [sys.executable, "-m", "part2gs_robotics.ahead.worker", *how]
        try:  # a session of its own: an interrupt ends it by `stop`, not by a traceback. Linux
            # shares cores out among sessions first: one that shall give way stays in the build's.
            worker = subprocess.Popen(command, text=True, stdin=subprocess.PIPE,
                                      stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                                      start_new_session=not how)
        except OSError as err:
            logger.warning("no process to compile kernels could be started (%s): they are "
                           "compiled where they are called, which takes longer", err)
            return
        self.workers.append(worker)
        with suppress(BrokenPipeError), worker:  # closing the pipe to one that has ended
            kernel = self._next()
            while kernel and self._compiled(worker, kernel):
                if not how:  # beside others: they tell of theirs
                    self.progress(self.done, self.total)
                kernel = self._next(kernel.module)

    def _next(self, module: str = "") -> Kernel | None:
        """Take a kernel of the same module, whose helpers this process has, else the next one."""
        with self.choosing:
            if not self.rest:
                return None
            kernel = next((one for one in self.rest if one.module == module), self.rest[0])
            self.rest.remove(kernel)
            return kernel

    def _compiled(self, worker: Worker, kernel: Kernel) -> bool:
        """Return whether the process lives on after it was asked for a kernel."""
        asked, answers = cast(IO[str], worker.stdin), cast(IO[str], worker.stdout)  # both pipes
        try:
            print(kernel.line, file=asked, flush=True)
            answer = answers.readline().strip()
        except OSError:
            answer = ""
        if answer == "kept":
            self.done += 1
        else:
            logger.warning("%s of %s was not compiled ahead: %s", kernel.name, kernel.module,
                           answer or "the process that compiles it has ended")
        return bool(answer)

    def stop(self) -> None:
        """End the processes."""
        with self.choosing:
            self.rest.clear()
        for worker in self.workers:
            worker.kill()
