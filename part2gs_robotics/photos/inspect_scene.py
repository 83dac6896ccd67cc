"""What a scene folder holds and how good it is, in seconds, before anybody builds it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config_rooms import ReadConfig
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.photos.frames import sharpness
from part2gs_robotics.photos.posed import eyes, focus
from part2gs_robotics.readers.read_scene import read_scene

SIDE = 400  # px: 64 photos are read and judged in 3 s of one core
BLURRED = 0.35  # of the median sharpness: half of it is a matter of what a view shows
GAP_DEG = 45.0  # between cameras around the object: wider, stereo and hull lack a side
FLAT_DEG = 15.0  # between the lowest and highest camera: less, tops and undersides stay unseen
LIGHT_STEP = 1.3  # brightness of a state's photos: the tenth part on either side differ by more
SMALL_SHARE, CUT_SHARE = 0.05, 0.2  # of the picture (small), of the photos (cut)
APART = 0.005  # of the cameras' distance: good rooms had 0.6 %; four times is poor


@dataclass(frozen=True)
class Inspection:
    """What was found, and what would make it better.

    Attributes:
        found, advice: sentences.
    """

    found: tuple[str, ...]
    advice: tuple[str, ...]


def inspect_scene(path: Path, config: ReadConfig | None = None) -> Inspection:
    """Return what a scene holds; everything `build` would refuse is refused here too.

    Args:
        path: scene folder.
        config: as for `build`; photos are read small whatever it says.

    Raises:
        SceneError: as `read_scene`.
    """
    scene = read_scene(path, replace(config or ReadConfig(), max_side=SIDE, crop=False))
    found = [f"layout {scene.layout}"]
    advice: list[str] = []
    for number, state in enumerate(scene.states):
        facts, hints = _state(state)
        found.append(f"state {number}: {facts}")
        advice += [f"state {number}: {hint}" for hint in hints]
    found += list(_frames(path, scene, advice))
    found += list(scene.notes)
    return Inspection(tuple(found), tuple(advice))


def _state(state: StateViews) -> tuple[str, list[str]]:
    """Return a sentence about a state's photos, and hints."""
    gap, rise = _coverage(state.viewmats)
    sharp = np.array([sharpness(image) for image in state.images])
    blurred = [n for n, s in zip(state.names, sharp, strict=True) if s < BLURRED * np.median(sharp)]
    light = _light(state)
    step = float(np.percentile(light, 90) / max(np.percentile(light, 10), 1e-6))
    inside: NDArray[np.bool_] = np.greater_equal(state.alphas, 128)
    cover = float(np.median(inside.mean((1, 2))))
    rim = np.ones(inside.shape[1:], bool)
    rim[1:-1, 1:-1] = False
    edge = np.asarray((inside & rim).any(axis=(1, 2)))
    facts = (f"{len(state)} photos read at {state.width} x {state.height}; widest gap around "
             f"{gap:.0f} degrees, heights span {rise:.0f} degrees; object fills {cover:.0%}, cut "
             f"by the frame in {int(edge.sum())}; {len(blurred)} blurred; brightest tenth "
             f"{step:.2f} times the darkest")
    return facts, list(_hints(gap, rise, blurred, (step, cover, float(edge.mean()))))


def _hints(gap: float, rise: float, blurred: list[str], shares: tuple[float, float, float],
           ) -> Iterator[str]:
    step, cover, cut = shares
    if gap > GAP_DEG:
        yield f"walk all the way round: {gap:.0f} degrees are seen by no photo"
    if rise < FLAT_DEG:
        yield "take a second round from higher up (40 to 50 degrees)"
    if blurred:
        yield f"take blurred photos again: {', '.join(blurred[:6])}"
    if step > LIGHT_STEP:
        yield "lock exposure and white balance"
    if cover < SMALL_SHARE:
        yield f"go nearer: the object fills {cover:.0%} of the picture"
    if cut > CUT_SHARE:
        yield f"step back: the frame cuts the object in {cut:.0%} of the photos"


def _coverage(viewmats: F64) -> tuple[float, float]:
    """Return the widest gap in azimuth and the span of elevations, degrees, about the focus.

    Up is the direction that cameras at all azimuths share: the smallest spread of their places.
    """
    middle, _ = focus(viewmats)
    away = eyes(viewmats) - middle
    up = np.linalg.svd(away - away.mean(0))[2][2]
    side = np.linalg.svd(np.eye(3) - np.outer(up, up))[0][:, :2]
    turn = np.sort(np.arctan2(away @ side[:, 1], away @ side[:, 0]))
    gaps = np.diff(turn, append=turn[0] + 2 * np.pi)
    rise = np.arcsin(np.clip(away @ up / np.linalg.norm(away, axis=1), -1, 1))
    return float(np.rad2deg(gaps.max())), float(np.rad2deg(np.ptp(rise)))


def _light(state: StateViews) -> F64:
    """Return [V] the mean brightness of the object in each photo."""
    gray: NDArray[np.uint8] = np.stack([cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in state.images])
    weight = (state.alphas >= 128).astype(float)
    return np.asarray((gray * weight).sum((1, 2)) / np.maximum(weight.sum((1, 2)), 1))


def _frames(path: Path, scene: Scene, advice: list[str]) -> Iterator[str]:
    """Yield how the states lie to each other: of the shared points where a file tells of them."""
    file = path / "scene.json"
    try:
        told = json.loads(file.read_text("utf-8")) if file.is_file() else {}
        apart = float(told["states_apart"])
        stayed, error = int(told["points_that_stayed"]), float(told["reprojection_px"])
    except (OSError, ValueError, TypeError, KeyError):
        yield "states lie in one frame as far as their outlines tell"
        return
    _, radius = focus(np.concatenate([state.viewmats for state in scene.states]))
    yield (f"{stayed} points stayed; before they joined the states, each state placed them "
           f"{apart / radius:.2%} of the cameras' distance apart (median); {error:.2f} px after")
    if apart / radius > 4 * APART:
        advice.append("states: put a textured mat or the marker sheet beside the object: what "
                      "stayed is placed poorly")
