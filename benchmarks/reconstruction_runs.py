"""One build, run and scored by the external kit: its numbers, its stages and its own curve."""

from __future__ import annotations

import json
import shutil
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from reconstruction_suite import COMMAND, git, run_kit, summary_row

# What the kit counts as dev: two of them have published numbers.
OBJECTS = (
    "pm_10211_laptop", "pm_31249_table", "sektion_cabinet", "libero_microwave",
    "libero_wooden_cabinet", "robosuite_door", "pm_103275_stapler", "pm_102209_trashcan",
    "bigym_dishwasher",
)  # fmt: skip
CHAMFERS = {"cd_s": "static", "cd_w": "whole"}  # our name: the kit's


def words_of_kit(doc: str | None, work: Path, objects: Sequence[str]) -> ArgumentParser:
    """Return the command line that every benchmark with the kit has."""
    words = ArgumentParser(description=(doc or "").splitlines()[0])
    words.add_argument("--kit", type=Path, help="folder of the benchmark kit")
    words.add_argument("--work", type=Path, default=work, help="folder for scenes, builds and rows")
    words.add_argument("--objects", nargs="+", default=list(objects))
    words.add_argument("--cmd", default=COMMAND, help="command with {scene} and {out}")
    return words


def run_once(args: Namespace, work: Path, name: str, flags: Sequence[str], *,
             fresh: bool = True) -> dict[str, Any]:
    """Build one object with flags, score the twin, and return its row.

    Args:
        args: `kit`, `cmd`, `views`, `size` and `seed`.
        work: scenes are rendered there once and kept.
        name: of the object.
        flags: put after the command.
        fresh: start from nothing; else stages that these flags do not touch are taken over.
    """
    if fresh:
        for out in folders(work, name):
            shutil.rmtree(out)
    command = " ".join([args.cmd, *flags])
    one = Namespace(kit=args.kit, objects=[name], views=args.views, size=args.size,
                    seed=args.seed, cmd=command)
    work.mkdir(parents=True, exist_ok=True)
    found = run_kit(one, work)
    built = folders(work, name)
    row = found["rows"][0]  # type: ignore[index]
    return row_of(row, built[0] if built else work) | {
        "flags": list(flags), "options": found["options"],
        "commit": git("rev-parse", "--short", "HEAD")}


def folders(work: Path, name: str) -> list[Path]:
    """Return the output folders of an object, newest first."""
    found = [path for path in work.glob(f"runs/*/{name}") if path.is_dir()]
    return sorted(found, key=lambda path: -path.stat().st_mtime)


def row_of(row: dict[str, Any], out: Path) -> dict[str, Any]:
    """Return the numbers of one build: the kit's score and the build's own report."""
    score = row.get("score") or {}
    missed = score.get("with_misses") or {}
    report = _json(out / "report.json")
    scene = report.get("scene", {})
    psnr = [scene[key] for key in ("held_out_psnr_0", "held_out_psnr_1") if key in scene]
    return summary_row(row) | {
        "missed": {key: missed.get(key) for key in ("angle_deg", "line_pct", "motion_deg",
                                                    "motion_units", "cd")},
        **{f"{ours}{floor}": (score.get(theirs) or {}).get(f"cd{floor}")
           for ours, theirs in CHAMFERS.items() for floor in ("", "_floor")},
        "cd_m": (score.get("matched_only") or {}).get("cd"),
        "cd_m_floor": (score.get("moving_floor") or {}).get("cd"),
        "psnr_db": sum(psnr) / len(psnr) if psnr else None,
        "curve": curve(report),
        "stages": stages(out),
    }


def curve(report: dict[str, Any]) -> list[list[float]]:
    """Return [seconds, dB] of both fits together: times add up, dB are averaged."""
    curves = report.get("curves", [])
    count = min((len(one["seconds"]) for one in curves), default=0)
    return [[sum(one["seconds"][k] for one in curves),
             sum(one["psnr_db"][k] for one in curves) / len(curves)] for k in range(count)]


def stages(out: Path) -> dict[str, dict[str, Any]]:
    """Return the seconds of every stage of the last build, and whether it was taken over."""
    found: dict[str, dict[str, Any]] = {}
    log = out / "log.jsonl"
    for line in log.read_text().splitlines() if log.exists() else ():
        event = json.loads(line)
        if event.get("event") != "stage":
            continue
        if event["stage"] == "read":  # the first stage of a build: what came before is an older one
            found = {}
        found[event["stage"]] = {"seconds": event["seconds"], "resumed": event["resumed"]}
    return found


def kept(path: Path, key: dict[str, Any], make: Any) -> dict[str, Any]:
    """Return the row of a file made with the same key, or make it and keep it.

    An interrupted benchmark goes on with the first row that is not there.
    """
    stored = _json(path)
    if stored.get("key") == key:
        return dict(stored["row"])
    row = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps({"key": key, "row": row}, indent=1))
    part.replace(path)
    return dict(row)


def _json(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text())) if path.exists() else {}
