"""What photos.py asks of a twin from plain photos: the kit's score, in the frame of its scene.

A scene from photos has a frame and a unit of its own. The truth is carried there by the similarity
that lays the scene's cameras over the true ones, and the kit's score.py reads it like any other.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from geometry_kit import module

from part2gs_robotics.photos.lock import carried

VIEWS, SIZE = 64, 400  # of the kit's own capture, which says what can be seen, as in its suite
EXACT_DEG, EXACT_PCT = 5.0, 5.0  # a joint farther off is no part that was found


def twin_scores(kit: Path, name: str, folder: Path,
                room_from_scene: tuple[float, np.ndarray]) -> dict[str, Any]:
    """Return the kit's figures of the twin of `folder/scene`, which is built where it lacks.

    Args:
        kit: the benchmark kit.
        name: of the object.
        folder: of photos, true cameras and scene.
        room_from_scene: scale and motion that lay the scene over the room.
    """
    twin, log = folder / "twin", folder / "build.log"
    code, seconds = None, None
    if not (twin / "report.json").exists():
        command = [sys.executable, "-m", "part2gs_robotics", "build", str(folder / "scene"),
                   "-o", str(twin)]
        began = time.monotonic()
        with log.open("w") as out:
            code = subprocess.run(command, stdout=out, stderr=out, check=False).returncode
        seconds = round(time.monotonic() - began)
    if not (twin / "twin.xml").exists():
        return {"exit": code, "build_s": seconds}
    score = module(kit, "score").score(twin / "twin.xml",
                                       carried_truth(kit, name, folder, room_from_scene))
    report = json.loads((twin / "report.json").read_text())
    return {"true": score["parts_true"], "found": sum(map(close, score["parts"])),
            "more": score["parts_twin"] - sum(map(close, score["parts"])),
            "axis_deg": score["matched_only"]["angle_deg"],
            "line_pct": score["matched_only"]["line_pct"],
            "miou": score["segmentation"]["miou"], "build_s": seconds,
            "exit": report["exit_code"]}


def close(part: dict[str, Any]) -> bool:
    """Return whether a true part was found: of the right kind, near its axis."""
    return bool(part["matched"] and part["type_ok"] and part["angle_deg"] < EXACT_DEG
                and (part["line_pct"] or 0.0) < EXACT_PCT)


def carried_truth(kit: Path, name: str, folder: Path,
                  room_from_scene: tuple[float, np.ndarray]) -> Path:
    """Return a .gt folder of the kit in the frame of the scene."""
    plain, out = folder / "plain", folder / "scene.gt"
    if not Path(f"{plain}.gt").exists():
        module(kit, "capture").capture(kit / "objects" / source(kit, name), plain, name=name,
                                       views=VIEWS, size=SIZE)
    given = json.loads((Path(f"{plain}.gt") / "gt.json").read_text())
    meshes = dict(np.load(Path(f"{plain}.gt") / "meshes.npz"))
    seen = dict(np.load(Path(f"{plain}.gt") / "visible.npz"))
    cloud = np.concatenate([v for key, v in meshes.items() if key.endswith("_v")])
    low, high = cloud.min(0), cloud.max(0)
    unit, foot = float(np.linalg.norm(high - low)), np.array([*((low + high) / 2)[:2], low[2]])
    scale, move = room_from_scene
    back = np.eye(4)
    back[:3, :3] = move[:3, :3].T
    back[:3, 3] = -move[:3, :3].T @ move[:3, 3] / scale

    def placed(points: np.ndarray) -> np.ndarray:
        return carried((np.asarray(points, float) - foot) / unit, 1 / scale, back)

    for part in given["parts"]:
        part["axis"] = (back[:3, :3] @ np.array(part["axis"])).tolist()
        part["point"] = placed(np.array([part["point"]]))[0].tolist()
        if part["type"] == "prismatic":
            part["motion"] /= unit * scale
    given["bbox_diagonal"] /= unit * scale
    out.mkdir(exist_ok=True)
    (out / "gt.json").write_text(json.dumps(given))
    np.savez(out / "meshes.npz", **{k: placed(v) if k.endswith("_v") else v
                                    for k, v in meshes.items()})
    np.savez(out / "visible.npz", **{k: placed(v) for k, v in seen.items()})
    return out


def source(kit: Path, name: str) -> str:
    """Return the folder of the kit's model of an object."""
    return str(module(kit, "common").load_entry(name)["object"])
