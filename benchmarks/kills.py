"""Builds killed at random points, then the same command: is the twin the same, bit for bit?

    python benchmarks/kills.py --count 50 --out benchmarks/results/kills.json

A tiny scene is built once without disturbance. Then, each time in a new folder, a build is killed
one to three times (SIGKILL or SIGINT, at a random moment of its run) and at last let finish. All
files of the twin and all arrays of the stages must be equal; reports and logs tell the time and may
differ.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from toy_scenes import write_tiny_scene

# They tell time or process, and config.yaml the name of the output folder.
TIMED = {"report.html", "report.json", "log.jsonl", "build.lock", "config.yaml"}
SIGNALS = (signal.SIGKILL, signal.SIGINT)


def command(scene: Path, out: Path) -> list[str]:
    """Return the words of one build."""
    return [sys.executable, "-m", "part2gs_robotics", "build", str(scene), "-o", str(out)]


def contents(out: Path) -> dict[str, str]:
    """Return a hash of every file that the same build must leave the same."""
    found = {}
    for path in sorted(out.rglob("*")):
        name = path.relative_to(out).as_posix()
        stage = name.startswith("stages/")
        if path.is_file() and name not in TIMED and (not stage or path.suffix == ".safetensors"):
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def leftovers(out: Path) -> list[str]:
    """Return half-written files that a finished build should have swept away."""
    return [path.name for path in out.rglob("*") if ".tmp-" in path.name or ".new-" in path.name]


def killed(words: Sequence[str], after: float, number: signal.Signals) -> bool:
    """Run words, send a signal after some seconds; return whether it was still running then."""
    # A group of its own, and deaf to nothing: a shell may have made its children deaf to Ctrl-C.
    child = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                             start_new_session=True, preexec_fn=_hear)
    try:
        child.communicate(timeout=after)
        return False
    except subprocess.TimeoutExpired:
        child.send_signal(number)
        _, said = child.communicate(timeout=120)
        if number == signal.SIGINT and child.returncode not in (0, 1):
            assert child.returncode in (130, -signal.SIGINT), (child.returncode, said)
            assert "Traceback" not in said or child.returncode < 0, said
        return True


def _hear() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def campaign(count: int, seed: int, minutes: float) -> dict[str, object]:
    """Return the figures of `count` disturbed builds, fewer where the time is up."""
    rng, until = random.Random(seed), time.monotonic() + 60 * minutes
    sent = {number.name: 0 for number in SIGNALS}
    runs, kills, different = 0, 0, []
    with tempfile.TemporaryDirectory(prefix="kills-") as work:
        scene = write_tiny_scene(Path(work) / "scene")
        began = time.monotonic()
        code = subprocess.run(command(scene, Path(work) / "whole"), capture_output=True).returncode
        whole, seconds = contents(Path(work) / "whole"), time.monotonic() - began
        while kills < count and time.monotonic() < until:
            out = Path(work) / f"out_{runs}"
            for _ in range(rng.choice([1, 2, 3])):
                number = SIGNALS[kills % 2]
                if killed(command(scene, out), rng.uniform(0.05, 1.0) * seconds, number):
                    kills, sent[number.name] = kills + 1, sent[number.name] + 1
            last = subprocess.run(command(scene, out), capture_output=True, text=True)
            same = contents(out) == whole and last.returncode == code and not leftovers(out)
            if not same:
                different.append({"run": runs, "code": last.returncode, "left": leftovers(out),
                                  "files": _differing(contents(out), whole)})
            runs += 1
            shutil.rmtree(out, ignore_errors=True)
    return {"kills": kills, "builds": runs, "signals": sent, "files_compared": len(whole),
            "exit_code": code, "different": different, "cores": os.cpu_count()}


def _differing(one: dict[str, str], two: dict[str, str]) -> list[str]:
    return sorted(name for name in one.keys() | two.keys() if one.get(name) != two.get(name))[:10]


def added(one: dict[str, object], two: dict[str, object]) -> dict[str, object]:
    """Return the figures of two campaigns of different seeds together."""
    signals = {name: one["signals"][name] + two["signals"][name] for name in one["signals"]}
    return {**two, "kills": one["kills"] + two["kills"], "builds": one["builds"] + two["builds"],
            "signals": signals, "different": one["different"] + two["different"],
            "files_compared": min(one["files_compared"], two["files_compared"])}


def main() -> int:
    """Run the campaign and write its figures; 1 if a build came out differently."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=50, help="kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=60.0, help="stop after so many")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--add", action="store_true", help="to the figures in --out; other seed!")
    given = parser.parse_args()
    found = campaign(given.count, given.seed, given.minutes)
    if given.add and given.out:
        found = added(json.loads(given.out.read_text()), found)
    text = json.dumps(found, indent=1) + "\n"
    if given.out:
        given.out.write_text(text)
    sys.stdout.write(text)
    return int(bool(found["different"]))


if __name__ == "__main__":
    sys.exit(main())
