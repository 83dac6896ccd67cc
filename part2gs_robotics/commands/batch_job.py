"""One scene of many, built by a child process; tried again where not the scene failed."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, cast

from part2gs_robotics.runtime.atomic import write_text_atomic

Outcome = Literal["built", "built, checks fail", "refused", "failed"]

BUILT, CHECKS_FAIL, REFUSED = 0, 1, 2  # exit codes of `build`
LOCKED = "another build is running here"  # of a child that outlived its worker for a moment
LOCK_WAIT = 5.0  # seconds until its lock is tried again; it was told to stop
LOCK_TRIES = 24  # two minutes: a child that was told to stop ends its step first
TAIL = 2000  # characters of what a failed build said that are kept
PR_SET_PDEATHSIG = 1  # prctl(2): the signal a child gets when its parent dies


@dataclass(frozen=True)
class Job:
    """What a worker is told.

    Attributes:
        name: of the scene and of its folder among the twins.
        scene: its folder.
        out: folder of its twin.
        record: file its row is written to.
        key: hash of what it depends on.
        words: flags for `build`.
        retries: how often a build that was killed or broke is tried again.
        threads: a build may use.
    """

    name: str
    scene: str
    out: str
    record: str
    key: str
    words: tuple[str, ...] = ()
    retries: int = 2
    threads: int = 1


@dataclass(frozen=True)
class Row:
    """What became of a scene.

    Attributes:
        name, scene, out, key: as in its job.
        outcome: in words.
        code: exit code of the last try; negative = the signal that ended it.
        tries: builds that were started in this batch.
        seconds: of all tries.
        parts: moving parts found.
        failing: names of failing checks.
        bytes: size of the twin's folder, stages included.
        said: the error, or the end of what was said.
    """

    name: str
    scene: str
    out: str
    key: str
    outcome: Outcome
    code: int
    tries: int
    seconds: float
    parts: int
    failing: tuple[str, ...]
    bytes: int
    said: str


def run_job(job: Job) -> Row:
    """Build one scene and write its row; safe to be run again after a kill at any point."""
    began, tries, code, said = time.monotonic(), 0, -1, ""
    earlier = read_row(Path(job.record), job.key)
    if earlier is not None:  # the worker was killed between the row and its word to us
        return earlier
    for _ in range(job.retries + 1):
        tries += 1
        code, said = _built(job)
        if code in (BUILT, CHECKS_FAIL, REFUSED):
            break
    outcome = cast(Outcome, {BUILT: "built", CHECKS_FAIL: "built, checks fail",
                             REFUSED: "refused"}.get(code, "failed"))
    parts, failing = _found(Path(job.out)) if code in (BUILT, CHECKS_FAIL) else (0, ())
    row = Row(job.name, job.scene, job.out, job.key, outcome, code, tries,
              round(time.monotonic() - began, 3), parts, failing, _size(Path(job.out)),
              "" if code == BUILT else said[-TAIL:])
    Path(job.record).parent.mkdir(parents=True, exist_ok=True)
    write_text_atomic(Path(job.record), json.dumps(asdict(row), indent=1) + "\n")
    return row


def read_row(record: Path, key: str) -> Row | None:
    """Return the row of an earlier run under the same key, None if there is none."""
    try:
        data = json.loads(record.read_text("utf-8"))
        row = Row(**{**data, "failing": tuple(data["failing"])})
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return row if row.key == key and row.outcome != "failed" else None


def _built(job: Job) -> tuple[int, str]:
    """Return exit code and last words of one build, once no other holds its folder."""
    words = [sys.executable, "-m", "part2gs_robotics", "build", job.scene, "-o", job.out,
             *job.words]
    limits = {name: str(job.threads) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")}
    for _ in range(LOCK_TRIES):
        done = subprocess.run(words, capture_output=True, text=True, errors="replace",
                              env={**os.environ, **limits}, preexec_fn=_die_with_parent)
        if not (done.returncode == REFUSED and LOCKED in done.stderr):
            break
        time.sleep(LOCK_WAIT)
    error = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    return done.returncode, "\n".join(error) or done.stdout[-TAIL:] or done.stderr[-TAIL:]


def _die_with_parent() -> None:
    """Let a build end with its worker, so that it does not go on beside the next try."""
    try:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    except (OSError, AttributeError):
        return  # not Linux: the lock of the folder keeps the next try waiting instead


def _found(out: Path) -> tuple[int, tuple[str, ...]]:
    """Return how many parts a twin has, and its failing checks."""
    try:
        report = json.loads((out / "report.json").read_text("utf-8"))
        failing = {str(row["name"]) for row in report["checks"]["checks"]
                   if row["status"] in ("fail", "incomplete")}
        return len(report["joints"]), tuple(sorted(failing))
    except (OSError, ValueError, KeyError, TypeError):
        return 0, ()


def _size(out: Path) -> int:
    return sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
