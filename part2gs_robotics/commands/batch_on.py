"""Where the scenes of a batch are built: threads of this process, Ray, or SLURM by submitit.

None of the three is ours: Ray and SLURM share out the work, start it again where a worker died, and
say when it is done.
"""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from part2gs_robotics.commands.batch_job import Job, Row, run_job
from part2gs_robotics.errors import ConfigError

WORKER_LIVES = 10  # workers a scene may lose on Ray: machines fail, one that always does is a fault
SLURM_HOURS = 4  # a job may take; the largest scenes took one
SLURM_GB = 8  # of memory per job: a build of 64 + 64 photos stays below 3


@dataclass(frozen=True)
class Lost:
    """A scene whose worker never came back, and why."""

    job: Job
    reason: str


def prepare(place: str) -> None:
    """Import what a place needs, before logs are opened: submitit closes all it finds.

    Args:
        place: as for `run_on`.

    Raises:
        ConfigError: the extra is not installed, or there is no SLURM here.
    """
    name, extra = {"ray": ("ray", "batch"), "slurm": ("submitit", "slurm"),
                   "slurm here": ("submitit", "slurm")}.get(place, ("", ""))
    if not name:
        return
    try:
        import_module(name)
    except ImportError as err:
        raise ConfigError(f"batch: {name} is not installed. Expected it for --on {place}; run pip "
                          f"install 'part2gs-robotics[{extra}]' (or pip install {name}).") from err
    if place == "slurm" and shutil.which("sbatch") is None:
        raise ConfigError("batch: --on slurm finds no sbatch. Expected the programs of SLURM on "
                          "the path; log in to a node that has them, or use --on local.")


def run_on(place: str, jobs: Sequence[Job], workers: int, folder: Path) -> Iterator[Row | Lost]:
    """Yield the row of every job as it is done; the order is that of ending.

    Args:
        place: local, ray, slurm, or "slurm here" (submitit's own processes, for trials).
        jobs: what is to be done.
        workers: builds at one time, locally and on a Ray cluster that is started here.
        folder: for logs of SLURM.
    """
    if place == "ray":
        yield from _ray(jobs, workers)
    elif place.startswith("slurm"):
        yield from _slurm(jobs, folder, "local" if place == "slurm here" else "slurm")
    else:
        yield from _local(jobs, workers)


def _local(jobs: Sequence[Job], workers: int) -> Iterator[Row | Lost]:
    with ThreadPoolExecutor(workers) as pool:
        waiting = {pool.submit(run_job, job): job for job in jobs}
        try:
            for done in as_completed(waiting):
                yield done.result()
        except BaseException:  # Ctrl-C goes to the builds as well; those that wait never begin
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _ray(jobs: Sequence[Job], workers: int) -> Iterator[Row | Lost]:
    import ray

    if not ray.is_initialized():
        here = None if "RAY_ADDRESS" in os.environ else workers  # a cluster knows its own cores
        ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR,
                 num_cpus=here)
    remote: Any = ray.remote(max_retries=WORKER_LIVES)(run_job)
    waiting = {remote.remote(job): job for job in jobs}
    try:
        while waiting:
            (done,), _ = ray.wait(list(waiting), num_returns=1)
            job = waiting.pop(done)
            try:
                yield ray.get(done)
            except ray.exceptions.RayError as err:
                yield Lost(job, " ".join(str(err).split())[:300])
    finally:
        ray.shutdown()


def _slurm(jobs: Sequence[Job], folder: Path, cluster: str) -> Iterator[Row | Lost]:
    import submitit

    executor = submitit.AutoExecutor(folder=str(folder), cluster=cluster)
    executor.update_parameters(timeout_min=60 * SLURM_HOURS, cpus_per_task=jobs[0].threads,
                               mem_gb=SLURM_GB, name="part2gs")
    submitted = executor.map_array(run_job, list(jobs))
    waiting = {done.job_id: (done, job) for done, job in zip(submitted, jobs, strict=True)}
    try:
        for done in submitit.helpers.as_completed([done for done, _ in waiting.values()]):
            job = waiting.pop(done.job_id)[1]
            problem = done.exception()
            yield done.result() if problem is None else Lost(job, str(problem)[-300:])
    finally:
        for done, _ in waiting.values():
            done.cancel()
