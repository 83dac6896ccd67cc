"""Worker: a process that compiles kernels, `python -m part2gs_robotics.ahead.worker`.

Reads a kernel per line and answers each with a line: "kept", or what is wrong. With `--idle` it
takes what other processes leave of a core.
"""

from __future__ import annotations

import gc
import os
import sys
from importlib import import_module
from typing import TextIO

from part2gs_robotics.ahead.listed import Kernel, read

# objects made before Python looks for rings of them: compilers make few, and looking took a fifth
COLLECT_AFTER = 200_000, 20, 1000
IDLE = "--idle"
LEAST = 19  # nice value: the least share of a core that Linux gives


def serve(asked: TextIO, answers: TextIO) -> None:
    """Compile what is asked for until nothing more is."""
    for line in asked:
        print(compiled(read(line)), file=answers, flush=True)


def compiled(kernel: Kernel) -> str:
    """Compile a kernel, which its module keeps on disk; returns the answer."""
    from numba.core.sigutils import normalize_signature

    try:  # types, not their names: a kernel is kept under what it was asked for
        types, _ = normalize_signature(kernel.types)
        getattr(import_module(kernel.module), kernel.name).compile(types)
    except Exception as err:  # one kernel less is compiled ahead; the build says so and goes on
        return f"{type(err).__name__}: {err}".replace("\n", " ")
    return "kept"


if __name__ == "__main__":
    gc.set_threshold(*COLLECT_AFTER)
    if IDLE in sys.argv and hasattr(os, "nice"):
        os.nice(LEAST)
    serve(sys.stdin, sys.stdout)
