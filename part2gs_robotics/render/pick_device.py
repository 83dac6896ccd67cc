"""Which device renders: picked once by the corridor, looked up at the door of every rendering.

Nothing heavy is imported here. Torch is imported only where an NVIDIA driver is loaded.
"""

from __future__ import annotations

import ctypes
import re
import sys
import warnings
from contextlib import redirect_stdout
from functools import cache
from importlib import metadata
from typing import Literal

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.runtime.device import Device

Wanted = Literal["auto", "cpu", "cuda"]

DRIVER = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"  # comes with the driver alone
# 1.5.3: the release whose rules render_cuda states; 1.4 cuts ellipses at 3 sigma.
GSPLAT = (1, 5, 3)
INSTALL = "pip install 'part2gs-robotics[gpu]'"

def pick_device(wanted: Wanted) -> Device:
    """Return where to render.

    Args:
        wanted: "auto" takes CUDA where it works; "cpu" looks for nothing.

    Raises:
        ConfigError: wanted is "cuda" and something is missing for it.
    """
    if wanted == "cpu":
        return "cpu"
    missing = why_not_cuda()
    if missing is None:
        return "cuda"
    if wanted == "cuda":
        raise ConfigError(
            f"--device is cuda, but {missing}. Expected an NVIDIA GPU with its driver, torch built "
            "with CUDA, and gsplat with the CUDA toolkit (nvcc) that compiles its kernels on first "
            "use; leave --device out, or say --device cpu, to render on the CPU, where a fit takes "
            "minutes rather than seconds.")
    return "cpu"


def describe(wanted: Wanted, device: Device) -> str:
    """Return where images are rendered and why, for the log."""
    if device == "cuda":
        return f"CUDA by gsplat {metadata.version('gsplat')}"
    return "the CPU: " + ("--device is cpu" if wanted == "cpu" else why_not_cuda() or "by choice")


@cache
def why_not_cuda() -> str | None:
    """Return what is missing to render on CUDA, None where a test image could be drawn.

    The cheap questions come first. The last one lets gsplat compile its kernels when it has none
    yet, which takes minutes, once per installation.
    """
    return _no_driver() or _no_gsplat() or _no_torch() or _no_kernels()


def _no_driver() -> str | None:
    try:
        ctypes.CDLL(DRIVER)
    except OSError:
        return f"no NVIDIA driver is loaded ({DRIVER} is not found)"
    return None


def _no_gsplat() -> str | None:
    try:
        version = metadata.version("gsplat")
    except metadata.PackageNotFoundError:
        return f"gsplat is not installed: {INSTALL}"
    if tuple(map(int, re.findall(r"\d+", version)[:3])) < GSPLAT:
        return f"gsplat is {version}, older than {'.'.join(map(str, GSPLAT))}: {INSTALL}"
    return None


def _no_torch() -> str | None:
    import torch

    if torch.version.cuda is None:
        return f"torch {torch.__version__} is built without CUDA"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch warns of what is about to be said
        seen = torch.cuda.is_available()
    return None if seen else f"torch {torch.__version__} finds no CUDA device it can use"


def _no_kernels() -> str | None:
    from part2gs_robotics.render.cuda import draw_one

    # stdout belongs to the build's summary; gsplat tells there that it compiles.
    with warnings.catch_warnings(), redirect_stdout(sys.stderr):
        warnings.simplefilter("ignore")
        try:
            draw_one()
        except Exception as err:  # compilers, loaders and drivers each fail in their own way
            words = " ".join(str(err).split())[:200]
            return f"gsplat draws nothing here ({type(err).__name__}: {words})"
    return None
