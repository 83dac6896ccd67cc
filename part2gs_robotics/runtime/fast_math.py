"""Functions of eight numbers at once: exact in float64, short polynomials in float32."""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numba.extending import overload

from part2gs_robotics.runtime.simd import Lane, exponent, exponential, logarithm, mantissa


def power8(t: Lane) -> Lane:
    """Return exp(8 t) for t in [-ln(255) / 8, 0] in every lane, anything outside.

    Float32: five multiply-adds and three squarings, relative error below 2e-6.
    """
    return np.exp(8 * t)  # outside of compiled code; the overload below is what kernels call


def log_above_one(a: Lane) -> Lane:
    """Return ln(a) for a >= 1 in every lane; float32: absolute error below 1e-6 up to a = e."""
    return np.log(a)


@overload(power8, strict=False)  # the signatures differ in annotations
def _power8(t: Lane) -> object:
    if t.scalar == types.float64:
        return lambda t: exponential(t * 8.0)
    c0, c1, c2, c3, c4, c5 = (np.float32(c) for c in (  # minimax fit of exp(t)
        0.99999993, 0.99999289, 0.49988697, 0.16599301, 0.03980619, 0.00586747))

    def fast(t: Lane) -> Lane:
        p = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
        p = p * p
        p = p * p
        return p * p

    return fast


@overload(log_above_one, strict=False)
def _log_above_one(a: Lane) -> object:
    if a.scalar == types.float64:
        return lambda a: logarithm(a)
    one, two = np.float32(1), np.float32(math.log(2))
    c1, c2, c3, c4, c5, c6, c7 = (np.float32(c) for c in (  # Chebyshev fit of ln(1 + x) to x = 1
        0.99999857, -0.49985899, 0.33097526, -0.2345452, 0.14829413, -0.065590306, 0.013874485))

    def fast(a: Lane) -> Lane:
        x = mantissa(a) - one
        p = c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * (c6 + x * c7)))))
        return exponent(a) * two + x * p

    return fast
