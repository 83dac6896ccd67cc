"""Held-out PSNR over seconds of the same fit with our kernel and with the yardstick."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import raster_naive
from raster_machine import ROOT
from toy_scenes import toy_cabinet_twin, write_ball_scene

from part2gs_robotics.capture.capture import Shots, capture
from part2gs_robotics.config import FitConfig, ReadConfig
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.fit.fit_state import fit_state
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.render import cpu as render_cpu

OBJECTS = ("libero_microwave", "libero_wooden_cabinet", "sektion_cabinet")  # of the kit
VIEWS, SIZE = 64, 400  # as in benchmarks/reconstruction_suite.py
NAMES = ("render", "render_backward")


def shot_scenes(kit: Path, objects: Sequence[str], folder: Path) -> dict[str, StateViews]:
    """Photograph objects of an external kit; return their first state."""
    environment = os.environ | {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl"),
                                "PYTHONDONTWRITEBYTECODE": "1"}  # the kit may be read-only
    for name in objects:
        command = [sys.executable, str(kit / "capture.py"), str(kit / "objects" / name),
                   str(folder / name), "--views", str(VIEWS), "--size", str(SIZE)]
        subprocess.run(command, check=True, env=environment, stdout=sys.stderr)
    return {name: first_state(folder / name) for name in objects}


def made_scenes(folder: Path) -> dict[str, StateViews]:
    """Return the first states of three scenes that need no kit."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    twin = folder / "twin"
    twin.mkdir()
    write_mjcf(toy_cabinet_twin(2), twin)
    capture(twin / "twin.xml", folder / "cabinet", Shots(views=VIEWS, size=SIZE))
    write_ball_scene(folder / "balls", VIEWS, SIZE)
    return {"microwave": first_state(ROOT / "examples/microwave"),
            "cabinet": first_state(folder / "cabinet"), "balls": first_state(folder / "balls")}


def first_state(path: Path) -> StateViews:
    """Read state 0 without its depth images: photos alone are the harder and common case."""
    return replace(read_scene(path, ReadConfig()).states[0], depths=None)


def fits(states: dict[str, StateViews], steps: int) -> dict[str, Any]:
    """Fit each state with both kernels; seconds begin with the first step, after the hull."""
    found = {}
    for name, state in states.items():
        found[name] = {"ours": fit_curve(state, steps, name)}
        with yardstick():
            found[name]["naive"] = fit_curve(state, steps, name)
    return found


def fit_curve(state: StateViews, steps: int, name: str) -> list[list[float]]:
    """Return [seconds, held-out PSNR in dB, Gaussians] at nine moments of a fit."""
    half = min(FitConfig.half_steps, steps // 2)
    curve = fit_state(state, config=FitConfig(steps=steps, half_steps=half), name=name).curve
    return [[seconds - curve[0][0], decibel, count] for seconds, decibel, count in curve]


@contextmanager
def yardstick() -> Iterator[None]:
    """Let every room of the product draw with the yardstick, the same loop around it."""
    ours = {name: getattr(render_cpu, name) for name in NAMES}
    rooms = [room for path, room in list(sys.modules.items())
             if path.startswith("part2gs_robotics.")]
    swapped = [(room, name) for room in rooms for name in NAMES
               if getattr(room, name, None) is ours[name]]
    for room, name in swapped:
        setattr(room, name, getattr(raster_naive, name))
    try:
        yield
    finally:
        for room, name in swapped:
            setattr(room, name, ours[name])
