"""Compile the CPU kernels: one place for Numba's options, and its cache where jit_cache says."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite
import numba
import numpy as np
from numba.core import event

from part2gs_robotics.runtime.hashing import PACKAGE
from part2gs_robotics.runtime.jit_cache import alone_in, clocks, folder_of

LINE = 64  # bytes of a cache line: buffers of the kernels start at one

F = TypeVar("F", bound=Callable[..., object])
logger = logging.getLogger(__name__)

# contract: fused multiply-add; reassoc: vector sums; nsz: frees the selects. NaN and infinity keep
# their IEEE meaning (no nnan, no ninf) because the projection skips Gaussians by testing for them.
# error_model: a test for division by zero in the inner loop would cost its SIMD code.
# no_cfunc_wrapper: no kernel is called from C; without that door compiling takes a tenth less time.
_OPTIONS = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy",
            "fastmath": {"contract", "reassoc", "nsz"}}


def kernel(function: F) -> F:
    """Compile a function, kept on disk; what shall run on all threads it gives to `for_each`."""
    return cast(F, _kept(numba.njit(**_OPTIONS)(function)))


def inlined(function: F) -> F:
    """Compile a function to be called from kernels, each of which holds a copy; never from Python.

    The body of a loop that `for_each` shares out among threads is one as well.
    """
    return cast(F, numba.njit(no_cpython_wrapper=True, **_OPTIONS)(function))


def _kept(dispatcher: Any) -> Any:
    """Return a dispatcher that keeps what it compiles; outside of this package none does."""
    function = getattr(dispatcher, "py_func", None)  # none where NUMBA_DISABLE_JIT is set
    if function is None or not function.__module__.startswith(PACKAGE + "."):
        return dispatcher
    try:
        dispatcher._cache.enable()  # fails where numba no longer has the attribute set here
        dispatcher._cache = _cache_class()(function)
    except (ImportError, AttributeError, TypeError, NotImplementedError) as err:
        _say_once(f"numba {numba.__version__} keeps kernels in a way that this version does not "
                  f"know ({err}). An installation in another place compiles them again.")
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(_folder(function))
        try:
            dispatcher.enable_caching()  # reads the setting now and never again
        finally:
            numba.config.CACHE_DIR = before
    return dispatcher


def _places() -> Any:
    """Return the part of Numba's cache that names files, with our folder in place of its choices.

    Numba names a folder by the path of the source and may refuse kernels when the file is newer, so
    that an installation made again compiles everything. It looks at no other file either: a kernel
    stays as it is when a helper that it holds changes. None of this is in its public API.
    """
    from numba.core.caching import CompileResultCacheImpl, _CacheLocator

    class Place(_CacheLocator):
        def __init__(self, function: Any, file: str) -> None:
            self._py_file, self._lineno = file, function.__code__.co_firstlineno
            self._folder = _folder(function)

        def get_cache_path(self) -> str:
            return str(self._folder)

        def get_source_stamp(self) -> str:
            return self._folder.name  # says all: another source, another folder

        def get_disambiguator(self) -> str:
            return str(self._lineno)

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> Any:
            return cls(py_func, py_file)

    class Places(CompileResultCacheImpl):
        _locator_classes = (Place,)

    return Places


@cache
def _cache_class() -> Any:
    """Return Numba's cache of one function, made to keep kernels where jit_cache says."""
    from numba.core.caching import FunctionCache

    class KernelCache(FunctionCache):
        _impl_class = _places()

        def load_overload(self, *args: Any) -> Any:
            try:
                return super().load_overload(*args)
            except Exception as err:  # a torn file: whatever unpickling makes of it
                logger.warning("a kept kernel in %s cannot be read and is compiled again: %r",
                               self.cache_path, err)
                with suppress(OSError):
                    self.flush()
                return None

        def save_overload(self, *args: Any) -> None:
            try:
                # Numba reads its index, picks a number and writes: two processes that compile a
                # function for different types would take the same, and one run the other's code.
                with alone_in(Path(self.cache_path)):
                    super().save_overload(*args)
            except OSError as err:
                _say_once(f"compiled kernels cannot be kept in {self.cache_path}: {err}")

    return KernelCache


@cache
def _folder_of_module(module: str) -> Path:
    return folder_of(module, numba.__version__, llvmlite.__version__, np.__version__)


def _folder(function: Any) -> Path:
    return _folder_of_module(function.__module__)


def kept(module: str, name: str) -> bool:
    """Return whether a kernel of this package was compiled before, as its source is now."""
    if numba.config.DISABLE_JIT:
        return True
    return any(_folder_of_module(module).rglob(f"*.{name}-*.nbi"))


@cache
def _say_once(text: str) -> None:
    logger.warning("%s", text)


clocks.append(event.TimingListener())  # time spent compiling; reading a kept kernel does not count
event.register("numba:compile", clocks[-1])
