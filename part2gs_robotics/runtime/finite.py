"""Numbers that must be finite: what is not stops with the term that broke."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import FitError


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
