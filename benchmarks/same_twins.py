"""Hash the twins of a fixed set of builds, and compare them with those of another commit.

    python benchmarks/same_twins.py --kit KIT --work DIR -o before.json      # at one commit
    python benchmarks/same_twins.py --kit KIT --work DIR -o after.json --against before.json

A change that moves code must leave every number as it was: geometry, joints, limits, masses,
textures and splats are compared byte by byte, on one machine. What says when, how long and where
(reports, logs, settings) and what is said in words (the notes of twin.yaml) is no part of a twin.
The script needs nothing of the package, so it runs at either commit with that commit's
`part2gs-robot`. Scenes in DIR/scenes are used again; builds in DIR/twins are made anew unless
--keep is given.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
# name in the kit -> the model's folder
OBJECTS = {name: name for name in (
    "libero_microwave", "pm_10211_laptop", "robosuite_door", "pm_103275_stapler",
    "pm_102209_trashcan", "libero_wooden_cabinet", "sektion_cabinet", "pm_31249_table",
    "bigym_dishwasher")} | {"robosuite_door_nested": "robosuite_door",
                            "pm_103275_stapler_nested": "pm_103275_stapler"}  # fmt: skip
STANDARD = "sektion_cabinet"
# Of a twin folder; reports and logs tell the time, stages their code.
COMPARED = (".xml", ".urdf", ".obj", ".mtl", ".png", ".ply", ".yaml")
WORDS = ("notes", "build")  # of twin.yaml: sentences, version


def builds(scenes: Path) -> dict[str, list[str]]:
    """Return the words of every build by name; further ways of building than the plain ones."""
    draft = {f"draft_{name}": [str(scenes / name), "--preset", "draft"] for name in OBJECTS}
    microwave, sektion, laptop = (draft[f"draft_{name}"] for name in (
        "libero_microwave", "sektion_cabinet", "pm_10211_laptop"))
    return draft | {
        "standard_microwave": [str(ROOT / "examples/microwave")],
        "standard_sektion_cabinet": [str(scenes / STANDARD)],
        "paper_microwave": [*microwave, "--paper-mode"],
        "paper_sektion": [*sektion, "--paper-mode"],
        "parts2_sektion": [*sektion, "--parts", "2"],
        "noid_laptop": [*laptop, "--no-identity"],
        "noalign_microwave": [*microwave, "--no-alignment"],
    }


def main() -> int:
    """Capture, build, hash; return 1 where a twin differs from the other commit's."""
    args = _arguments()
    for name, model in OBJECTS.items():
        if not (args.work / "scenes" / name).exists():
            _capture(args.kit.resolve(), model, name, args.work / "scenes" / name)
    known = builds(args.work.resolve() / "scenes")
    found: dict[str, dict[str, object]] = {}
    for name in args.only or known:
        out = args.work.resolve() / "twins" / name
        seconds = 0.0 if args.keep and (out / "twin.yaml").exists() else _build(known[name], out)
        found[name] = {"files": hashes(out), "seconds": round(seconds, 1)}
        sys.stdout.write(f"{name}: {len(found[name]['files'])} files, {seconds:.0f} s\n")
    args.out.write_text(json.dumps(found, indent=1) + "\n")
    if args.against is None:
        return 0
    table, same = comparison(json.loads(args.against.read_text()), found)
    sys.stdout.write(table)
    return 0 if same else 1


def hashes(folder: Path) -> dict[str, str]:
    """Return a hash of every file of a twin folder that describes the twin."""
    out = {}
    for path in sorted([*folder.iterdir(), *folder.glob("assets/*")]):
        if path.suffix in COMPARED and path.name != "config.yaml":  # which names the folder
            data = path.read_bytes()
            if path.name == "twin.yaml":
                kept = {k: v for k, v in yaml.safe_load(data).items() if k not in WORDS}
                data = json.dumps(kept, sort_keys=True).encode()
            out[path.name] = hashlib.sha256(data).hexdigest()
    return out


def comparison(before: dict[str, dict[str, object]], after: dict[str, dict[str, object]],
               ) -> tuple[str, bool]:
    """Return a table of the builds that both have, and whether all of them are the same."""
    same = True
    lines = ["| build | files | different | seconds before | after |", "|---|--:|---|--:|--:|"]
    for name in after:
        if name not in before:
            continue
        old, new = dict(before[name]["files"]), dict(after[name]["files"])  # type: ignore[call-overload]
        bad = sorted(key for key in old.keys() | new.keys() if old.get(key) != new.get(key))
        same &= not bad
        lines.append(f"| {name} | {len(new)} | {', '.join(bad) or 'none'} | "
                     f"{before[name]['seconds']} | {after[name]['seconds']} |")
    return "\n".join(lines) + "\n", same


def _build(words: list[str], out: Path) -> float:
    shutil.rmtree(out, ignore_errors=True)
    began = time.monotonic()
    command = [str(Path(sys.executable).with_name("part2gs-robot")), "build", *words, "-o",
               str(out), "--quiet"]
    done = subprocess.run(command, check=False, env=os.environ | {"MUJOCO_GL": "egl"})
    if done.returncode not in (0, 1):  # 1: built, a check fails
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}")
    return time.monotonic() - began


def _capture(kit: Path, model: str, name: str, scene: Path) -> None:
    environment = os.environ | {"MUJOCO_GL": "egl", "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, str(kit / "capture.py"), str(kit / "objects" / model),
                    str(scene), "--states", str(kit / "objects.yaml"), name], check=True,
                   env=environment, stdout=2)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kit", type=Path, required=True, help="folder of the benchmark kit")
    parser.add_argument("--work", type=Path, required=True, help="folder for scenes and twins")
    parser.add_argument("-o", "--out", type=Path, required=True, help="JSON file of hashes")
    parser.add_argument("--against", type=Path, help="JSON file of the other commit")
    parser.add_argument("--keep", action="store_true", help="hash twins that are there already")
    parser.add_argument("--only", nargs="+", help="builds by name")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
