"""The scene of two folders of plain photos, kept in the output folder like any other stage."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import cast

from part2gs_robotics.config import Config, Value
from part2gs_robotics.errors import ConfigError, SceneError, StoreError
from part2gs_robotics.runtime.atomic import (
    remove_quietly,
    sync_folder,
    write_error,
    write_text_atomic,
)
from part2gs_robotics.runtime.hashing import code_version, hash_of
from part2gs_robotics.runtime.log import log_stage, logging_to
from part2gs_robotics.runtime.store import NEW_PREFIX, STAGES, Store

logger = logging.getLogger(__name__)

SCENE = "scene"  # folder in OUT
MANIFEST = "00_scene.json"  # in OUT/stages: what the scene was made of, and its files


def scene_of_photos(sources: tuple[Path, Path], out: Path, config: Config) -> Path:
    """Return the scene folder OUT/scene, made of plain photos unless it is there already.

    Args:
        sources: of state 0 and 1: folder of photos, or a video.
        out: output folder of the build.
        config: resolved settings of the command line.

    Raises:
        ConfigError: `--scale` was given, though nobody can know the unit beforehand.
        SceneError: photos that cannot be used, as `photos.make_scene` says.
        StoreError: `out` lies among the photos, is locked, or cannot be written.
    """
    if config.read.scale is not None:
        raise ConfigError(f"--scale is {config.read.scale:g}. Expected none with plain photos, "
                          "whose unit is made up; use --known-length or the sheet of "
                          "part2gs-robot marker.")
    for source in sources:
        _refuse(source, out)
    store = Store(out)
    store.refuse_early()
    files = [list(_files(source)) for source in sources]
    if config.photos.mask_model is not None:
        files.append([Path(config.photos.mask_model)])
    key = hash_of("scene", code_version(), asdict(config.photos), config.read.known_length,
                  *([path.name, _sha256(path)] for state in files for path in state))
    store.prepare()
    with store.locked(), logging_to(out, config.output.quiet, config.output.verbose):
        began, scene = time.monotonic(), out / SCENE
        if resumed := _is_whole(out, key):
            registered = cast("list[int]", json.loads((scene / "scene.json").read_text("utf-8"))
                              ["registered"])
        else:
            registered = _made(sources, out, key, config)
        log_stage("scene", time.monotonic() - began,
                  f"{registered[0]} + {registered[1]} photos registered", resumed)
    return scene


def settings_for(given: dict[str, Value], scene_yaml: dict[object, object]) -> dict[str, Value]:
    """Return the flags that still count once the scene is made: markers know the scale better."""
    if "scale" in scene_yaml and "known_length" in given:
        logger.warning("markers give the scale: --known-length %s is not used",
                       given["known_length"])
        return {key: value for key, value in given.items() if key != "known_length"}
    return given


def _refuse(source: Path, out: Path) -> None:
    if not source.exists():
        raise SceneError(f"{source}: is missing. Expected a folder of photos or a video of one "
                         "state; give one per state.")
    if source.is_dir() and out.resolve().is_relative_to(source.resolve()):
        raise StoreError(f"{out}: lies in the folder of photos {source}. Expected a folder outside "
                         "of it, photos are never written to; choose another one with -o.")


def _files(source: Path) -> Iterator[Path]:
    """Yield what a scene is made of, in order: the video, or all below the folder of photos."""
    if not source.is_dir():
        yield source
        return
    beside = source.parent / "masks" / source.name
    for folder in (source, source / "masks", beside):
        if folder.is_dir():
            yield from sorted(path for path in folder.iterdir()
                              if path.is_file() and not path.name.startswith("."))


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror}). Expected a photo or video; "
                         "check the file and its permissions.") from err


def _is_whole(out: Path, key: str) -> bool:
    """Tell whether the scene was made of the same photos and settings, and no file changed."""
    try:
        manifest = json.loads((out / STAGES / MANIFEST).read_text("utf-8"))
        if manifest["key"] != key:
            return False
        return bool(manifest["sha256"] == _contents(out / SCENE))
    except (OSError, ValueError, KeyError, TypeError, SceneError):
        return False  # made again: slower, never wrong


def _contents(scene: Path) -> dict[str, str]:
    return {path.relative_to(scene).as_posix(): _sha256(path)
            for path in sorted(scene.rglob("*")) if path.is_file()}


def _made(sources: tuple[Path, Path], out: Path, key: str, config: Config) -> list[int]:
    """Make the scene beside an earlier one and put it in its place; return photos registered."""
    from part2gs_robotics.photos.make_scene import Wishes, make_scene

    photos, fresh, old = config.photos, out / f"{NEW_PREFIX}{os.getpid()}", None
    try:
        model = None if photos.mask_model is None else Path(photos.mask_model)
        length = config.read.known_length
        made = make_scene(sources, fresh, Wishes(photos.side, photos.frames, length,
                                                 photos.marker_size, model))
        if (out / SCENE).exists():  # a folder cannot be replaced by rename unless it is empty
            old = out / f"{SCENE}.old.tmp-{os.getpid()}"
            os.rename(out / SCENE, old)
        os.rename(fresh, out / SCENE)
        sync_folder(out)
        write_text_atomic(out / STAGES / MANIFEST, json.dumps(
            {"key": key, "sha256": _contents(out / SCENE)}, indent=1))
    except OSError as err:
        raise write_error(out / SCENE, err) from err
    finally:
        remove_quietly(fresh)
        if old is not None:
            remove_quietly(old)
    return list(made.registered)
