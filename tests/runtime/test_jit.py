"""Where compiled kernels are kept, also when the usual folders cannot be written."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from part2gs_robotics.runtime import jit as render_jit


def test_kernels_compile_where_no_cache_folder_is_writable(tmp_path: Path) -> None:
    # /proc refuses new files even to root, unlike a folder without write permission.
    script = ("import os, numpy as np\nfrom part2gs_robotics import sh\n"
              "z = np.zeros((1, 3)); sh.sh_colors(z, z, np.zeros((1, 0, 3)), np.ones(3))\n"
              "print(os.environ['NUMBA_CACHE_DIR'])")
    environment = {**os.environ, "NUMBA_CACHE_DIR": "/proc/none", "TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0, done.stderr
    folder = Path(done.stdout.strip())
    assert folder.parent == tmp_path
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert list(folder.rglob("*.nbi"))


def test_a_folder_others_can_write_is_not_trusted(tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    first = render_jit._private_temporary_folder()
    assert render_jit._private_temporary_folder() == first
    first.chmod(0o777)
    assert render_jit._private_temporary_folder() != first


def test_a_link_in_place_of_the_folder_is_not_followed(tmp_path: Path,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    (tmp_path / f"part2gs-robotics-numba-{os.getuid()}").symlink_to(target)
    assert render_jit._private_temporary_folder().resolve() != target


def test_compiling_is_timed_and_kept(tmp_path: Path) -> None:
    script = ("import numpy as np\nfrom part2gs_robotics import jit_cache\n"
              "assert jit_cache.compile_seconds() == 0.0\n"
              "from part2gs_robotics import sh\n"
              "z = np.zeros((1, 3)); sh.sh_colors(z, z, np.zeros((1, 0, 3)), np.ones(3))\n"
              "print(jit_cache.compile_seconds(), jit_cache.kept_in())")
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    seconds = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", script], env=environment, text=True,
                              capture_output=True, check=True)
        took, folder = done.stdout.split()
        seconds.append(float(took))
        assert Path(folder) == tmp_path
    assert seconds[0] > 0.05  # LLVM takes tenths of a second
    assert seconds[1] == 0.0  # read from the folder


def test_threads_are_scheduled_by_tbb_where_it_is_installed() -> None:
    script = ("import numpy as np, numba\nfrom part2gs_robotics import render_jit, sh\n"
              "z = np.zeros((1, 3)); sh.sh_colors(z, z, np.zeros((1, 0, 3)), np.ones(3))\n"
              "print(render_jit.load_scheduler(), numba.threading_layer())")
    done = subprocess.run([sys.executable, "-c", script], text=True, capture_output=True,
                          check=True)
    loaded, layer = done.stdout.split()
    assert (layer == "tbb") == (loaded == "True")
