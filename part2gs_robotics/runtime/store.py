"""The output folder: resumable stages, one build at a time, results replaced only by whole ones."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import StoreError
from part2gs_robotics.runtime.atomic import (
    remove_quietly,
    sync_folder,
    write_bytes_atomic,
    write_error,
    write_text_atomic,
)
from part2gs_robotics.runtime.device import give_back

__all__ = ["Saved", "Store", "read_stage", "write_bytes_atomic",
           "write_stage", "write_text_atomic"]

T = TypeVar("T")
Arrays = dict[str, NDArray[np.generic]]

LOCK = "build.lock"
STAGES = "stages"
NEW_PREFIX = ".new-"
PUBLISHED = "published.json"  # files of the last good build
TEMP_PID = re.compile(r"(?:\.tmp-|^\.new-)(\d+)$")
_OWN_FILE = re.compile(r"(?:\w[\w-]*/)?\w[\w.-]*")
# measured: 64 + 64 views at 400 x 400 leave about 60 MB of stages and 40 MB of twin
NEEDED_BYTES = 256 << 20


@dataclass(frozen=True)
class Saved:
    """What a stage leaves on disk: arrays (safetensors) and plain data (json)."""

    arrays: Arrays
    data: dict[str, object]


class Store:
    """The output folder of one build.

    Attributes:
        out: output folder.
        resumed: names of the stages that were loaded instead of computed.
    """

    def __init__(self, out: Path) -> None:
        """Remember the folder; nothing is written before `prepare`."""
        self.out = out
        self.resumed: list[str] = []

    def prepare(self) -> None:
        """Create the folder, prove that it can be written and has room.

        Raises:
            StoreError: not a folder, not writable, or too little free space.
        """
        try:
            (self.out / STAGES).mkdir(parents=True, exist_ok=True)
        except OSError as err:
            raise write_error(self.out / STAGES, err) from err
        probe = self.out / f"probe.tmp-{os.getpid()}"
        write_bytes_atomic(probe, b"writable")
        remove_quietly(probe)
        free = shutil.disk_usage(self.out).free
        if free < NEEDED_BYTES:
            raise StoreError(f"{self.out}: {free >> 20} MB free. Expected at least "
                             f"{NEEDED_BYTES >> 20} MB; free some space or choose another folder "
                             "with -o.")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder for this process.

        The kernel releases the lock with its process, so one left by a killed build is free.

        Raises:
            StoreError: another build is running in this folder.
        """
        path = self.out / LOCK
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as err:
            raise write_error(path, err) from err
        try:
            self._take(handle)
            os.ftruncate(handle, 0)
            os.pwrite(handle, f"pid {os.getpid()} on {socket.gethostname()}".encode(), 0)
            self._sweep()
            yield
        finally:
            os.close(handle)

    def refuse_early(self) -> None:
        """Refuse what can be seen without writing: a file, a read-only place, another build.

        Raises:
            StoreError: naming what is in the way.
        """
        place = next(path for path in (self.out, *self.out.absolute().parents) if path.exists())
        if not place.is_dir():
            raise StoreError(f"{place}: is a file. Expected an output folder; choose another name "
                             "with -o.")
        if not os.access(place, os.W_OK | os.X_OK):
            raise write_error(self.out, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        try:
            handle = os.open(self.out / LOCK, os.O_RDWR)
        except OSError:
            return  # nothing to hold: `prepare` and `locked` say what is wrong with the folder
        try:
            self._take(handle)
        finally:
            os.close(handle)

    def _take(self, handle: int) -> None:
        import fcntl

        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as err:
            holder = os.pread(handle, 200, 0).decode("utf-8", "replace") or "an unknown process"
            raise StoreError(f"{self.out}: another build is running here ({holder}). Expected "
                             "one build per output folder; wait for it, stop it, or choose "
                             "another folder with -o.") from err

    def _sweep(self) -> None:
        """Remove what killed builds left half-written; the lock proves they are gone."""
        for folder in (self.out, self.out / STAGES):
            for item in folder.iterdir():
                if TEMP_PID.search(item.name):
                    remove_quietly(item)

    def stage(self, name: str, key: str, compute: Callable[[], T],
              save: Callable[[T], Saved], load: Callable[[Saved], T]) -> T:
        """Return the result of a stage: loaded when its key is unchanged, else computed and saved.

        Args:
            name: folder name, NN_name.
            key: hash of everything the result depends on.
            compute: makes the result.
            save: result to arrays and plain data.
            load: the inverse of `save`.
        """
        folder = self.out / STAGES / name
        saved = read_stage(folder, key)
        if saved is not None:
            self.resumed.append(name)
            return load(saved)
        give_back()  # what the stage before held
        result = compute()
        write_stage(folder, key, save(result))
        return result

    @contextmanager
    def new_files(self) -> Iterator[Path]:
        """Yield an empty folder; on success its files replace those in OUT one by one.

        A failing build leaves the files of the last good one as they were.
        """
        fresh = self.out / f"{NEW_PREFIX}{os.getpid()}"
        try:
            fresh.mkdir()
        except OSError as err:
            raise write_error(fresh, err) from err
        try:
            yield fresh
            self._publish(fresh)
        except OSError as err:  # a writer met a full or failing disk
            raise write_error(fresh, err) from err
        finally:
            remove_quietly(fresh)

    def _publish(self, fresh: Path) -> None:
        record = self.out / STAGES / PUBLISHED
        # meshes first, the models that name them last: a kill in between leaves models that load
        late = (".xml", ".urdf", ".yaml", ".json", ".html")
        files = sorted((file for file in fresh.rglob("*") if file.is_file()),
                       key=lambda file: (file.suffix in late, str(file.relative_to(fresh))))
        names = [file.relative_to(fresh).as_posix() for file in files]
        try:
            for file in files:
                with file.open("rb") as handle:
                    os.fsync(handle.fileno())
            folders = {(self.out / name).parent for name in names} | {self.out}
            for folder in folders:
                folder.mkdir(exist_ok=True)
            for file, name in zip(files, names, strict=True):
                os.replace(file, self.out / name)
            for folder in folders:
                sync_folder(folder)
        except OSError as err:
            raise write_error(self.out, err) from err
        for stale in set(_names_in(record)) - set(names):  # meshes of parts no longer found
            remove_quietly(self.out / stale)
        write_text_atomic(record, json.dumps(names, indent=1))


def _names_in(record: Path) -> list[str]:
    try:
        names = json.loads(record.read_text("utf-8"))
    except (OSError, ValueError):
        return []
    found = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
    # files of the folder, or of a folder in it: whatever else a record says is never removed
    return [name for name in found if _OWN_FILE.fullmatch(name)]


def write_stage(folder: Path, key: str, saved: Saved) -> None:
    """Write a stage folder under a temporary name, manifest last, then rename it."""
    from safetensors.numpy import save as to_bytes

    temp = folder.with_name(f"{folder.name}.tmp-{os.getpid()}")
    remove_quietly(temp)
    try:
        temp.mkdir()
        arrays = {name: np.ascontiguousarray(value) for name, value in saved.arrays.items()}
        contents = {"arrays.safetensors": to_bytes(arrays),
                    "data.json": json.dumps(saved.data).encode()}
        for name, data in contents.items():
            write_bytes_atomic(temp / name, data)
        manifest = {"key": key, "sha256": {name: hashlib.sha256(data).hexdigest()
                                           for name, data in contents.items()}}
        write_text_atomic(temp / "manifest.json", json.dumps(manifest, indent=1))
        old = folder.with_name(f"{folder.name}.old.tmp-{os.getpid()}")
        if folder.exists():  # a folder cannot be replaced by rename unless it is empty
            os.rename(folder, old)
        os.rename(temp, folder)
        sync_folder(folder.parent)
        remove_quietly(old)
    except OSError as err:
        raise write_error(folder, err) from err
    finally:
        remove_quietly(temp)


def read_stage(folder: Path, key: str) -> Saved | None:
    """Return a stage saved under `key`, None when absent, outdated or damaged."""
    from safetensors import SafetensorError
    from safetensors.numpy import load as from_bytes

    manifest = _manifest(folder, key)
    if manifest is None:
        return None
    try:
        contents = {name: (folder / name).read_bytes() for name in manifest}
        if any(hashlib.sha256(data).hexdigest() != manifest[name]
               for name, data in contents.items()):
            return None
        return Saved(from_bytes(contents["arrays.safetensors"]), json.loads(contents["data.json"]))
    except (OSError, ValueError, KeyError, SafetensorError):
        return None  # computed again: slower, never wrong


def _manifest(folder: Path, key: str) -> dict[str, str] | None:
    try:
        manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
        good = manifest["key"] == key and set(manifest["sha256"]) == {"arrays.safetensors",
                                                                      "data.json"}
        return dict(manifest["sha256"]) if good else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
