"""Which layout a scene folder has, and its cameras; no pixel is decoded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import cast

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.artgs import is_artgs, read_artgs
from part2gs_robotics.readers.colmap import model_folder, read_both, read_model
from part2gs_robotics.readers.dta import is_dta, read_dta
from part2gs_robotics.readers.nerfstudio import PosedImage, read_transforms
from part2gs_robotics.readers.paris import is_paris, read_paris

STATE_FOLDERS = (("state_0", "state_1"), ("start", "end"))
JSON_NAMES = ("transforms.json", "transforms_train.json")

States = tuple[list[PosedImage], list[PosedImage]]
Read = Callable[[Path, Path, bool], list[PosedImage]]


def read_layout(path: Path, config: ReadConfig) -> tuple[str, States]:
    """Return the layout's name and the posed images of both states.

    Args:
        path: an existing folder.
        config: what may be missing, and whether depth counts.

    Raises:
        SceneError: no known layout, half of one, or broken camera files.
    """
    if is_artgs(path):
        return "artgs", read_artgs(path, config.allow_missing, config.depth)
    if is_dta(path):
        return "dta", read_dta(path, config.allow_missing, config.depth)
    if is_paris(path):
        return "paris", read_paris(path, config.allow_missing)
    for layout, find, read, file in (("nerfstudio", _state_json, read_transforms, JSON_NAMES[0]),
                                     ("colmap", model_folder, read_model, "sparse/0")):
        states = _per_state(path, (find, read, file), config.allow_missing)
        if states is not None:
            return layout, states
    single = _state_json(path)
    if single is not None:
        return "single", _split_by_time(read_transforms(single, path, config.allow_missing), single)
    model = model_folder(path)
    if model is not None:
        return "colmap", read_both(model, path, config.allow_missing)
    found = sorted(item.name for item in path.iterdir() if not item.name.startswith("."))[:8]
    raise SceneError(
        f"{path}: no cameras found (it holds {', '.join(found) or 'nothing'}). Expected one of "
        "transforms_train_start.json with transforms_train_end.json (ArtGS), init_keyframes.yml "
        "with cam_K.txt (DTA), start/camera_train.json with end/camera_train.json (PARIS), "
        "state_0/transforms.json with state_1/transforms.json, start/ with end/transforms.json, "
        "one transforms.json with time 0 and 1, or sparse/0 of COLMAP; see docs/scene.md. Plain "
        "photos of two states are given as two folders.")


def _per_state(path: Path, way: tuple[Callable[[Path], Path | None], Read, str],
               allow_missing: bool) -> States | None:
    """Return both states where each has a folder with cameras of its own; None where none has.

    Args:
        path: scene folder.
        way: finds the cameras of a folder, reads them, and what to call them.
        allow_missing: drop frames without camera or image.
    """
    find, read, file = way
    for names in STATE_FOLDERS:
        cameras = [find(path / name) for name in names]
        if not any(cameras):
            continue
        for name, there in zip(names, cameras, strict=True):
            if there is None:
                raise SceneError(f"{path}: no {name}/{file}, one state is missing. "
                                 f"Expected both {names[0]} and {names[1]} with cameras; "
                                 "capture the object in a second state.")
        first, second = (read(cast(Path, there), path, allow_missing) for there in cameras)
        return first, second
    return None


def _state_json(folder: Path) -> Path | None:
    return next((folder / name for name in JSON_NAMES if (folder / name).is_file()), None)


def _split_by_time(posed: Sequence[PosedImage], where: Path) -> States:
    unclear = [image.name for image in posed if image.time is None]
    states = tuple([image for image in posed if image.time == time] for time in (0, 1))
    if unclear or not all(states):
        raise SceneError(f"{where}: {len(states[0])} frames of state 0, {len(states[1])} of state "
                         f"1, {len(unclear)} without time. Expected 'time': 0 or 1 in every frame "
                         "and both states; add it, or use folders state_0 and state_1.")
    return cast(States, states)
