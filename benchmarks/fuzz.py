"""Mutated files of scenes and twins: each must be read or refused in words, soon, by exit code 2.

    python benchmarks/fuzz.py --count 20000 --out benchmarks/results/fuzz.json

Every file is one small seeded change of a good one: bits, bytes cut, doubled or swapped, numbers
and words put in the place of others. Cases run in child processes, so that a crash of a library is
counted and not suffered. One case in `WHOLE` is read to the last check, the others as far as what
was mutated: cameras, settings, one picture, one twin.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from toy_scenes import (
    toy_cabinet_twin,
    write_ball_scene,
    write_colmap,
    write_dta,
    write_paris,
)

SLOW = 2.0  # seconds a case may take, as the tests of hostile files
BATCH = 500  # cases per child process
WHOLE = 40  # one case in so many is read with all photos: 0.5 s instead of 0.01 s
SETTINGS = ("parts: 2\nscale: 1.0\nmaterial: hardwood\nup: [0, 0, 1]\nmax_side: 800\n"
            "preset: draft\nallow_missing: true\n")
NASTY = ["", "-1", "0", "1e309", "-1e308", "nan", "NaN", "Infinity", "null", "true", "[]", "{}",
         "9" * 400, "0x10", "1e-320", "'", '"', "\x00", "\ud7ff", "../../../etc/passwd",
         "/dev/zero", "a" * 5000, "[[[[", "]]", "*a", "&a", "!!python/name:os.system", "<!--",
         "%", "\\", "~",
         "2147483648", "-2147483649", "18446744073709551616", "1.5", ":", ",", "- ", "\n", "\t"]
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|\b[A-Za-z_]+\b")


def write_seeds(folder: Path) -> dict[str, Path]:
    """Write one good scene per layout, and a twin; return their folders by kind."""
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.twin_yaml import write_twin_yaml

    seeds = {"artgs": write_ball_scene(folder / "artgs"),
             "nerfstudio": write_ball_scene(folder / "nerfstudio", layout="nerfstudio"),
             "single": write_ball_scene(folder / "single", layout="single"),
             "paris": write_paris(folder / "paris"), "dta": write_dta(folder / "dta"),
             "colmap": write_colmap(folder / "colmap"),
             "colmap text": write_colmap(folder / "colmap text", "txt")}
    for seed in seeds.values():
        (seed / "scene.yaml").write_text(SETTINGS)
    twin = folder / "twin"
    twin.mkdir()
    write_mjcf(toy_cabinet_twin(2), twin)
    write_twin_yaml(toy_cabinet_twin(2), twin)
    return {**seeds, "twin": twin}


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a file's bytes after one to three changes."""
    for _ in range(rng.choice([1, 1, 2, 3])):
        data = _changed(data, rng)
    return data


def _changed(data: bytes, rng: random.Random) -> bytes:
    if not data:
        return rng.randbytes(8)
    at, way = rng.randrange(len(data)), rng.randrange(8)
    end = min(len(data), at + rng.choice([1, 4, 16, 200]))
    if way == 0:
        return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1:]
    if way == 1:
        return data[:at]
    if way == 2:
        return data[:at] + data[end:]
    if way == 3:
        return data[:end] + data[at:]
    if way == 4:
        return data[:at] + rng.randbytes(end - at) + data[end:]
    if way == 5:
        return data[:at] + rng.choice(NASTY).encode("utf-8", "surrogatepass") + data[at:]
    found = list(NUMBER.finditer(data[:100_000]))
    if not found:
        return data[:at] + b"\xff" * 8 + data[at + 8:]
    one = rng.choice(found)
    new = (rng.choice(NASTY).encode("utf-8", "surrogatepass") if way == 6
           else rng.choice(found).group())
    return data[:one.start()] + new + data[one.end():]


def run_case(kind: str, seed: Path, rng: random.Random) -> tuple[str, str, float]:
    """Mutate one file in place, read, and put it back; return what, outcome and seconds.

    Args:
        kind: of the seed.
        seed: its folder.
        rng: says which file, which change, and how much is read.
    """
    files = sorted(path for path in seed.rglob("*") if path.is_file() and path.suffix != ".xml")
    plain = [path for path in files if path.suffix not in (".png", ".jpg")]
    path = rng.choice(plain if rng.random() < 0.75 else files)
    good = path.read_bytes()
    path.write_bytes(mutated(good, rng))
    began = time.process_time()  # of this process: other work on the machine is not ours
    try:
        outcome = _read(kind, seed, path, rng.randrange(WHOLE) == 0)
    finally:
        path.write_bytes(good)
    return path.suffix.lstrip(".") or "none", outcome, time.process_time() - began


