"""Reader of 3DGS PLY files, for tests: nothing in the product reads what it writes for viewers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ExportError
from part2gs_robotics.model.gaussians import Gaussians

MAX_HEADER_BYTES = 65536  # degree 3 needs 1.5 kB
REST_COUNTS = (0, 9, 24, 45)  # f_rest values of degree 0..3
FIXED = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
         "rot_0", "rot_1", "rot_2", "rot_3")


def read_gaussians_ply(path: Path) -> Gaussians:
    """Read a binary 3DGS PLY.

    Raises:
        ExportError: if the header is not that of a 3DGS file or promises more than the file holds.
    """
    data = path.read_bytes()
    names, count, start = _header(path, data[:MAX_HEADER_BYTES])
    size = 4 * len(names) * count
    if len(data) - start < size:
        raise ExportError(
            f"{path}: the header promises {count} Gaussians of {4 * len(names)} bytes, "
            f"{len(data) - start} bytes follow. Needed a complete file; export it again."
        )
    table = np.frombuffer(data, "<f4", len(names) * count, start).reshape(count, len(names))
    return _gaussians(path, dict(zip(names, table.T, strict=True)))


def _header(path: Path, head: bytes) -> tuple[list[str], int, int]:
    end = head.find(b"end_header\n")
    lines = head[: max(end, 0)].decode("ascii", "replace").splitlines()
    counts = [m for m in (re.match(r"element vertex (\d{1,9})\Z", s) for s in lines) if m]
    names = [s.split()[2] for s in lines if re.match(r"property float \w+\Z", s)]
    binary = "format binary_little_endian 1.0" in lines
    if (
        end < 0
        or lines[0] != "ply"
        or not binary
        or len(counts) != 1
        or len(set(names)) != len(names)
    ):
        raise ExportError(
            f"{path}: not a binary little-endian 3DGS PLY. "
            "Needed one `element vertex` with float properties; export it again."
        )
    return names, int(counts[0].group(1)), end + len(b"end_header\n")


def _gaussians(path: Path, columns: dict[str, NDArray[np.float32]]) -> Gaussians:
    rest = sum(name.startswith("f_rest_") for name in columns)
    needed = (*FIXED, *(f"f_rest_{i}" for i in range(rest)))
    missing = [name for name in needed if name not in columns]
    if missing or rest not in REST_COUNTS:
        raise ExportError(
            f"{path}: properties {missing} are missing, {rest} f_rest values. "
            f"Needed the 3DGS layout with {REST_COUNTS} f_rest values; export it again."
        )

    def stack(*names: str) -> NDArray[np.float32]:
        return np.stack([columns[n] for n in names], 1).astype(np.float32)

    count = len(columns["x"])
    higher = np.zeros((count, 0, 3), np.float32)
    if rest:
        flat = stack(*(f"f_rest_{i}" for i in range(rest)))
        higher = np.ascontiguousarray(flat.reshape(count, 3, rest // 3).transpose(0, 2, 1))
    return Gaussians(
        means=stack("x", "y", "z"),
        quats=stack(*(f"rot_{i}" for i in range(4))),
        log_scales=stack(*(f"scale_{i}" for i in range(3))),
        logit_opacities=columns["opacity"].astype(np.float32),
        sh0=stack("f_dc_0", "f_dc_1", "f_dc_2"),
        shN=higher,
    )
