"""What this machine has of what the commands need, and what to do about what it lacks."""

from __future__ import annotations

import ctypes.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Literal

from part2gs_robotics import __version__
from part2gs_robotics.runtime.store import NEEDED_BYTES

Status = Literal["ok", "optional", "missing"]

OLDEST_PYTHON = (3, 11)  # as pyproject.toml says
NEEDED_MEMORY = 4 << 30  # bytes: a build of 64 + 64 photos of 512 pixels stays below 3 GB
LIBRARIES = {"GL": "libgl1", "OpenGL": "libopengl0", "X11": "libx11-6", "EGL": "libegl1"}
# Extras: what they are for, and the package that proves them.
EXTRAS = {"photos": ("pycolmap", "scene, build of plain photos"),
          "view": ("viser", "view, build --view"), "masks": ("onnxruntime", "--mask-model"),
          "usd": ("usd-core", "export --format usd"), "gpu": ("gsplat", "rendering on a GPU"),
          "batch": ("ray", "batch --on ray"), "slurm": ("submitit", "batch --on slurm")}
GL_SECONDS = 60  # the first EGL context of a machine compiles shaders
DRAW = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
with mujoco.Renderer(model, 16, 16) as renderer:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer.update_scene(data)
    renderer.render()
"""


@dataclass(frozen=True)
class Finding:
    """One thing looked at: its value, whether it does, and what to do if not."""

    name: str
    status: Status
    value: str
    remedy: str = ""


def examine(place: Path) -> tuple[Finding, ...]:
    """Return what was found, in the order of `doctor`.

    Args:
        place: where results would go.
    """
    return (*_versions(), *_machine(place), *_graphics(), *_extras())


def told(findings: tuple[Finding, ...]) -> str:
    """Return the findings as lines for people."""
    lines = []
    for one in findings:
        mark = {"ok": "ok      ", "optional": "absent  ", "missing": "MISSING "}[one.status]
        remedy = f"; {one.remedy}" if one.remedy else ""
        lines.append(f"{mark}{one.name:31s} {one.value}{remedy}")
    lacking = sum(one.status == "missing" for one in findings)
    lines.append("all that is needed is there" if not lacking else
                 f"{lacking} thing{'s' * (lacking > 1)} missing, see above")
    return "\n".join(lines) + "\n"


def as_data(findings: tuple[Finding, ...]) -> dict[str, object]:
    """Return the findings as plain data for --json."""
    return {"version": __version__, "findings": [asdict(one) for one in findings],
            "ok": not any(one.status == "missing" for one in findings)}


def _versions() -> list[Finding]:
    good = sys.version_info[:2] >= OLDEST_PYTHON
    found = [Finding("part2gs-robotics", "ok", __version__),
             Finding("python", "ok" if good else "missing", platform.python_version(),
                     "" if good else "install Python {}.{} or newer".format(*OLDEST_PYTHON))]
    for line in requires("part2gs-robotics") or []:
        if "extra ==" in line:
            continue
        name = line.split(";")[0].strip()
        name = name[:min([name.find(c) for c in "<>=!~ [" if c in name] or [len(name)])]
        if name == "tbb" and platform.machine() != "x86_64":
            continue
        try:
            found.append(Finding(name, "ok", version(name)))
        except PackageNotFoundError:
            found.append(Finding(name, "missing", "not installed", f"pip install '{name}'"))
    return found


def _machine(place: Path) -> list[Finding]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    limits = [f"{key}={os.environ[key]}" for key in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS",
                                                     "MKL_NUM_THREADS") if key in os.environ]
    found = [Finding("threads", "ok", ", ".join([f"{cores} cores", *limits]))]
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (ValueError, OSError):  # a system that does not say
        memory = NEEDED_MEMORY
    enough = memory >= NEEDED_MEMORY
    found.append(Finding("memory", "ok" if enough else "missing", f"{memory / 2**30:.1f} GB",
                         "" if enough else "lower --max-side and --max-gaussians"))
    for name, folder in (("disk here", place), ("disk for temporary files",
                                                Path(tempfile.gettempdir()))):
        there = next(path for path in (folder.absolute(), *folder.absolute().parents)
                     if path.exists())
        free, writable = shutil.disk_usage(there).free, os.access(there, os.W_OK)
        good = free >= NEEDED_BYTES and writable
        found.append(Finding(name, "ok" if good else "missing", f"{free / 2**30:.1f} GB free"
                             + ("" if writable else ", not writable"),
                             "" if good else "free some space, or work elsewhere"))
    return found


def _graphics() -> list[Finding]:
    found = []
    for name, package in LIBRARIES.items():
        there = ctypes.util.find_library(name)
        found.append(Finding(f"lib{name}", "ok" if there else "missing", there or "not found",
                             "" if there else f"sudo apt-get install {package}"))
    backend = os.environ.get("MUJOCO_GL", "egl")
    try:
        drawn = subprocess.run([sys.executable, "-c", DRAW], capture_output=True, text=True,
                               timeout=GL_SECONDS, env={**os.environ, "MUJOCO_GL": backend})
        good = drawn.returncode == 0
        reason = (drawn.stderr.strip().splitlines() or ["no reason"])[-1]
    except (OSError, subprocess.TimeoutExpired) as err:
        good, reason = False, str(err)
    found.append(Finding("off-screen OpenGL", "ok" if good else "optional",
                         f"MUJOCO_GL={backend}" if good else reason[:100],
                         "" if good else "only capture needs it; make system, or MUJOCO_GL=osmesa"))
    driver = ctypes.util.find_library("cuda")
    found.append(Finding("NVIDIA driver", "ok" if driver else "optional", driver or "none",
                         "" if driver else "the CPU renders"))
    return found


def _extras() -> list[Finding]:
    found = []
    for extra, (package, use) in EXTRAS.items():
        try:
            found.append(Finding(f"extra {extra}", "ok", f"{package} {version(package)}"))
        except PackageNotFoundError:
            found.append(Finding(f"extra {extra}", "optional", f"for {use}",
                                 f"pip install 'part2gs-robotics[{extra}]'"))
    return found
