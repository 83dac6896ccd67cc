"""Where compiled kernels are kept: decided here alone, and before numba is imported.

In one folder of the user, not beside the source: an installation that is removed and made again
finds its kernels. A kernel's own folder is named by the content of all source it was made of.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Protocol

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.runtime.hashing import PACKAGE, hash_of, hash_of_imports

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

VARIABLE = "NUMBA_CACHE_DIR"
NAME = "part2gs-robotics"
UNUSED_DAYS = 30  # kernels of older code are kept so long: who goes back and forth compiles once
_DIGITS = 16  # of a hash in a folder's name
_DAY = 86400.0  # seconds


class Clock(Protocol):
    """What numba counts seconds with."""

    duration: float
    done: bool


clocks: list[Clock] = []  # of this process's compiler; empty where no room has loaded numba


def prepare_jit_cache() -> str | None:
    """Make sure compiled kernels can be kept; returns a note when that may cost time.

    Raises:
        ConfigError: NUMBA_CACHE_DIR names a folder that cannot be written.
    """
    if wanted := _wanted_folder():
        if not _writable(wanted):
            raise ConfigError(f"{VARIABLE} is {os.environ[VARIABLE]!r}, where {wanted} cannot be "
                              "written. Expected a folder for compiled kernels; correct the "
                              "variable or unset it.")
        return None
    if kept_in() == _user_folder():
        return None
    return (f"{_user_folder()} is not a folder that you alone can write, so compiled kernels are "
            f"kept in {kept_in()} as long as temporary files are. Compiling takes a minute or "
            f"two; set {VARIABLE} to a folder that stays.")


@cache
def kept_in() -> Path:
    """Return the folder that compiled kernels are kept in; this process stays with it."""
    if wanted := _wanted_folder():  # the user vouches for it, whoever else may write there
        good = _writable(wanted)
    else:
        wanted = _user_folder()
        good = _private(wanted)
    return wanted if good else _private_temporary_folder()


def folder_of(module: str, *compiler: str) -> Path:
    """Return the folder for kernels of a module of this package, as its source is now.

    Args:
        module: its full name.
        compiler: versions of what compiles.
    """
    digest = hash_of(hash_of_imports(module), compiler)[:_DIGITS]
    folder = kept_in() / f"{module.removeprefix(PACKAGE + '.')}-{digest}"
    try:
        os.utime(folder)
    except OSError:  # new code: the time to look for old
        remove_unused(kept_in())
    return folder


def remove_unused(kept: Path) -> None:
    """Remove the folders of kernels that no process has asked for in a long time."""
    for folder in kept.glob("*-" + "[0-9a-f]" * _DIGITS):
        with suppress(OSError):  # another process was faster
            if time.time() - folder.stat().st_mtime > UNUSED_DAYS * _DAY:
                shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Let one process at a time add to a folder, which is made if it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as file:
        if fcntl is not None:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(file, fcntl.LOCK_EX)
        yield


def compile_seconds() -> float:
    """Return how long this process has compiled kernels; reading kept ones does not count."""
    return sum(float(clock.duration) for clock in clocks if clock.done)


def _wanted_folder() -> Path | None:
    wanted = os.environ.get(VARIABLE)
    return Path(wanted).absolute() / NAME if wanted else None


def _user_folder() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(home).absolute() / NAME


def _private_temporary_folder() -> Path:
    """Return a folder in the temporary directory that only this user can write."""
    folder = Path(tempfile.gettempdir()) / f"{NAME}-numba-{_user()}"
    return folder if _private(folder) else Path(tempfile.mkdtemp(prefix=f"{NAME}-numba-"))


def _private(folder: Path) -> bool:
    """Whether only this user can write in a folder, which is made if it is missing."""
    # Kernels are code: a folder that someone else prepared under this name must not be trusted.
    if not _writable(folder):
        return False
    info = folder.lstat()
    return stat.S_ISDIR(info.st_mode) and info.st_uid == _user() and not info.st_mode & 0o022


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0  # what lstat says where users have no number


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
