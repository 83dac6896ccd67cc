"""Loops on all threads do what the same loop does in turn, and say when a call of them failed."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba import get_thread_id

from part2gs_robotics.model.arrays import F64, I64
from part2gs_robotics.runtime.for_each import for_each, in_turn, load_scheduler
from part2gs_robotics.runtime.jit import inlined, kernel

MOST = numba.config.NUMBA_NUM_THREADS


@inlined
def _add(i: int, values: F64, scale: float, out: F64, calls: I64) -> None:
    """Add something that depends on the index alone; an array of its own, and one lent."""
    own = np.full(3, values[i % len(values)])
    for k in range(3):
        out[i] += np.sin(own[k] + i) * scale
    calls[i] += 1


@kernel
def _added(count: int, values: F64, scale: float, out: F64, calls: I64) -> None:
    for_each(count, _add, (values, scale, out, calls))


@inlined
def _mark(i: int, threads: I64) -> None:
    threads[i] = get_thread_id()


@kernel
def _marked(threads: I64) -> None:
    for_each(len(threads), _mark, (threads,))


@inlined
def _fail(i: int, bad: int, out: I64) -> None:
    if i == bad:
        raise ValueError("this one")
    out[i] += 1


@kernel
def _failing(bad: int, out: I64) -> None:
    for_each(len(out), _fail, (bad, out))


@pytest.fixture
def threads():
    """Set the number of kernel threads."""
    yield numba.set_num_threads
    numba.set_num_threads(MOST)


@pytest.mark.parametrize("count", [0, 1, 2, 3, MOST, MOST + 1, 1000])
@pytest.mark.parametrize("number", sorted({1, MOST}))
def test_every_index_is_called_once_and_bits_are_those_of_one_thread(threads, count, number):
    values = np.random.default_rng(0).normal(size=7)
    out, calls = np.zeros(count), np.zeros(count, np.int64)
    threads(number)
    _added(count, values, 0.5, out, calls)
    assert (calls == 1).all()
    one, again = np.zeros(count), np.zeros(count, np.int64)
    threads(1)
    _added(count, values, 0.5, one, again)
    assert out.tobytes() == one.tobytes()
    plain = np.zeros(count)
    in_turn(count, _add.py_func, (values, 0.5, plain, again))
    np.testing.assert_allclose(out, plain, rtol=1e-15)


@pytest.mark.skipif(MOST < 2, reason="one core")
def test_every_thread_takes_one_run(threads):
    threads(MOST)
    taken = np.zeros(100 * MOST, np.int64)
    _marked(taken)
    changes = np.flatnonzero(np.diff(taken)) + 1
    assert set(changes) <= {100 * k for k in range(1, MOST)}  # fewer, where one takes another's


def test_arrays_are_held_as_before(threads):
    values, out, calls = np.zeros(5), np.zeros(50), np.zeros(50, np.int64)
    before = [sys.getrefcount(array) for array in (values, out, calls)]
    for number in (1, MOST):
        threads(number)
        _added(50, values, 1.0, out, calls)
    assert [sys.getrefcount(array) for array in (values, out, calls)] == before


def test_a_call_that_fails_is_told_and_the_others_are_made(threads):
    out = np.zeros(40, np.int64)
    for number in (1, MOST):
        threads(number)
        with pytest.raises(RuntimeError, match="a loop of _fail failed"):
            _failing(7, out)
    assert out[7] == 0
    assert (np.delete(out, 7) == 2).all()
    _failing(-1, out)  # and the next call of the same kernel knows nothing of it
    assert out[7] == 1


@pytest.mark.parametrize("layer", ["omp", "workqueue"])
def test_other_layers_of_numba_share_out_the_same(layer):
    code = ("import numba, numpy as np\nfrom part2gs_robotics.render.sh import sh_colors\n"
            "r = np.random.default_rng(0).normal\n"
            "c = sh_colors(r(size=(999, 3)), r(size=(999, 3)), r(size=(999, 3, 3)), np.ones(3))\n"
            "print(c.tobytes().hex(), numba.threading_layer())")
    mine, theirs = (subprocess.run([sys.executable, "-c", code], text=True, check=True,
                                   capture_output=True, env={**os.environ, **more}).stdout.split()
                    for more in ({}, {"NUMBA_THREADING_LAYER": layer}))
    assert theirs[1] == layer
    assert theirs[0] == mine[0]


def test_threads_are_scheduled_by_tbb_where_it_is_installed() -> None:
    assert (numba.threading_layer() == "tbb") == load_scheduler()
