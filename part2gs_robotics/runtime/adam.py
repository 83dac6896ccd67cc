"""Adam: one fused pass per parameter array; rows can be added and removed.

What is not finite stops a descent, with the term that broke.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import FitError
from part2gs_robotics.runtime.for_each import for_each
from part2gs_robotics.runtime.jit import inlined, kernel

Floats = NDArray[np.floating]
Arrays = dict[str, Floats]

LARGEST = 1e18  # of a gradient: its square fits float32, infinite moments would stay so


@dataclass
class Adam:
    """Moments of several parameter arrays, whose first axis may grow and shrink.

    Attributes:
        rates: learning rate of each array.
        epsilon: added to the root of the mean square, in units of the gradient.
        betas: how much of the running means is kept in a step.
        first, second: running means of the gradient and of its square, as the arrays.
        steps: updates done; a row added later shares the count and takes larger first steps.

    By Cauchy-Schwarz |m| <= sqrt(v) (1 - b1) / sqrt((1 - b2) (1 - b1^2 / b2)), and the bias terms
    never add to it: with the usual betas no step exceeds 7.27 rates, whatever the gradients and
    whenever a row came.
    """

    rates: dict[str, float]
    epsilon: float = 1e-15  # 3DGS: the gradients of means are far below 1e-8 in small scenes
    betas: tuple[float, float] = (0.9, 0.999)
    first: Arrays = field(default_factory=dict)
    second: Arrays = field(default_factory=dict)
    steps: int = 0

    def step(self, params: Arrays, grads: Arrays) -> None:
        """Update `params` in place.

        Equation: m = b1 m + (1 - b1) g; v = b2 v + (1 - b2) g^2;
        p -= rate * (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + eps).
        Source: Kingma and Ba 2015, algorithm 1.
        """
        self.steps += 1
        one, two = self.betas
        fix1, fix2 = 1 - one**self.steps, 1 - two**self.steps
        for name, grad in grads.items():
            value = params[name]
            if name not in self.first:
                self.first[name] = np.zeros(value.shape, value.dtype)
                self.second[name] = np.zeros(value.shape, value.dtype)
            flat = value.reshape(-1)  # a copy where columns lie one after another
            _update(flat, grad.reshape(-1), self.first[name].reshape(-1),
                    self.second[name].reshape(-1), self.rates[name] / fix1, 1 / fix2**0.5,
                    1 - one, 1 - two, self.epsilon)
            if not value.flags.c_contiguous:
                value[...] = flat.reshape(value.shape)

    def select(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Keep the moments of the rows picked by a mask or by indices."""
        for moments in (self.first, self.second):
            for name, value in moments.items():
                moments[name] = np.ascontiguousarray(value[index])

    def append(self, count: int) -> None:
        """Add `count` rows with zero moments."""
        for moments in (self.first, self.second):
            for name, value in moments.items():
                rows = np.zeros((count, *value.shape[1:]), value.dtype)
                moments[name] = np.concatenate([value, rows])


def direction(moments: tuple[Floats, Floats], gradient: Floats, step: int,
              betas: tuple[float, float], epsilon: float) -> Floats:
    """Return what Adam subtracts per unit of the rate, and update the moments in place.

    The same as `Adam.step` up to rounding, in the dtype of the gradient throughout: for labels
    that exact ties decide, which arithmetic in float64 would break.

    Args:
        moments: running means of the gradient and of its square, zero at first.
        gradient: as the moments.
        step: updates done before.
        betas: how much of the running means is kept in a step.
        epsilon: in units of the gradient.
    """
    (first, second), (one, two) = moments, betas
    first += (1.0 - one) * (gradient - first)
    second += (1.0 - two) * (gradient * gradient - second)
    unbiased = first / (1.0 - one ** (step + 1))
    scale = np.sqrt(second / (1.0 - two ** (step + 1))) + epsilon
    return np.asarray(unbiased / scale, gradient.dtype)


def require_finite(values: dict[str, float | NDArray[np.floating]], name: str, step: int) -> None:
    """Stop with the state, step and term when a loss or parameter is NaN or infinite.

    Raises:
        FitError: naming the first such term.
    """
    for term, value in values.items():
        if not np.isfinite(value).all():
            bad = int(np.size(value) - np.isfinite(value).sum())
            raise FitError(f"{name}, step {step}: {bad} of {np.size(value)} values of '{term}' are "
                           "NaN or infinite. Expected finite numbers; check the poses and images "
                           "of this state, or try another --seed.")


@kernel
def _update(value: Floats, grad: Floats, first: Floats, second: Floats, rate: float,
            root: float, new1: float, new2: float, epsilon: float) -> None:
    limit = grad.dtype.type(LARGEST)
    for_each(value.size, _update_at, (value, grad, first, second, rate, root, new1, new2, epsilon,
                                      limit))


@inlined
def _update_at(i: int, value: Floats, grad: Floats, first: Floats, second: Floats, rate: float,
               root: float, new1: float, new2: float, epsilon: float, limit: float) -> None:
    g = grad[i]
    if g > limit:
        g = limit
    elif g < -limit:
        g = -limit
    m = first[i] + new1 * (g - first[i])
    v = second[i] + new2 * (g * g - second[i])
    first[i], second[i] = m, v
    value[i] -= rate * m / (np.sqrt(v) * root + epsilon)
