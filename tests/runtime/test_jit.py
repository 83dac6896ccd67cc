"""Kernels: what compiling them costs, and which threads run them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

DRAW = ("import numpy as np\nfrom part2gs_robotics.runtime import jit_cache\n"
        "assert jit_cache.compile_seconds() == 0.0\n"
        "from part2gs_robotics.render import sh\n"
        "z = np.zeros((1, 3)); sh.sh_colors(z, z, np.zeros((1, 0, 3)), np.ones(3))\n")


def said(code: str, **variables: str) -> list[str]:
    done = subprocess.run([sys.executable, "-c", DRAW + code], text=True, capture_output=True,
                          check=True, env={**os.environ, **variables})
    return done.stdout.split()


def test_compiling_is_timed_and_kept(tmp_path: Path) -> None:
    seconds = []
    for _ in range(2):
        took, folder = said("print(jit_cache.compile_seconds(), jit_cache.kept_in())",
                            NUMBA_CACHE_DIR=str(tmp_path))
        seconds.append(float(took))
        assert Path(folder).parent == tmp_path
    assert seconds[0] > 0.05  # LLVM takes tenths of a second
    assert seconds[1] == 0.0  # read from the folder


def test_numba_may_be_told_not_to_compile() -> None:
    assert said("print(jit_cache.compile_seconds())", NUMBA_DISABLE_JIT="1") == ["0"]
