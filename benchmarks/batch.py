"""Many toy scenes as one batch whose workers are killed at random: none lost, none twice.

    python benchmarks/batch.py --on ray --count 50 --out benchmarks/results/batch.json

One scene is poisoned (a torn json). While `part2gs-robot batch` runs, workers and builds below it
are killed by SIGKILL at random. At the end every scene must have one row, every good one a twin
equal bit for bit to that of an undisturbed build, and the same command must find nothing to do.
"""

from __future__ import annotations

import argparse
import csv
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
from collections import Counter
from pathlib import Path

from kills import command, contents
from toy_scenes import write_tiny_scene

POISON = "poison"
WORKER = ("ray::run_job", "part2gs_robotics build")  # what is killed: Ray's workers, and builds


def write_scenes(folder: Path, count: int) -> list[Path]:
    """Write copies of one tiny scene, and a poisoned one; return their folders."""
    first = write_tiny_scene(folder / "scene_000")
    scenes = [first, *(Path(shutil.copytree(first, folder / f"scene_{n:03d}"))
                       for n in range(1, count))]
    poison = Path(shutil.copytree(first, folder / POISON))
    (poison / "transforms_train_end.json").write_text('{"frames": [')
    return [*scenes, poison]


def workers_below(root: int) -> list[int]:
    """Return the processes below one that do the work."""
    parents, names = {}, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2]
                                               .split()[1])
                names[int(entry.name)] = (entry / "cmdline").read_bytes().replace(b"\0", b" "
                                                                                  ).decode()
            except (OSError, ValueError):  # it ended while we looked
                continue
    below = {root}
    while more := {pid for pid, parent in parents.items() if parent in below} - below:
        below |= more
    return [pid for pid in below if any(word in names.get(pid, "") for word in WORKER)]


def disturbed(words: list[str], every: float, rng: random.Random, most: int) -> tuple[int, int]:
    """Run the batch, killing a worker every so many seconds; return exit code and kills."""
    batch, kills = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL), 0
    while batch.poll() is None:
        try:
            batch.wait(rng.uniform(0.3, 1.7) * every)
        except subprocess.TimeoutExpired:
            found = workers_below(batch.pid)
            if found and kills < most:
                try:
                    os.kill(rng.choice(found), signal.SIGKILL)
                    kills += 1
                except ProcessLookupError:
                    continue
    return batch.returncode, kills


def trial(given: argparse.Namespace) -> dict[str, object]:
    """Return what became of the batch."""
    with tempfile.TemporaryDirectory(prefix="batch-") as work:
        scenes = write_scenes(Path(work) / "scenes", given.count)
        whole, twins = Path(work) / "whole", Path(work) / "twins"
        subprocess.run(command(scenes[0], whole), capture_output=True)
        words = [sys.executable, "-m", "part2gs_robotics", "batch", *map(str, scenes), "-o",
                 str(twins), "--on", given.on, "--workers", str(given.workers), "--retries", "20"]
        began = time.monotonic()
        code, kills = disturbed(words, given.every, random.Random(given.seed), given.most)
        seconds = time.monotonic() - began
        again = time.monotonic()
        last = subprocess.run(words, capture_output=True, text=True)
        return {"on": given.on, "scenes": len(scenes), "poisoned": 1, "kills": kills,
                "seconds": round(seconds, 1), "exit_code": code, "cores": os.cpu_count(),
                "again_seconds": round(time.monotonic() - again, 1),
                "again_kept": f"{len(scenes)} of {len(scenes)} scenes are unchanged" in last.stderr,
                **_judged(twins, renamed(whole, scenes[0].name), [s.name for s in scenes])}


def renamed(out: Path, name: str) -> dict[str, str]:
    """Return the contents of a twin as if its scene had a common name."""
    found = contents(out)
    for path in (out / part for part in list(found)):
        if path.suffix in (".xml", ".urdf", ".yaml"):
            text = path.read_bytes().replace(name.encode(), b"scene")
            found[path.relative_to(out).as_posix()] = hashlib.sha256(text).hexdigest()
    return found


def _judged(twins: Path, whole: dict[str, str], names: list[str]) -> dict[str, object]:
    with (twins / "batch.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    good = [row for row in rows if row["name"] != POISON]
    ends = [_finished(twins / row["name"]) for row in good]
    return {"rows": len(rows), "lost": sorted(set(names) - {row["name"] for row in rows}),
            "twice": [name for name, n in Counter(row["name"] for row in rows).items() if n > 1],
            "outcomes": dict(Counter(row["outcome"] for row in rows)),
            "poison": next((row["outcome"] for row in rows if row["name"] == POISON), "lost"),
            "tries": dict(sorted(Counter(row["tries"] for row in good).items())),
            "finished_builds_per_twin": dict(sorted(Counter(ends).items())),
            "different": [row["name"] for row in good
                          if renamed(twins / row["name"], row["name"]) != whole],
            "megabytes_per_twin": round(sum(int(row["bytes"]) for row in good)
                                        / max(1, len(good)) / 1e6, 3)}


def _finished(out: Path) -> int:
    """Return how often a build of this twin went to its end."""
    events = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return sum(event.get("stage") == "export and check" for event in events)


def markdown(found: dict[str, object]) -> str:
    """Return the table of docs/batch.md."""
    kills = json.loads((Path(__file__).parent / "results/kills.json").read_text())
    twins = f"{found['outcomes']['built']} of {found['scenes'] - found['poisoned']}"
    return "\n".join([
        "| trial | scenes or builds | kills | lost | doubled | different | |",
        "|---|--:|--:|--:|--:|--:|---|",
        f"| batch on {found['on']}, {found['cores']} cores shared with others | "
        f"{found['scenes']} | {found['kills']} | {len(found['lost'])} | {len(found['twice'])} | "
        f"{len(found['different'])} | {twins} built, poison {found['poison']}, "
        f"{found['seconds']:.0f} s; the same command again: {found['again_seconds']:.1f} s |",
        f"| single builds | {kills['builds']} | {kills['kills']} | 0 | 0 | "
        f"{len(kills['different'])} | {kills['files_compared']} files of each compared |"]) + "\n"


def main() -> int:
    """Run the trial and write its figures; 1 if a scene was lost, doubled or different."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--on", choices=["local", "ray"], default="ray")
    parser.add_argument("--count", type=int, default=50, help="good scenes")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--every", type=float, default=10.0, help="seconds between kills, about")
    parser.add_argument("--most", type=int, default=1000, help="kills at most")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    found = trial(given)
    text = json.dumps(found, indent=1) + "\n"
    if given.out:
        given.out.write_text(text)
    sys.stdout.write(text)
    return int(bool(found["lost"] or found["twice"] or found["different"]))


if __name__ == "__main__":
    sys.exit(main())
