"""Where compiled kernels are kept: decided before numba is imported."""

from __future__ import annotations

import os
import sys
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
    if any(_writable(folder) for folder in _numbas_own()):
        return None
    os.environ[VARIABLE] = tempfile.mkdtemp(prefix="part2gs-robot-jit-")
    return ("No folder for compiled kernels can be written, so they are compiled again in every "
            f"build (about half a minute); set {VARIABLE} to a writable folder.")


def kept_in() -> Path:
    """Return the folder that compiled kernels are kept in."""
    wanted = os.environ.get(VARIABLE)
    return Path(wanted) if wanted else next(f for f in _numbas_own() if _writable(f))


def compile_seconds() -> float:
    """Return how long this process has compiled kernels; reading kept ones does not count."""
    # Numba is not imported to ask: where no room has loaded it, nothing was compiled.
    jit = sys.modules.get("part2gs_robotics.runtime.jit")
    return float(jit.CLOCK.duration) if jit is not None and jit.CLOCK.done else 0.0


def _numbas_own() -> tuple[Path, Path]:
    """Return the two places that Numba tries by itself."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "numba"
    return Path(__file__).parent / "__pycache__", cache


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
