"""Earlier results by content: the same files, program and engine give the same report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, cast

from part2gs_robotics.assets.model_files import home_of
from part2gs_robotics.ci.alone import Request, is_ours
from part2gs_robotics.errors import CheckError
from part2gs_robotics.runtime.atomic import write_text_atomic
from part2gs_robotics.runtime.hashing import code_version, engine_versions, hash_of

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport

# Of a build, and never read by a check
NEVER_READ = {"stages", "report.json", "report.html", "log.jsonl", "build.lock", "config.yaml"}
MOST_BYTES = 1 << 30  # of what an asset may name; hashing more takes longer than checking


def key_of(request: Request, cache: Path | None = None) -> str:
    """Return the hash of everything a report depends on; "" where that cannot be known cheaply.

    That is every file of the folder which nothing the asset names may leave.

    Args:
        request: how the asset is checked.
        cache: folder of earlier results, on which none depends.
    """
    path = Path(request.path)
    main = path / "twin.xml" if path.is_dir() else path
    try:
        home = home_of(main, Path(request.root) if request.root else None)
        own = path.resolve().relative_to(home).as_posix()
        content, size = list[tuple[str, bytes]](), 0
        for file in _read_by_checks(home, main.resolve().parent, cache):
            size += file.stat().st_size
            if size > MOST_BYTES:
                return ""
            content.append((file.relative_to(home).as_posix(), file.read_bytes()))
    except (CheckError, ValueError, OSError):
        return ""  # outside of its home, or no file of ours to read: the check itself says so
    how = {key: value for key, value in asdict(request).items() if key not in ("path", "root")}
    return hash_of("check", code_version(), engine_versions("usd-core"), own, how,
                   sorted(content))


def _read_by_checks(home: Path, own: Path, cache: Path | None) -> Iterator[Path]:
    """Yield the files below an asset's home that its check may read."""
    unread = {own / name for name in NEVER_READ} if is_ours(own) else set()
    unread |= {home / ".git"} | ({cache.resolve()} if cache else set())
    for file in home.rglob("*"):
        if file.is_file() and not unread & {file, *file.parents}:
            yield file


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
