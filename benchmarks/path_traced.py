"""Run a command on a kit scene whose photos are path-traced: the same cameras, light of a room.

    python benchmarks/path_traced.py KIT SCENE COPY COMMAND ...

SCENE was made by the kit's capture.py, its truth lies beside it. COPY in the command stands for the
copy: the folder COPY, painted once. Every photo to learn from is drawn anew by Mitsuba (extra
`bench`) in the room of photos_room.py, without the table, which would hide the object from below:
lamps' soft shadows, light from part to part, gloss, a sensor's noise, JPEG. Cameras, outlines and
truth stay: what differs from the clean scene is light.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import yaml
from photos_room import Room, developed
from robustness_scene import photos

SAMPLES = 4  # paths per pixel: after the denoiser 16 look hardly better, at four times the time
BRIGHT = 0.7  # of the first photo's brightest surfaces: no photo of the object is clipped
QUALITY = 92  # JPEG


def main(words: list[str]) -> int:
    """Make the copy where there is none yet, and return the command's exit code."""
    kit, scene, copy = (Path(word) for word in words[:3])
    if not copy.exists():
        wet = copy.with_name(copy.name + ".wet")
        shutil.rmtree(wet, ignore_errors=True)
        shutil.copytree(scene, wet)
        repaint(kit, json.loads(Path(f"{scene}.gt/gt.json").read_text()), wet)
        wet.rename(copy)
    command = [str(copy) if word == "COPY" else word for word in words[3:]]
    return subprocess.run(command, check=False).returncode


def repaint(kit: Path, told: dict[str, str], scene: Path) -> None:
    """Draw every photo of a scene again, where it lies.

    Args:
        kit: the benchmark kit.
        told: of the object: its folder in the kit, and the entry with its states.
        scene: of both states.
    """
    entry = yaml.safe_load((kit / "objects.yaml").read_text())["objects"][told["entry"]]
    room = Room(kit / "objects" / told["object"] / "model.xml", entry.get("frozen", {}),
                entry["move"], 0, table=False)
    bright = 0.0
    for state, word in enumerate(("start", "end")):
        rng = np.random.default_rng([2, state])
        frames = json.loads((scene / f"transforms_train_{word}.json").read_text())
        lens = (float(np.rad2deg(frames["camera_angle_x"])), frames["w"], frames["h"])
        poses = [f["transform_matrix"] for f in frames["frames"]]
        for n, (path, pose) in enumerate(zip(photos(scene, word), poses, strict=True)):
            linear, mask = room.shoot(state, in_room(room, np.array(pose)), lens, SAMPLES,
                                      1000 * state + n)
            bright = bright or BRIGHT / float(np.percentile(linear[mask], 98))
            jpeg = cv2.imencode(".jpg", developed(linear, bright, rng)[..., ::-1],
                                [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
            image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            image[..., :3] = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
            cv2.imwrite(str(path), image)


def in_room(room: Room, pose: np.ndarray) -> np.ndarray:
    """Return world_from_camera in the room, OpenCV axes, of one of the kit (OpenGL axes)."""
    turned = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    turned[:3, 3] = (turned[:3, 3] - room.foot) / room.unit
    return turned


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
