"""Eight numbers side by side in one register: explicit SIMD for Numba kernels.

LLVM's loop vectoriser gives up on the rasteriser's inner loop, or turns its selects into masked
stores that some processors execute in microcode. Here `Lanes` is a Numba type whose arithmetic maps
to LLVM vector instructions one to one, in float32 and float64 alike; LLVM splits or joins them for
the machine at hand. Everything below exists in compiled code only.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

LANES = 8  # float32 numbers in an AVX register
FLAGS = ("contract", "nsz")  # fused multiply-add; no reordering, NaN and infinity stay as they are

_INTS = ir.VectorType(ir.IntType(32), LANES)  # the bits of as many float32 numbers
Lane = Any  # a Lanes value in annotations: Numba types it, Python never sees one


class Lanes(types.Type):
    """Numba type of eight numbers of one float type."""

    def __init__(self, scalar: types.Float) -> None:
        self.scalar = scalar
        super().__init__(name=f"lanes{LANES}({scalar})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, _vector(kind))


def _vector(kind: Lanes) -> ir.VectorType:
    base = ir.DoubleType() if kind.scalar == types.float64 else ir.FloatType()
    return ir.VectorType(base, LANES)


def _indices(places: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)


def _address(context: Any, builder: Any, kind: types.Array, array: Any, index: Any, to: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), to.as_pointer())


@intrinsic
def load(_: Any, array: Any, index: Any) -> Any:
    """Return the eight numbers of a flat contiguous array that start at an index."""
    kind = Lanes(array.dtype)

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        value = builder.load(_address(context, builder, array, args[0], args[1], _vector(kind)))
        value.align = array.dtype.bitwidth // 8
        return value

    return kind(array, types.uint64), emit


@intrinsic
def gather(_: Any, array: Any, row: Any, last: Any, stride: Any, column: Any) -> Any:
    """Return one column of eight rows of a flat array in float64; rows end at the last one."""
    kind = Lanes(types.float64)

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        value: Any = ir.Constant(_vector(kind), ir.Undefined)
        for lane in range(LANES):
            at = builder.add(args[1], ir.IntType(64)(lane))
            at = builder.select(builder.icmp_unsigned("<", at, args[2]), at, args[2])
            at = builder.add(builder.mul(at, args[3]), args[4])
            number = builder.load(builder.gep(data, [at]))
            if array.dtype != types.float64:
                number = builder.fpext(number, ir.DoubleType())
            value = builder.insert_element(value, number, ir.IntType(32)(lane))
        return value

    return kind(array, types.uint64, types.uint64, types.uint64, types.uint64), emit


@intrinsic
def store(_: Any, array: Any, index: Any, value: Any) -> Any:
    """Write eight numbers to a flat contiguous array from an index on."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to = _address(context, builder, array, args[0], args[1], _vector(value))
        builder.store(args[2], to).align = array.dtype.bitwidth // 8
        return context.get_dummy_value()

    return types.void(array, types.uint64, value), emit


