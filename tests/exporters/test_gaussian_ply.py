"""3DGS PLY: exact round trip, layout by name, hostile headers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gaussian_ply_reader import read_gaussians_ply

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.meshfile import write_gaussians_ply
from part2gs_robotics.model.gaussians import Gaussians

HEAD = b"ply\nformat binary_little_endian 1.0\n"


def random_gaussians(count: int, higher: int) -> Gaussians:
    rng = np.random.default_rng(0)
    draw = [rng.normal(size=s).astype(np.float32) for s in ((count, 3), (count, 4), (count, 3))]
    return Gaussians(
        *draw,
        rng.normal(size=count).astype(np.float32),
        rng.normal(size=(count, 3)).astype(np.float32),
        rng.normal(size=(count, higher, 3)).astype(np.float32),
    )


@pytest.mark.parametrize("higher", [0, 3, 8, 15])
@pytest.mark.parametrize("count", [0, 17])
def test_round_trip_is_exact(tmp_path: Path, higher: int, count: int) -> None:
    before = random_gaussians(count, higher)
    after = read_gaussians_ply(write_gaussians_ply(before, tmp_path / "g.ply"))
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh0", "shN"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))


def test_rest_coefficients_are_channel_major(tmp_path: Path) -> None:
    g = random_gaussians(1, 3)
    data = write_gaussians_ply(g, tmp_path / "g.ply").read_bytes()
    row = np.frombuffer(data[data.index(b"end_header\n") + 11 :], "<f4")
    np.testing.assert_array_equal(row[9:12], g.shN[0, :, 0])  # the three red ones first


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"ply\n",
        b"ply\nformat ascii 1.0\nelement vertex 1\nend_header\n",
        HEAD + b"element vertex 99999999\nproperty float x\nend_header\n",
        HEAD + b"element vertex 0\nproperty float x\nend_header\n",
    ],
)
def test_foreign_files_are_refused(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "g.ply").write_bytes(text)
    with pytest.raises(ExportError, match="Needed"):
        read_gaussians_ply(tmp_path / "g.ply")
