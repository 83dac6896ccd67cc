"""Earlier results by content: the same files, program and engine give the same report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, cast

from part2gs_robotics.errors import CheckError
from part2gs_robotics.runtime.atomic import write_text_atomic
from part2gs_robotics.runtime.hashing import code_version, engine_versions, hash_of

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport

# Of a build, and never read by a check
NEVER_READ = {"stages", "report.json", "report.html", "log.jsonl", "build.lock", "config.yaml"}
MOST_BYTES = 1 << 30  # of an asset's folder; hashing more takes longer than checking


def key_of(path: Path, *wishes: object) -> str:
    """Return the hash of everything a report depends on; "" where the folder is too large.

    Args:
        path: asset; a single file stands for all files of its folder, which it may name.
        wishes: further arguments of the check.
    """
    root = path if path.is_dir() else path.parent
    files = sorted(file for file in root.rglob("*") if file.is_file()
                   and file.relative_to(root).parts[0] not in NEVER_READ)
    if sum(file.stat().st_size for file in files) > MOST_BYTES:
        return ""
    content = [(file.relative_to(root).as_posix(), file.read_bytes()) for file in files]
    own = "" if path.is_dir() else path.name
    return hash_of("check", code_version(), engine_versions(), own, list(wishes), content)


def load(folder: Path | None, key: str) -> CheckReport | None:
    """Return an earlier report; None where there is none or it is damaged."""
    from part2gs_robotics.sim_checks.result import report_of

    if folder is None or not key:
        return None
    try:
        tree = json.loads((folder / f"{key}.json").read_text("utf-8"))
        return report_of(cast("dict[str, object]", tree))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def kept(folder: Path, key: str, report: CheckReport) -> None:
    """Keep a report.

    Raises:
        CheckError: the folder cannot be made.
        StoreError: the file cannot be written.
    """
    if not key:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise CheckError(f"{folder}: cannot keep results there ({err.strerror}). Needed a folder "
                         "that can be written; choose another one with --cache.") from err
    write_text_atomic(folder / f"{key}.json", json.dumps(report.to_dict(), allow_nan=False))
