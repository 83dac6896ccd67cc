"""3DGS PLY files: the Gaussians in the layout every splat viewer reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.runtime.atomic import write_bytes_atomic


def write_gaussians_ply(gaussians: Gaussians, path: Path) -> Path:
    """Write Gaussians as binary little-endian 3DGS PLY, atomically; return the file."""
    n, rest = len(gaussians), 3 * gaussians.shN.shape[1]
    names = _properties(rest)
    columns = [
        gaussians.means,
        np.zeros((n, 3), np.float32),
        gaussians.sh0,
        gaussians.shN.transpose(0, 2, 1).reshape(n, rest),  # channel-major: all R, all G, all B
        gaussians.logit_opacities[:, None],
        gaussians.log_scales,
        gaussians.quats,
    ]
    table = np.concatenate([np.asarray(c, "<f4") for c in columns], 1)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    write_bytes_atomic(path, "\n".join(header).encode() + table.astype("<f4").tobytes())
    return path


def _properties(rest: int) -> list[str]:
    return [
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"),
        *(f"f_rest_{i}" for i in range(rest)),
        "opacity",
        *(f"scale_{i}" for i in range(3)),
        *(f"rot_{i}" for i in range(4)),
    ]