def _prefetch(write: int, text: str) -> Any:
    @intrinsic
    def apply(_: Any, array: Any, index: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            i32, name = ir.IntType(32), "llvm.prefetch.p0"
            kind = ir.FunctionType(ir.VoidType(), [ir.IntType(8).as_pointer(), i32, i32, i32])
            callee = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
            to = _address(context, builder, array, args[0], args[1], ir.IntType(8))
            builder.call(callee, [to, i32(write), i32(3), i32(1)])  # into the nearest cache, data
            return context.get_dummy_value()

        return types.void(array, types.uint64), emit

    apply.__doc__ = text
    return apply


prefetch = _prefetch(0, "Ask for the cache line of a number of a flat array, to read it soon.")
prefetch_to_write = _prefetch(1, "Ask for the cache line of a number of a flat array, to write it.")


@intrinsic
def splat(_: Any, number: Any) -> Any:
    """Return one number in all lanes."""
    kind = Lanes(number)

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        empty = ir.Constant(_vector(kind), ir.Undefined)
        one = builder.insert_element(empty, args[0], ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(one, empty, _indices([0] * LANES))

    return kind(number), emit


@intrinsic
def where_ge(_: Any, a: Any, b: Any, yes: Any, no: Any) -> Any:
    """Return lane by lane `yes` where a >= b, else `no` (also where either is NaN)."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">=", args[0], args[1]), args[2], args[3])

    return yes(a, b, yes, no), emit


@intrinsic
def least(_: Any, a: Any, b: Any) -> Any:
    """Return the smaller of two, lane by lane; b where either is NaN."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered("<", args[0], args[1]), args[0], args[1])

    return a(a, b), emit


@intrinsic
def most(_: Any, a: Any, b: Any) -> Any:
    """Return the larger of two, lane by lane; b where either is NaN."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.select(builder.fcmp_ordered(">", args[0], args[1]), args[0], args[1])

    return a(a, b), emit


def _unary(name: str, text: str) -> Any:
    """Return an intrinsic that applies an LLVM function to every lane."""
    @intrinsic
    def apply(_: Any, a: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            vector = _vector(a)
            short = "f64" if a.scalar == types.float64 else "f32"
            function = ir.FunctionType(vector, [vector])
            callee = builder.module.globals.get(f"llvm.{name}.v{LANES}{short}") or ir.Function(
                builder.module, function, f"llvm.{name}.v{LANES}{short}")
            return builder.call(callee, args)

        return a(a), emit

    apply.__doc__ = text
    return apply


floor = _unary("floor", "Return the largest whole number not above, of every lane.")
ceiling = _unary("ceil", "Return the smallest whole number not below, of every lane.")
logarithm = _unary("log", "Return the natural logarithm of every lane, by the C library.")
root = _unary("sqrt", "Return the square root of every lane.")
exponential = _unary("exp", "Return e to the power of every lane, by the C library.")


def _blocks(builder: Any, a: Any, b: Any, size: int) -> Any:
    """Add neighbouring blocks of lanes: even blocks of the sum come from a, odd ones from b."""
    first = [lane // (2 * size) * 2 * size + lane % size + (lane // size % 2) * LANES
             for lane in range(LANES)]
    return builder.fadd(builder.shuffle_vector(a, b, _indices(first)),
                        builder.shuffle_vector(a, b, _indices([j + size for j in first])))


def _halves(builder: Any, value: Any, join: Callable[[Any, Any], Any]) -> Any:
    """Join a vector's lanes to one number, halving it in a fixed order."""
    count = LANES
    while count > 1:
        count //= 2
        value = join(builder.shuffle_vector(value, value, _indices(list(range(count)))),
                     builder.shuffle_vector(value, value, _indices(list(range(count, 2 * count)))))
    return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))


@intrinsic
def exponent(_: Any, a: Any) -> Any:
    """Return e of m 2^e with m in [1, 2), for positive normal float32."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = builder.lshr(builder.bitcast(args[0], _INTS), ir.Constant(_INTS, [23] * LANES))
        whole = builder.sub(bits, ir.Constant(_INTS, [127] * LANES))
        return builder.sitofp(whole, _vector(a))

    return a(a), emit


@intrinsic
def mantissa(_: Any, a: Any) -> Any:
    """Return m of m 2^e with m in [1, 2), for positive normal float32."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = builder.and_(builder.bitcast(args[0], _INTS),
                            ir.Constant(_INTS, [(1 << 23) - 1] * LANES))
        return builder.bitcast(builder.or_(bits, ir.Constant(_INTS, [127 << 23] * LANES)),
                               _vector(a))

    return a(a), emit


@intrinsic
def total(_: Any, a: Any) -> Any:
    """Return the sum of all lanes, added in a fixed order."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _halves(builder, args[0], builder.fadd)

    return a.scalar(a), emit


@intrinsic
def totals(_: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any) -> Any:
    """Return the sums of eight vectors as one vector: three rounds instead of 24 additions."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        vectors, size = list(args), 1
        while len(vectors) > 1:
            vectors = [_blocks(builder, vectors[j], vectors[j + 1], size)
                       for j in range(0, len(vectors), 2)]
            size *= 2
        return vectors[0]

    return a(a, b, c, d, e, f, g, h), emit


@intrinsic
def largest(_: Any, a: Any) -> Any:
    """Return the largest lane."""
    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _halves(builder, args[0], lambda low, high: builder.select(
            builder.fcmp_ordered(">", low, high), low, high))

    return a.scalar(a), emit


def _binary(symbol: Any, name: str) -> None:
    """Give Lanes an operator, also with a number of the same type on either side."""
    @intrinsic
    def apply(_: Any, a: Any, b: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return getattr(builder, name)(*args, flags=FLAGS)

        return a(a, b), emit

    @overload(symbol, strict=False)  # the signatures differ in annotations
    def choose(a: Any, b: Any) -> Any:
        if isinstance(a, Lanes) and isinstance(b, Lanes):
            return lambda a, b: apply(a, b)
        if isinstance(a, Lanes) and a.scalar == b:
            return lambda a, b: apply(a, splat(b))
        if isinstance(b, Lanes) and b.scalar == a:
            return lambda a, b: apply(splat(a), b)
        return None


for _symbol, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul"),
                       (operator.truediv, "fdiv")):
    _binary(_symbol, _name)
