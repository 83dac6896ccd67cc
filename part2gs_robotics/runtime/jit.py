"""Compile the CPU kernels: one place for Numba's options and its cache folder."""

from __future__ import annotations

import ctypes
import os
import stat
import tempfile
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import TypeVar, cast

import numba
from numba.core import event

TBB = "libtbb.so.12"
LINE = 64  # bytes of a cache line: buffers of the kernels start at one

F = TypeVar("F", bound=Callable[..., object])

# contract: fused multiply-add; reassoc: vector sums; nsz: frees the selects. NaN and infinity keep
# their IEEE meaning (no nnan, no ninf) because the projection skips Gaussians by testing for them.
# error_model: a test for division by zero in the inner loop would cost its SIMD code.
_OPTIONS = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz"}}


def kernel(function: F) -> F:
    """Compile a function for one thread, cached on disk."""
    return cast(F, numba.njit(cache=True, **_OPTIONS)(function))


def inlined(function: F) -> F:
    """Compile a function to be called from kernels of the same file."""
    return cast(F, numba.njit(**_OPTIONS)(function))


def parallel_kernel(function: F) -> F:
    """Compile a function whose prange loops run on all threads, cached on disk."""
    return cast(F, numba.njit(cache=True, parallel=True, **_OPTIONS)(function))


def _writable(folder: Path) -> bool:
    """Whether a file can be created in the folder, or in the parent it would be made in."""
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _private_temporary_folder() -> Path:
    """Return a cache folder in the temporary directory that only this user can write."""
    # The cache holds code: a folder someone else prepared under this name must not be trusted.
    folder = Path(tempfile.gettempdir()) / f"part2gs-robotics-numba-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        info = folder.lstat()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="part2gs-robotics-numba-"))
    ours = stat.S_ISDIR(info.st_mode) and info.st_uid == os.getuid() and not info.st_mode & 0o022
    return folder if ours else Path(tempfile.mkdtemp(prefix="part2gs-robotics-numba-"))


def ensure_cache_folder() -> None:
    """Point Numba at a writable cache folder where its own choices are read-only.

    Numba stops with an error if neither the package nor the user's cache folder can be written.
    """
    given = os.environ.get("NUMBA_CACHE_DIR", "")
    user_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    choices = [Path(given)] if given else [Path(__file__).parent / "__pycache__", user_cache]
    if not any(_writable(folder) for folder in choices):
        os.environ["NUMBA_CACHE_DIR"] = str(_private_temporary_folder())
        numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


def load_scheduler() -> bool:
    """Load the TBB library where its package is installed, so that Numba's threads use it.

    With OpenMP each parallel loop waits for its slowest thread. On a core that another process
    uses, that is milliseconds per loop, and a fit has twenty thousand loops. TBB's threads take
    over the work of one that is not running.
    """
    try:
        files = metadata.files("tbb") or []
        ctypes.CDLL(str(next(f.locate() for f in files if f.name == TBB)), ctypes.RTLD_GLOBAL)
    except (metadata.PackageNotFoundError, StopIteration, OSError):
        return False  # no wheel for this processor: Numba takes OpenMP or its own threads
    return True


load_scheduler()
ensure_cache_folder()
CLOCK = event.TimingListener()  # time spent compiling; reading a kept kernel does not count
event.register("numba:compile", CLOCK)
