"""The program as functions, for scripts and notebooks; rooms load when a function needs them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, get_args

from part2gs_robotics.config import Value, resolve
from part2gs_robotics.errors import ConfigError
from part2gs_robotics.flags import Format

if TYPE_CHECKING:
    from part2gs_robotics.model.twin import Twin
    from part2gs_robotics.sim_checks.result import CheckReport

__all__ = ["build", "check", "export", "read_twin", "write_twin"]


def build(scene: Path, out: Path | None = None, **settings: Value) -> int:
    """Build the twin of a scene folder; the same call continues an interrupted build.

    Args:
        scene: folder of posed photos of two states (docs/scene.md).
        out: the twin folder; None = `<scene>_twin` beside the scene.
        settings: flags of `part2gs-robot build` by name, `max_side=800` for `--max-side 800`;
            they win over `scene.yaml`.

    Returns:
        0 when all checks pass, 1 when the twin is built but a check fails.

    Raises:
        Part2GSError: the scene, a setting or the folder cannot be used; earlier results stay.

    Example:
        code = build(Path("scene"), Path("out"), preset="draft", material="steel")
    """
    from part2gs_robotics.build import build as run
    from part2gs_robotics.readers.read_scene import read_scene_yaml

    if out is not None:
        settings["out"] = str(out)
    return run(scene, resolve(settings, read_scene_yaml(scene), str(scene / "scene.yaml")))


def read_twin(folder: Path) -> Twin:
    """Return the twin of a folder that `build` or `write_twin` wrote: frozen dataclasses.

    Raises:
        CheckError: a file is missing, damaged, or says what no twin can be.
    """
    from part2gs_robotics.exporters.read_twin import read_twin as read

    return read(folder)


def write_twin(twin: Twin, folder: Path) -> tuple[str, ...]:
    """Write a twin's folder: MJCF, URDF, `twin.yaml` and `assets/`; photos, report and splats not.

    Masses, inertias, friction and servos are computed anew from meshes, scale and material. All is
    written beside the folder's files first; files of the same names are then replaced.

    Args:
        twin: parts in the world at state 0, scene units.
        folder: made if absent; a fresh one leaves nothing of another twin beside it.

    Returns:
        What was repaired because no format takes it: odd names, open meshes; a sentence each.

    Raises:
        ExportError: a number, name or mesh cannot be written.
        StoreError: the folder cannot be written.
    """
    from part2gs_robotics.exporters.sound import sound_twin
    from part2gs_robotics.outputs import write_models
    from part2gs_robotics.runtime.atomic import replace_files

    sound = sound_twin(twin)
    replace_files(folder, lambda fresh: write_models(sound, fresh))
    return sound.notes[len(twin.notes):]


def export(folder: Path, kind: str, out: Path | None = None) -> list[Path]:
    """Write a twin folder's twin in another format; return the files.

    Args:
        folder: with `twin.yaml`.
        kind: mjcf, urdf, usd, sdf, glb or ros.
        out: folder of the new files; None = `folder/kind`.

    Raises:
        Part2GSError: the folder is damaged, the kind unknown, or `out` cannot be written.
    """
    from part2gs_robotics.outputs import export_twin

    if kind not in get_args(Format):
        raise ConfigError(f"export: kind is {kind!r}. Expected {'|'.join(get_args(Format))}.")
    return export_twin(folder, kind, out or folder / kind)[0]


def check(path: Path, steps: int = 21) -> CheckReport:
    """Check a twin folder, an MJCF, URDF or USD file in the installed MuJoCo.

    Args:
        path: folder or file.
        steps: positions per joint of the overlap sweep.

    Returns:
        `report.ok`, and a row per check in `report.results`: name, subject, status, detail.

    Raises:
        CheckError: the path or a file it names cannot be used.
    """
    from part2gs_robotics.sim_checks import check as run

    return run(path, steps=steps)
