"""Images and gradients are the same bits in every run and for every number of threads."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render.cpu import render, render_backward

GAUSSIANS, WIDTH, HEIGHT = 1500, 100, 75  # many tiles of any size up to 32, some cut by the border
# Threads may outnumber the cores: what matters is how the work is shared out.
THREADS = (1, 2, 3, 8)
DTYPES = (np.float32, np.float64)
OUTPUTS = ("color", "alpha", "depth", "extra", "median_depth", "visible")
GRADIENTS = ("means", "quats", "scales", "opacities", "colors", "extra", "means2d_abs", "visible")


def results(dtype: type[np.floating]) -> list[bytes]:
    """Bytes of every image and gradient of a scene whose tiles hold very unequal work."""
    rng = np.random.default_rng(0)
    z = rng.uniform(1.0, 3.0, GAUSSIANS)
    # Half of the Gaussians crowd in one corner.
    spread = np.where(np.arange(GAUSSIANS) % 2, 0.15, 1.0)[:, None]
    places = np.array([WIDTH, HEIGHT]) * (rng.uniform(0, 1, (GAUSSIANS, 2)) * spread - 0.5)
    inputs = (np.column_stack([places * z[:, None] / 80, z]), rng.normal(size=(GAUSSIANS, 4)),
              np.exp(rng.normal(-3.5, 0.7, (GAUSSIANS, 3))), rng.uniform(0.02, 1, GAUSSIANS),
              rng.uniform(0, 1, (GAUSSIANS, 3)))
    K = np.array([[80, 0, WIDTH / 2], [0, 80, HEIGHT / 2], [0, 0, 1.0]])
    shape = (HEIGHT, WIDTH)
    out = render(Splats(*(a.astype(dtype) for a in inputs)), Camera(np.eye(4), K, WIDTH, HEIGHT),
                 extra=rng.normal(size=(GAUSSIANS, 2)).astype(dtype), background=[0.2, 0.5, 0.7])
    gradients = render_backward(out, *(rng.normal(size=(*shape, *channels)).astype(dtype)
                                       for channels in ((3,), (), (), (2,))))
    return ([getattr(out, k).tobytes() for k in OUTPUTS]
            + [getattr(gradients, k).tobytes() for k in GRADIENTS])


def digest(dtype: type[np.floating]) -> str:
    return hashlib.sha256(b"".join(results(dtype))).hexdigest()


def main() -> None:
    """Write one line per precision and number of threads: a digest of the results."""
    for dtype in DTYPES:
        for threads in THREADS:
            numba.set_num_threads(threads)
            sys.stdout.write(f"{dtype.__name__} {threads} {digest(dtype)}\n")


def digests_of_another_process(**environment: str) -> dict[str, set[str]]:
    """Digests by precision, over all numbers of threads."""
    # How many threads there are is decided when the first kernel runs: too late in this process.
    variables = {**os.environ, "NUMBA_NUM_THREADS": str(max(THREADS)), **environment}
    done = subprocess.run([sys.executable, __file__], env=variables, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    assert len(lines) == len(DTYPES) * len(THREADS)
    return {dtype.__name__: {d for name, _, d in lines if name == dtype.__name__}
            for dtype in DTYPES}


@pytest.fixture(scope="module")
def elsewhere() -> dict[str, set[str]]:
    return digests_of_another_process()


@pytest.mark.parametrize("dtype", DTYPES)
def test_result_does_not_depend_on_the_number_of_threads(elsewhere: dict[str, set[str]],
                                                         dtype: type[np.floating]) -> None:
    assert len(elsewhere[dtype.__name__]) == 1


@pytest.mark.parametrize("dtype", DTYPES)
def test_processes_are_equal_bit_by_bit(elsewhere: dict[str, set[str]],
                                        dtype: type[np.floating]) -> None:
    assert elsewhere[dtype.__name__] == {digest(dtype)}


@pytest.mark.slow
def test_compiling_process_equals_one_that_loads_the_cache(tmp_path: Path) -> None:
    # Helpers linked from two compilations may round differently from one.
    compiled, loaded = (digests_of_another_process(NUMBA_CACHE_DIR=str(tmp_path))
                        for _ in range(2))
    assert compiled == loaded


@pytest.mark.parametrize("dtype", DTYPES)
def test_runs_are_equal_bit_by_bit(dtype: type[np.floating]) -> None:
    first = results(dtype)
    for _ in range(4):
        for name, one, two in zip((*OUTPUTS, *GRADIENTS), first, results(dtype), strict=True):
            assert one == two, name


if __name__ == "__main__":
    main()
