"""What simcheck says of broken twins: the same sabotage, seen by a checker that knows us not."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
from pathlib import Path

READS = ("twin.xml", "twin_actuated.xml", "scene.xml", "twin.urdf")  # files of a twin it can read
SECONDS = 240  # for one call; a model takes one to three
AT_ONCE = 24  # models per call: one that ends the program takes few others along


def findings(files: list[Path]) -> dict[Path, set[str]]:
    """Return ids of its errors and warnings by file; `ended` where it gave no answer."""
    out: dict[Path, set[str]] = {}
    for k in range(0, len(files), AT_ONCE):
        chunk = files[k:k + AT_ONCE]
        found = _asked(chunk)
        for file in chunk if len(found) != len(chunk) else ():
            found |= _asked([file])
        out |= {f: found.get(f, {"ended"}) for f in chunk}
    return out


def _asked(files: list[Path]) -> dict[Path, set[str]]:
    program = Path(sysconfig.get_path("scripts")) / "simcheck"
    words = [str(program), "check", "--no-config", "--no-cache", "--format", "json", "-j", "1",
             *map(str, files)]
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=SECONDS, check=False)
        said = json.loads(done.stdout)
    except (subprocess.TimeoutExpired, json.JSONDecodeError) as error:
        sys.stderr.write(f"simcheck: {type(error).__name__} on {len(files)} files\n")
        return {}
    rows = said if isinstance(said, list) else [said]
    return {Path(row["asset"]): {f"{f['severity']} {one['id']}" for one in row["results"]
                                 for f in one["findings"] if f["severity"] != "info"}
            for row in rows}


def changed(clean: Path, broken: Path) -> list[str]:
    """Return what of a broken twin simcheck can see: models that changed, or whose meshes did."""
    def differs(name: str) -> bool:
        one, two = clean / name, broken / name
        return two.is_file() and one.read_bytes() != two.read_bytes()

    meshes = sorted(p.relative_to(clean) for p in (clean / "assets").glob("*"))
    models = [n for n in READS if differs(n)]
    if "twin.xml" in models:  # the same with servos says nothing new
        models = [n for n in models if n != "twin_actuated.xml"]
    if any(not (broken / m).is_file() or differs(str(m)) for m in meshes):
        models += [n for n in ("twin.xml", "twin.urdf") if n not in models
                   and (broken / n).is_file()]
    return models


def verdicts(clean: Path, broken: dict[str, Path]) -> dict[str, str]:
    """Return by kind whether simcheck finds something new: caught, passed, or not read.

    Args:
        clean: folder of the good twin.
        broken: folders by kind.
    """
    own = findings([clean / n for n in READS])
    seen = {kind: changed(clean, folder) for kind, folder in broken.items()}
    told = findings([broken[k] / n for k, names in seen.items() for n in names])
    out = {}
    for kind, names in seen.items():
        new = any(told[broken[kind] / n] - own[clean / n] for n in names)
        out[kind] = "not read" if not names else "caught" if new else "passed"
    return out
