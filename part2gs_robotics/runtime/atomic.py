"""Files that are whole or absent, whatever happens while they are written."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path

from part2gs_robotics.errors import StoreError


def write_bytes_atomic(path: Path, data: bytes) -> None:
    """Write a file so that a reader sees the old content or the new, never a part.

    Raises:
        StoreError: the folder is full, read-only or gone; the old file is untouched.
    """
    temp = path.with_name(f"{path.name}.tmp-{os.getpid()}")
    try:
        with temp.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temp, path)
        sync_folder(path.parent)
    except OSError as err:
        remove_quietly(temp)
        raise write_error(path, err) from err


def write_text_atomic(path: Path, text: str) -> None:
    """Write UTF-8 text as `write_bytes_atomic` does."""
    write_bytes_atomic(path, text.encode("utf-8"))


def sync_folder(folder: Path) -> None:
    """Make a rename durable: the folder's own entry table reaches the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def remove_quietly(path: Path) -> None:
    """Clean up after a failure that is already being reported."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return  # read-only folder: the temp could not have been created either


def write_error(path: Path, err: OSError) -> StoreError:
    """Return the four-part message for a failed write."""
    hints = {errno.ENOSPC: "free some space", errno.EDQUOT: "free some of your quota",
             errno.EROFS: "choose another folder with -o"}
    hint = hints.get(err.errno or 0, "check permissions or choose another folder with -o")
    return StoreError(f"{path}: cannot be written ({err.strerror or err}). Expected a writable "
                      f"folder with free space; {hint}. Earlier results are untouched; the same "
                      "command continues.")


def replace_files(out: Path, write: Callable[[Path], object]) -> list[Path]:
    """Let a writer fill an empty folder, then move its files to `out`; return them there.

    A writer that fails leaves `out` as it was. Models follow the meshes they name.

    Raises:
        StoreError: if `out` cannot be written.
    """
    fresh = out / f".new-{os.getpid()}"
    late = (".xml", ".urdf", ".sdf", ".usd", ".xacro")
    try:
        made = not out.exists()
        fresh.mkdir(parents=True)
        try:
            write(fresh)
            files = sorted((file for file in fresh.rglob("*") if file.is_file()),
                           key=lambda file: (file.suffix in late, str(file)))
            placed = [out / file.relative_to(fresh) for file in files]
            for file, place in zip(files, placed, strict=True):
                place.parent.mkdir(parents=True, exist_ok=True)
                os.replace(file, place)
            made = False
            return placed
        finally:
            remove_quietly(fresh)
            if made:
                remove_quietly(out)
    except OSError as err:
        raise write_error(out, err) from err
