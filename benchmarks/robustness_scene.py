"""Run a command on a spoiled copy of a scene.

    python benchmarks/robustness_scene.py masks|exposure SCENE COPY COMMAND ...

COPY in the command stands for the copy: the folder COPY, made anew.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
ONE_IN = 20  # masks
SHIFT = 0.15  # of the width, by which a wrong mask is off: no part of it is a photo's noise
GAIN = 1.3  # of state 1's light: a third of a stop and more, clipped where it is bright


def main(words: list[str]) -> int:
    """Make the copy and return the command's exit code."""
    edit, scene, copy = words[0], Path(words[1]), Path(words[2])
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(scene, copy)
    EDITS[edit](copy)
    command = [str(copy) if word == "COPY" else word for word in words[3:]]
    return subprocess.run(command, check=False).returncode


def wrong_masks(scene: Path) -> None:
    """Shift the mask of every twentieth photo, against its colours."""
    for state in ("start", "end"):
        for path in photos(scene, state)[::ONE_IN]:
            image = read(path)
            image[..., 3] = np.roll(image[..., 3], round(SHIFT * image.shape[1]), axis=1)
            cv2.imwrite(str(path), image)


def exposure(scene: Path) -> None:
    """Take state 1 with a longer exposure."""
    for path in photos(scene, "end"):
        image = read(path)
        image[..., :3] = np.clip(np.rint(GAIN * image[..., :3].astype(float)), 0, 255)
        cv2.imwrite(str(path), image)


def photos(scene: Path, state: str) -> list[Path]:
    """Return the photos to learn from of one state, in order."""
    found = sorted((scene / state / "train/rgba").glob("*.png"))
    if not found:
        raise SystemExit(f"{scene}: no {state}/train/rgba/*.png. Expected a scene of the kit.")
    return found


def read(path: Path) -> Image:
    """Return [H, W, 4] BGRA."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None or image.ndim != 3 or image.shape[2] != 4:
        raise SystemExit(f"{path}: no RGBA photo. Expected a scene of the kit.")
    return np.asarray(image, np.uint8)


EDITS: dict[str, Callable[[Path], None]] = {"masks": wrong_masks, "exposure": exposure}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
