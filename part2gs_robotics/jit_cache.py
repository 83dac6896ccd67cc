"""Where compiled kernels are kept: decided before numba is imported."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from part2gs_robotics.errors import ConfigError

VARIABLE = "NUMBA_CACHE_DIR"


def prepare_jit_cache() -> str | None:
    """Make sure compiled kernels can be kept; returns a note when that costs time.

    Raises:
        ConfigError: NUMBA_CACHE_DIR names a folder that cannot be written.
    """
    wanted = os.environ.get(VARIABLE)
    if wanted is not None:
        if not _writable(Path(wanted)):
            raise ConfigError(f"{VARIABLE} is {wanted!r}, which cannot be written. Expected a "
                              "folder for compiled kernels; correct the variable or unset it.")
        return None
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    package = Path(__file__).parent / "__pycache__"
    if _writable(package) or _writable(cache):  # the two places numba tries by itself
        return None
    os.environ[VARIABLE] = tempfile.mkdtemp(prefix="part2gs-robot-jit-")
    return ("No folder for compiled kernels can be written, so they are compiled again in every "
            f"build (about half a minute); set {VARIABLE} to a writable folder.")


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
