"""From a phone's photos to a scene: kit objects on a table in a room, and what is made of them.

    python benchmarks/photos.py --kit FOLDER --work FOLDER [--objects NAME ...] [--build]

Every object stands in two states on a table in a lit room with patterns, path-traced by Mitsuba
(extra `bench`): a hand-held walk in two rounds, noise, exposure steps, JPEG, a printed sheet of
markers on the table. Nothing but the photos is given to `part2gs-robot scene`. Its cameras are
laid over the true ones by one similarity; masks are compared with the true ones. --build builds
the twin as well, and the kit's score.py reads it. Photos, scenes and twins that --work holds are
used again. Without --work the tables of docs/photos.md are made anew from
benchmarks/results/photos.json.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from photos_twin import twin_scores
from reconstruction_suite import git, published

from part2gs_robotics.config_rooms import ReadConfig
from part2gs_robotics.photos.lock import carried, similarity
from part2gs_robotics.photos.make_scene import Wishes, make_scene
from part2gs_robotics.photos.posed import eyes
from part2gs_robotics.readers.read_scene import read_cameras

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/photos.json", ROOT / "docs/photos.md"
MARKS = "<!-- photos:begin -->", "<!-- photos:end -->"
OBJECTS = ("libero_microwave", "sektion_cabinet", "pm_101619_safe", "pm_10211_laptop",
           "pm_102209_trashcan", "libero_wooden_cabinet", "pm_31249_table", "pm_103275_stapler")
COUNT, SIZE, SAMPLES, FOV_DEG = 32, (800, 600), 8, 60.0  # 16 paths: 15 % less noise left
QUALITY, STEPS = 90, (-0.33, 0.0, 0.0, 0.33)  # JPEG; exposure of a photo, stops


def main() -> int:
    """Render what is not there, make scenes, score them, store the numbers, write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kit", type=Path, help="the benchmark kit")
    parser.add_argument("--work", type=Path, help="folder for photos and scenes")
    parser.add_argument("--objects", nargs="+", default=OBJECTS)
    parser.add_argument("--build", action="store_true", help="build and score twins as well")
    args = parser.parse_args()
    rows = {r["object"]: r for r in json.loads(RESULTS.read_text())} if RESULTS.exists() else {}
    for name in args.objects if args.work else ():
        folder = args.work / name
        if not (folder / "truth.json").exists():
            render(args.kit, name, folder)
        before = rows.get(name, {})
        row, room_from_scene = scored(name, folder)
        row["seconds"] = before.get("seconds") if row["seconds"] is None else row["seconds"]
        if args.build:
            row["twin"] = twin_scores(args.kit, name, folder, room_from_scene)
        rows[name] = row
        RESULTS.write_text(json.dumps([rows[n] for n in sorted(rows)], indent=1) + "\n")
    return published(rows, RESULTS, (PAGE, *MARKS), markdown)


