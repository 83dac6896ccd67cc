"""For each: a compiled loop whose indices all threads share.

Numba's `prange` turns the loop into a function of its own and compiles that beside the one it stood
in. Here the body is a function already: what remains is its call. The threads are Numba's, as many
as it is told, so that `side_by_side` can share them out.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib import metadata
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.ufunc.parallel import _launch_threads

TBB = "libtbb.so.12"


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
_launch_threads()  # makes known the scheduler's functions, by which kept kernels ask for them


def in_turn(count: int, body: Callable[..., None], given: tuple[Any, ...]) -> None:
    """Call `body(i, *given)` for every i from 0 on, below a count: what `for_each` does at once.

    There every thread takes one run of indices. What the call of one index writes that of no other
    may read or write; then no number of threads changes a bit.

    Args:
        count: calls.
        body: in a kernel an `inlined` function that returns nothing and keeps no array.
        given: its further arguments.

    Raises:
        RuntimeError: in a kernel, when a call failed; all others are made.
    """
    for i in range(count):
        body(i, *given)


@intrinsic(prefer_literal=False)
def _at_once(typing: Any, count: Any, body: Any, given: Any) -> Any:
    own = body.get_call_type(typing, (types.intp, *given.types), {})
    compiled = body.dispatcher.overloads[own.args]

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        context.active_code_library.add_linking_library(compiled.library)
        size = context.cast(builder, args[0], signature.args[0], types.intp)
        values = cgutils.unpack_tuple(builder, args[2])
        held = [size, size.type(0), size.type(0), *values]
        shared = cgutils.alloca_once_value(builder, cgutils.pack_struct(builder, held))
        threads = builder.call(_outer(builder, "get_num_threads", size.type, ()), ())
        shares = builder.select(builder.icmp_signed("<", threads, size), threads, size)
        builder.store(shares, cgutils.gep_inbounds(builder, shared, 0, 1))
        loop = _share(context, builder.module, compiled.fndesc, own, shared.type)
        _launch(builder, loop, shares, threads, shared)
        failed = builder.load(cgutils.gep_inbounds(builder, shared, 0, 2))
        with cgutils.if_unlikely(builder, cgutils.is_not_null(builder, failed)):
            reason = f"a loop of {body.dispatcher.py_func.__name__} failed"
            context.call_conv.return_user_exc(builder, RuntimeError, (reason,))
        return context.get_dummy_value()

    return types.void(types.intp, body, given), emit


for_each: Any = in_turn if numba.config.DISABLE_JIT else _at_once


def _outer(builder: Any, name: str, result: Any, arguments: Any) -> Any:
    return cgutils.get_or_insert_function(builder.module, ir.FunctionType(result, arguments), name)


def _lent(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return an array without its count of holders: threads would wait for their turns at it."""
    if not isinstance(kind, types.Array):
        return value
    array = context.make_array(kind)(context, builder, value)
    array.meminfo, array.parent = (one.type(None) for one in (array.meminfo, array.parent))
    return array._getvalue()


def _share(context: Any, module: Any, callee: Any, signature: Any, held_as: Any) -> Any:
    """Return the function that calls a body for the indices of some shares.

    It has the arguments of a loop of ufuncs: [1] the first share as an address, [1] how many,
    steps and what is shared.
    """
    size, byte = cgutils.intp_t, cgutils.voidptr_t
    shape = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), size.as_pointer(),
                                            size.as_pointer(), byte])
    function = ir.Function(module, shape, module.get_unique_name("share"))
    function.linkage = "internal"
    builder = ir.IRBuilder(function.append_basic_block())
    shared = builder.bitcast(function.args[3], held_as)
    held = builder.load(shared)
    count, shares = builder.extract_value(held, 0), builder.extract_value(held, 1)
    values = [_lent(context, builder, kind, builder.extract_value(held, 3 + n))
              for n, kind in enumerate(signature.args[1:])]
    first = builder.ptrtoint(builder.load(function.args[0]), size)
    last = builder.add(first, builder.load(function.args[1]))
    begin, end = (builder.sdiv(builder.mul(n, count), shares) for n in (first, last))
    with cgutils.for_range_slice(builder, begin, end, size(1)) as (index, _):
        status, _ = context.call_conv.call_function(
            builder, context.declare_function(module, callee), signature.return_type,
            signature.args, [index, *values])
        with cgutils.if_unlikely(builder, status.is_error):
            builder.store(size(1), cgutils.gep_inbounds(builder, shared, 0, 2))
    builder.ret_void()
    return function


def _launch(builder: Any, loop: Any, shares: Any, threads: Any, shared: Any) -> None:
    """Call a loop for all shares, on so many threads."""
    size, byte = cgutils.intp_t, cgutils.voidptr_t
    launch = _outer(builder, "numba_parallel_for", ir.VoidType(), [byte] * 5 + [size] * 3)
    start = cgutils.alloca_once_value(builder, byte(None))
    extent, step = (cgutils.alloca_once_value(builder, n) for n in (shares, size(1)))
    given = (builder.bitcast(one, byte) for one in (loop, start, extent, step, shared))
    builder.call(launch, (*given, size(0), size(1), threads))