def _read(kind: str, seed: Path, path: Path, whole: bool) -> str:
    from part2gs_robotics.config import ReadConfig, resolve
    from part2gs_robotics.errors import Part2GSError
    from part2gs_robotics.exporters.read_twin import read_twin
    from part2gs_robotics.readers import image_files
    from part2gs_robotics.readers.read_scene import read_cameras, read_scene, read_scene_yaml

    try:
        if kind == "twin":
            read_twin(seed)
        elif whole:
            read_scene(seed, resolve({}, read_scene_yaml(seed)).read)
        elif path.suffix == ".png":
            image_files.read_rgba(path)
        elif path.name == "scene.yaml":
            resolve({}, read_scene_yaml(seed))
        else:
            read_cameras(seed, ReadConfig())
    except Part2GSError as err:
        said = str(err)
        good = ("Expected" in said or "Needed" in said or "Nearest" in said) and len(said) < 2500
        return "refused" if good else f"unclear: {said[:200]}"
    except Exception as err:
        return f"raised: {type(err).__name__}: {str(err)[:200]}"
    return "read"


def batch(first: int, count: int) -> None:
    """Run cases in this process and print one JSON line each."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        seeds = write_seeds(Path(folder))
        for number in range(first, first + count):
            rng = random.Random(number)
            kind = rng.choice(sorted(seeds))
            what, outcome, seconds = run_case(kind, seeds[kind], rng)
            sys.stdout.write(json.dumps([number, kind, what, outcome, round(seconds, 3)]) + "\n")
            sys.stdout.flush()


def campaign(count: int, first: int, minutes: float) -> dict[str, object]:
    """Run cases in children until all are done or the time is up; return what happened."""
    until, rows, crashes = time.monotonic() + 60 * minutes, [], []
    done = first
    while done < first + count and time.monotonic() < until:
        size = min(BATCH, first + count - done)
        child = subprocess.run([sys.executable, __file__, "--batch", str(done), str(size)],
                               capture_output=True, text=True)
        lines = [json.loads(line) for line in child.stdout.splitlines()]
        rows += lines
        done += len(lines)
        if len(lines) < size:  # a crash: name the case, go on behind it
            crashes.append([done, child.returncode, child.stderr[-300:]])
            done += 1
    outcomes = Counter(row[3].split(":")[0] for row in rows)
    return {"cases": len(rows), "first_seed": first, "outcomes": dict(sorted(outcomes.items())),
            "by_file": dict(sorted(Counter(row[2] for row in rows).items())),
            "by_kind": dict(sorted(Counter(row[1] for row in rows).items())),
            "slowest_seconds": max((row[4] for row in rows), default=0.0),
            "slow": [row for row in rows if row[4] > SLOW][:20], "crashes": crashes,
            "faults": [row for row in rows if row[3] not in ("read", "refused")][:50]}


def added(one: dict[str, object], two: dict[str, object]) -> dict[str, object]:
    """Return the figures of two campaigns of different seeds together."""
    counts = {key: dict(sorted((Counter(one[key]) + Counter(two[key])).items()))
              for key in ("outcomes", "by_file", "by_kind")}
    lists = {key: one[key] + two[key] for key in ("slow", "crashes", "faults")}
    slowest = max(one["slowest_seconds"], two["slowest_seconds"])
    return {"cases": one["cases"] + two["cases"],
            "first_seed": [one["first_seed"], two["first_seed"]], **counts, **lists,
            "slowest_seconds": slowest}


def main() -> int:
    """Run the campaign and write its figures; 1 if anything was not read or refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first case")
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after so many")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--add", type=Path, help="figures of an earlier run, of other seeds")
    parser.add_argument("--batch", type=int, nargs=2, metavar=("FIRST", "COUNT"))
    given = parser.parse_args()
    if given.batch:
        batch(*given.batch)
        return 0
    found = campaign(given.count, given.first, given.minutes)
    if given.add:
        found = added(json.loads(given.add.read_text()), found)
    text = json.dumps(found, indent=1) + "\n"
    if given.out:
        given.out.write_text(text)
    sys.stdout.write(text)
    return int(bool(found["faults"] or found["crashes"] or found["slow"]))


if __name__ == "__main__":
    sys.exit(main())