def render(kit: Path, name: str, folder: Path) -> None:
    """Write photos_0, photos_1, true masks and true cameras of one object."""
    from photos_room import Room, developed, handheld

    entry = yaml.safe_load((kit / "objects.yaml").read_text())["objects"][name]
    room = Room(kit / "objects" / entry.get("object", name) / "model.xml",
                entry.get("frozen", {}), entry["move"], 0)
    truth: dict[str, Any] = {}
    bright = 0.0
    for state in (0, 1):
        for kind in ("photos", "truth"):
            (folder / f"{kind}_{state}").mkdir(parents=True, exist_ok=True)
        rng = np.random.default_rng([1, state])
        for i, pose in enumerate(handheld(COUNT, room.size, FOV_DEG, rng)):
            linear, mask = room.shoot(state, pose, (FOV_DEG, *SIZE), SAMPLES, 1000 * state + i)
            bright = bright or 0.6 / float(np.percentile(linear, 95))
            photo = developed(linear, bright * 2 ** rng.choice(STEPS), rng)
            cv2.imwrite(str(folder / f"photos_{state}/IMG_{i:04d}.jpg"), photo[..., ::-1],
                        [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            cv2.imwrite(str(folder / f"truth_{state}/IMG_{i:04d}.png"), 255 * mask.astype(np.uint8))
            truth[f"{state}/IMG_{i:04d}.jpg"] = pose.tolist()
    (folder / "truth.json").write_text(json.dumps(truth))


def scored(name: str, folder: Path) -> tuple[dict[str, Any], tuple[float, np.ndarray]]:
    """Return the row of one object, and scale and motion that lay its scene over the room.

    Lengths are in diagonals of the object.
    """
    scene, seconds = folder / "scene", None
    if not scene.exists():
        began = time.monotonic()
        make_scene((folder / "photos_0", folder / "photos_1"), scene, Wishes())
        seconds = round(time.monotonic() - began)
    truth = json.loads((folder / "truth.json").read_text())
    facts = json.loads((scene / "scene.json").read_text())
    _, states = read_cameras(scene, ReadConfig())
    true, found, overlaps = [], [], []
    for state, images in enumerate(states):
        for image in images:
            true.append(truth[f"{state}/{image.path.name}"])
            found.append(image.camera_from_world)
            mask = folder / f"truth_{state}/{image.path.stem}.png"
            overlaps.append(overlap(scene / f"state_{state}/masks/{image.path.stem}.png", mask))
    places, own = np.array(true)[:, :3, 3], eyes(np.array(found))
    scale, move = similarity(places, own)
    off = carried(own, scale, move) - places
    turned = np.array(found)[:, :3, :3] @ move[:3, :3].T @ np.array(true)[:, :3, :3]
    angle = np.rad2deg(np.arccos(np.clip((np.trace(turned, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    first = len(states[0])
    row = {"object": name, "commit": git("rev-parse", "--short", "HEAD"),
            "taken": sum(facts["photos"]), "registered": sum(facts["registered"]),
            "place": round(100 * float(np.median(np.linalg.norm(off, axis=1))), 3),
            "angle_deg": round(float(np.median(angle)), 3),
            "apart": round(100 * float(np.linalg.norm(off[:first].mean(0)
                                                      - off[first:].mean(0))), 3),
            "iou": round(float(np.mean(overlaps)), 4), "worst": round(min(overlaps), 3),
            "scale": scale_error(facts, scale), "seconds": seconds, "cores": os.cpu_count()}
    return row, (scale, move)


def scale_error(facts: dict[str, Any], scale: float) -> float | None:
    """Return by how many per cent the markers' metres are off, None without markers."""
    from_markers = facts["scale"] is not None
    # The room declares how long its object is; `scale` is diagonals per metre of the scene.
    return round(100 * (1 / scale / DIAGONAL_M - 1), 2) if from_markers else None


DIAGONAL_M = 0.6  # as in photos_room.py, which needs Mitsuba to be read


def overlap(one: Path, two: Path) -> float:
    """Return the IoU of two mask files."""
    a, b = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) > 127 for path in (one, two))
    return round(float((a & b).sum() / max((a | b).sum(), 1)), 4)


def markdown(rows: list[dict[str, Any]]) -> str:
    """Return both tables: cameras and masks, then twins."""
    lines = ["| object | photos registered | cameras: place, % | angle, deg | states apart, % "
             "| masks: mean IoU, worst | scale error, % | s | commit |",
             "|---|---|---|---|---|---|---|---|---|"]
    for r in rows:
        scale = "-" if r["scale"] is None else f"{r['scale']:+.2f}"
        lines.append(f"| {r['object']} | {r['registered']} of {r['taken']} | {r['place']:.2f} | "
                     f"{r['angle_deg']:.3f} | {r['apart']:.3f} | {r['iou']:.3f}, {r['worst']:.2f} "
                     f"| {scale} | {figure(r['seconds'], 0)} | {r['commit']} |")
    lines += ["", "| object | parts found | false ones | axis, deg | position, % | mIoU "
              "| exit code | s |", "|---|---|---|---|---|---|---|---|"]
    for r in rows:
        if (t := r.get("twin")) and "found" in t:
            lines.append(f"| {r['object']} | {t['found']} of {t['true']} | {t['more']} | "
                         f"{figure(t['axis_deg'])} | {figure(t['line_pct'])} | {t['miou']:.3f} | "
                         f"{t['exit']} | {figure(t['build_s'], 0)} |")
        elif t:
            lines.append(f"| {r['object']} | no twin | - | - | - | - | {figure(t['exit'], 0)} | "
                         f"{figure(t['build_s'], 0)} |")
    return "\n".join(lines) + "\n"


def figure(value: float | None, digits: int = 2) -> str:
    """Return a number as the tables write it."""
    return "-" if value is None else f"{value:.{digits}f}"


if __name__ == "__main__":
    sys.exit(main())
