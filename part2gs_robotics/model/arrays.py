"""Names of arrays in annotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Labels = NDArray[np.int64]  # which part each point belongs to, 0 = base
Mask = NDArray[np.bool_]
