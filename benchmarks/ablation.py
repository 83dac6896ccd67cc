"""Ablation of the paper's terms: vanilla, + parts, + repel, + physics, ours; printed and corrected.

    python benchmarks/ablation.py --kit PATH --work FOLDER [--scenes FOLDER] [--objects NAME ...]

The kit renders objects and scores surfaces; FOLDER keeps scenes, fits and one JSON per run, so that
the same command continues. All variants of an object and seed share fits and decided motions, and
are scored without meshing (see ablation_score.py). Without --kit tables and figure are made anew
from benchmarks/results/ablation.json.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from ablation_report import RESULTS, publish, summary
from ablation_score import averaged, kit_of, scored
from ablation_variants import AVERAGED, variants

from part2gs_robotics.articulate import Clock, found_motions, settled_motion
from part2gs_robotics.config import ArticulateConfig, FitConfig, ReadConfig
from part2gs_robotics.errors import Part2GSError
from part2gs_robotics.evidence.canonical import canonical
from part2gs_robotics.fit.fit_state import fit_state
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.scene_frame import (
    frame_of,
    gaussians_in_scene,
    internal,
    joint_in_scene,
)
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.runtime.hashing import hash_of
from part2gs_robotics.runtime.store import Store, write_text_atomic
from part2gs_robotics.stages import Fitted, load_fit, save_fit

OBJECTS = ("sektion_cabinet", "libero_wooden_cabinet", "pm_31249_table")


def main() -> int:
    """Run what is missing, then write results, tables and figure."""
    args = arguments()
    if args.kit and not args.work:
        sys.stderr.write("--work is missing. Expected a folder that keeps scenes and fits.\n")
        return 2
    if args.kit:
        kit, failed = kit_of(args.kit.resolve()), []
        for name in args.objects:
            for seed in args.seeds:
                try:
                    run_seed(kit, scene_of(args, name), args.work / name / f"seed_{seed}", seed)
                except Part2GSError as err:  # one failure must not stop the others
                    failed.append(f"{name}, seed {seed}: {err}")
                    sys.stderr.write(f"{failed[-1]}\n")
        runs = list(runs_in(args.work, args.objects, args.seeds))
        options = {"views": args.views, "size": args.size, "seeds": args.seeds,
                   "objects": args.objects, "failed": failed}
        RESULTS.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(RESULTS, json.dumps(summary(runs, options), indent=1) + "\n")
    if not RESULTS.exists():
        sys.stderr.write(f"{RESULTS}: not there yet. Expected an earlier run; give --kit PATH.\n")
        return 2
    sys.stdout.write(publish(json.loads(RESULTS.read_text())))
    return 0


def arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    parser.add_argument("--work", type=Path, help="folder for scenes, fits and runs; kept")
    parser.add_argument("--scenes", type=Path, help="scenes of that kit, if rendered already")
    parser.add_argument("--objects", nargs="+", default=list(OBJECTS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--views", type=int, default=64)
    parser.add_argument("--size", type=int, default=400)
    return parser.parse_args()


def scene_of(args: argparse.Namespace, name: str) -> Path:
    """Return the scene of an object, rendered by the kit if it is not there."""
    for folder in (args.scenes, args.work / "scenes"):
        if folder and (folder / f"{name}.gt/gt.json").exists():
            return Path(folder / name).resolve()
    scene = (args.work / "scenes" / name).resolve()
    subprocess.run([sys.executable, "-B", str(args.kit.resolve() / "capture.py"),
                    str(args.kit.resolve() / "objects" / name), str(scene),
                    "--views", str(args.views), "--size", str(args.size)], check=True)
    return scene


def run_seed(kit: ModuleType, path: Path, folder: Path, seed: int) -> None:
    """Run and score every variant that has no JSON yet in the folder."""
    wanted = variants(seed)
    missing = [name for name in wanted if not (folder / f"{name}.json").exists()]
    if not missing:
        return
    # Photos alone, as in the published protocol, also where the scene has depth images.
    scene = read_scene(path, ReadConfig(depth=False))
    store = Store(folder)
    store.prepare()
    with store.locked():
        began = time.monotonic()
        frame = frame_of(scene)  # as a build does: rooms work in internal units
        scene = internal(scene, frame)
        gaussians = fits(scene, store, seed)
        both = canonical(scene, gaussians)
        decided = found_motions(both, ArticulateConfig(seed=seed))
        placed = (gaussians_in_scene(gaussians[0], frame), gaussians_in_scene(gaussians[1], frame))
        say(path.name, seed, f"{len(decided.candidate)} motions", time.monotonic() - began)
        truth = kit.GroundTruth(Path(f"{path}.gt"))
        for name in missing:
            began = time.monotonic()
            motion = settled_motion(both.scene, replace(decided, clock=Clock(None)), wanted[name])
            seconds = time.monotonic() - began
            surface = averaged(placed) if name == AVERAGED else (placed, (0, 1))
            joints = tuple(joint_in_scene(joint, frame) for joint in motion.joints)
            found = scored(kit, truth, surface[0], replace(motion, joints=joints), surface[1])
            kept = [row.get("physics_kept", 0.0) for row in motion.diagnostics]
            row = {"object": path.name, "seed": seed, "variant": name, "seconds": seconds,
                   "joints_pulled": sum(kept), **found}
            write_text_atomic(folder / f"{name}.json", json.dumps(row, indent=1) + "\n")
            say(path.name, seed, name, time.monotonic() - began)


def fits(scene: Scene, store: Store, seed: int) -> tuple[Gaussians, Gaussians]:
    """Return the Gaussians of both states, kept in the store."""
    config = FitConfig(seed=seed, device="cpu")
    both = []
    for index, state in enumerate(scene.states):

        def compute(state: Any = state, index: int = index) -> Fitted:
            done = fit_state(state, None, config, name=f"state {index}")
            return done.gaussians, tuple((t, db) for t, db, _ in done.curve), done.gains

        # Code is no part of the key: one ablation is one set of fits, whatever is edited meanwhile.
        key = hash_of("ablation", asdict(config), state.images.shape)
        both.append(store.stage(f"0{index + 1}_fit_{index}", key, compute, save_fit, load_fit)[0])
    return both[0], both[1]


def runs_in(work: Path, objects: list[str], seeds: list[int]) -> Iterator[dict[str, Any]]:
    """Yield the stored runs."""
    for name in objects:
        for seed in seeds:
            for variant in variants(seed):
                path = work / name / f"seed_{seed}" / f"{variant}.json"
                if path.exists():
                    yield json.loads(path.read_text())


def say(*words: object) -> None:
    """Write one line of progress; the last word is seconds."""
    sys.stdout.write(f"{', '.join(map(str, words[:-1]))}: {words[-1]:.1f} s\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
