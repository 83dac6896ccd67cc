"""The machine: its name, its instruction set, and its measured peak of multiply-adds."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import binding, ir
from numba import njit, prange, types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
FEATURES = binding.get_host_cpu_features()
LANES = 16 if FEATURES.get("avx512f") else 8  # float32 of one vector
CHAINS = 12  # independent sums: more than latency x issue width (4 x 2), fewer than 16 registers
ROUNDS = 1_000_000  # 2 ms at 3 GHz and two multiply-adds per cycle: fits between interruptions
FACTOR, TERM = np.float32(0.999), np.float32(0.001)  # sums converge: no infinities, no denormals


def isa() -> str:
    """Return the widest vector instructions of this CPU."""
    if FEATURES.get("avx512f"):
        return "avx512"
    return "avx2" if FEATURES.get("avx2") and FEATURES.get("fma") else platform.machine()


def machine() -> str:
    """Return the CPU's model, its instruction set and how many of them there are."""
    model = platform.machine()
    info = Path("/proc/cpuinfo")
    for line in info.read_text().splitlines() if info.exists() else []:
        if line.startswith("model name"):
            model = line.split(":", 1)[1].strip()
            break
    return f"{model}, {isa()}, {os.cpu_count()} CPUs"


def commit() -> str:
    """Return the short hash of the checked-out commit, or "unknown" outside a clone."""
    try:
        done = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, text=True,
                              capture_output=True, check=False)
    except OSError:
        return "unknown"
    return done.stdout.strip() or "unknown"


def fma_peak(runs: int = 30) -> float:
    """Return the best measured float32 GFLOP/s of numba's present threads.

    Also as their number times one thread's best: on a busy machine one core is free sooner than
    all are, and too low a peak would flatter every share of it.
    """
    threads = numba.get_num_threads()
    return 2e-9 * LANES * CHAINS * ROUNDS * threads / min(
        _fastest(_burn_all, threads, runs), _fastest(_burn_one, 1, runs))


def _fastest(burn: Callable[..., None], threads: int, runs: int) -> float:
    sums = np.zeros(threads, np.float32)
    burn(sums, 1, FACTOR, TERM)  # compiles; as arguments, or the compiler would compute ahead
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        burn(sums, ROUNDS, FACTOR, TERM)
        seconds.append(time.perf_counter() - start)
    return min(seconds)


@intrinsic
def _burn(typing: object, rounds: types.Type, factor: types.Type, term: types.Type,
          ) -> tuple[object, Callable[..., Any]]:
    """Return the sum of CHAINS vectors after `rounds` times v = v * factor + term."""
    def emit(_: object, builder: ir.IRBuilder, __: object, args: tuple[ir.Value, ...]) -> ir.Value:
        vector = ir.VectorType(ir.FloatType(), LANES)
        fma = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{LANES}f32")
        scale, step = (_splat(builder, vector, value) for value in args[1:])
        before, loop, after = builder.block, builder.append_basic_block(), \
            builder.append_basic_block()
        builder.branch(loop)
        builder.position_at_end(loop)
        count = builder.phi(args[0].type)
        chains = [builder.phi(vector) for _ in range(CHAINS)]
        left = builder.sub(count, count.type(1))
        count.add_incoming(args[0], before)
        count.add_incoming(left, loop)
        ends = [builder.call(fma, [chain, scale, step]) for chain in chains]
        for k, chain in enumerate(chains):  # other starts, or the compiler makes one of them all
            chain.add_incoming(ir.Constant(vector, [float(k)] * LANES), before)
            chain.add_incoming(ends[k], loop)
        builder.cbranch(builder.icmp_signed(">", left, left.type(0)), loop, after)
        builder.position_at_end(after)
        total = ends[0]
        for end in ends[1:]:
            total = builder.fadd(total, end)
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return types.float32(types.int64, types.float32, types.float32), emit


def _splat(builder: ir.IRBuilder, vector: ir.VectorType, value: ir.Value) -> ir.Value:
    out = ir.Constant(vector, ir.Undefined)
    for lane in range(LANES):
        out = builder.insert_element(out, value, ir.Constant(ir.IntType(32), lane))
    return out


@njit(parallel=True)
def _burn_all(sums: NDArray[np.float32], rounds: int, factor: np.float32, term: np.float32) -> None:
    for k in prange(len(sums)):
        sums[k] = _burn(rounds, factor, term)


@njit
def _burn_one(sums: NDArray[np.float32], rounds: int, factor: np.float32, term: np.float32) -> None:
    sums[0] = _burn(rounds, factor, term)
