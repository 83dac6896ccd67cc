"""Many scenes to many twins: what is done already stays, what a machine broke is tried again."""

from __future__ import annotations

import logging
import os
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from part2gs_robotics.commands.batch_job import Job, Row, read_row
from part2gs_robotics.commands.batch_on import Lost, prepare, run_on
from part2gs_robotics.commands.batch_page import counts, write_pages
from part2gs_robotics.config import Option, Value
from part2gs_robotics.errors import ConfigError, SceneError
from part2gs_robotics.runtime.hashing import code_version, hash_of
from part2gs_robotics.runtime.log import logging_to
from part2gs_robotics.runtime.store import Store

logger = logging.getLogger(__name__)

WORKERS = (1, 1000)  # threads that only wait; above is a typing mistake
RETRIES = (0, 100)  # what fails a hundred times fails always
RECORDS = "batch"  # folder of the rows among the twins
NAME = re.compile(r"[^\w.-]+")  # what a folder's name among the twins may not hold


@dataclass(frozen=True)
class BatchWishes:
    """How a batch is run.

    Attributes:
        out: folder of the twins.
        place: local, ray or slurm.
        workers: builds at one time.
        retries: how often a build that was killed or broke is tried again.
        words: flags for every build.
        quiet, verbose: as for every command.
    """

    out: Path
    place: str = "local"
    workers: int = 1
    retries: int = 2
    words: tuple[str, ...] = ()
    quiet: bool = False
    verbose: bool = False


def run_batch(scenes: Sequence[Path], wishes: BatchWishes) -> tuple[list[Row], list[Path]]:
    """Build every scene into a folder of its own; return a row per scene and the pages written.

    The same call goes on where an earlier one stopped: scenes whose files, flags and code are
    unchanged keep their row, and a build that was stopped goes on from its last stage.

    Args:
        scenes: folders of scenes.
        wishes: how.

    Raises:
        SceneError: a scene that is no folder.
        ConfigError: two scenes of one name, or a place that does not work here.
        StoreError: the folder of twins cannot be written, or another batch runs there.
    """
    for name, value, (low, high) in (("workers", wishes.workers, WORKERS),
                                     ("retries", wishes.retries, RETRIES)):
        if not low <= value <= high:
            raise ConfigError(f"batch: --{name} is {value}. Expected {low} to {high}; change "
                              f"--{name}.")
    prepare(wishes.place)
    jobs = _jobs(scenes, wishes)
    store = Store(wishes.out)
    store.refuse_early()
    store.prepare()
    with store.locked(), logging_to(wishes.out, wishes.quiet, wishes.verbose):
        rows = {job.name: row for job in jobs
                if (row := read_row(Path(job.record), job.key)) is not None}
        if rows:
            logger.info("%d of %d scenes are unchanged and keep their twins", len(rows), len(jobs))
        todo = [job for job in jobs if job.name not in rows]
        try:
            for row in _done(todo, wishes):
                rows[row.name] = row
        finally:  # after Ctrl-C as well: what is known so far
            ordered = [rows[job.name] for job in jobs if job.name in rows]
            pages = write_pages(wishes.out, ordered)
        logger.info("%s", counts(ordered))
    return ordered, pages


def words_of(given: Mapping[str, Value], options: Mapping[str, Option]) -> tuple[str, ...]:
    """Return the flags of `build` that say these settings."""
    words: list[str] = []
    for name, value in given.items():
        flag = options[name].flag
        if isinstance(value, bool):
            words.append(flag if value else f"--no-{flag[2:]}")
        elif isinstance(value, tuple):
            words += [flag, *map(str, value)]
        else:
            words.append(f"{flag}={value}")
    return tuple(words)


def _jobs(scenes: Sequence[Path], wishes: BatchWishes) -> list[Job]:
    code, seen, jobs = code_version(), dict[str, Path](), []
    threads = max(1, (os.cpu_count() or 1) // wishes.workers)
    for scene in scenes:
        if not scene.is_dir():
            raise SceneError(f"{scene}: is {'a file' if scene.exists() else 'missing'}. Expected "
                             "folders of scenes; leave it out, or correct the path.")
        name = NAME.sub("_", scene.resolve().name) or "scene"
        if name in seen or name in (RECORDS, "stages"):
            raise ConfigError(f"batch: {scene} and {seen.get(name, 'the batch itself')} would both "
                              f"be {wishes.out / name}. Expected one name per scene; rename one.")
        seen[name] = scene
        out = wishes.out / name
        jobs.append(Job(name, str(scene.resolve()), str(out.resolve()),
                        str((wishes.out / RECORDS / f"{name}.json").resolve()),
                        hash_of("batch", code, wishes.words, _files(scene)), wishes.words,
                        wishes.retries, threads))
    return jobs


def _files(scene: Path) -> list[list[object]]:
    """Return what tells whether a scene changed, without reading thousands of photos."""
    return [[path.relative_to(scene).as_posix(), found.st_size, found.st_mtime_ns]
            for path in sorted(scene.rglob("*")) if path.is_file()
            and (found := path.stat())]


def _done(jobs: Sequence[Job], wishes: BatchWishes) -> Iterator[Row]:
    """Yield rows as they come, and say how far all is and how long it will take."""
    if not jobs:
        return
    began = time.monotonic()
    ends = run_on(wishes.place, jobs, wishes.workers, wishes.out / RECORDS / "slurm")
    for number, end in enumerate(ends, 1):
        row = _lost(end) if isinstance(end, Lost) else end
        left = (time.monotonic() - began) / number * (len(jobs) - number)
        logger.info("%d/%d %s: %s, %d parts, %.0f s; %d:%02d left", number, len(jobs), row.name,
                    row.outcome, row.parts, row.seconds, left // 60, left % 60)
        yield row


def _lost(lost: Lost) -> Row:
    job = lost.job
    return Row(job.name, job.scene, job.out, job.key, "failed", -1, 0, 0.0, 0, (), 0,
               f"the worker was lost: {lost.reason}")
