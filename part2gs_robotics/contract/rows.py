"""The order of what is asked of a twin folder besides agreement of its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.agree.finding import CheckResult
from part2gs_robotics.agree.folder import further
from part2gs_robotics.contract.clear import clear_world
from part2gs_robotics.contract.exported import exported_looks
from part2gs_robotics.contract.looks import looks
from part2gs_robotics.contract.shown import shown
from part2gs_robotics.contract.sites import sites
from part2gs_robotics.contract.urdf import urdf_rules
from part2gs_robotics.contract.words import words_of
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.read_twin import read_twin

if TYPE_CHECKING:
    import mujoco

SCENE = "scene.xml"


def contract(folder: Path, sdf: Sequence[str], models: Mapping[str, mujoco.MjModel]
             ) -> list[CheckResult]:
    """Return rows about words, URDF rules, looks and the world of a twin folder.

    Args:
        folder: whose XML was inspected.
        sdf: names of exported SDFormat files in it.
        models: compiled, by file.

    Example:
        rows = contract(Path("out"), (), {"scene.xml": model})
    """
    out = words_of(folder, tuple(sdf)) + urdf_rules(folder / "twin.urdf")
    out += clear_world(models[SCENE]) if SCENE in models else []
    try:
        twin = read_twin(folder)
        more = shown(folder, twin, models) + exported_looks(folder, twin, further(folder))
        return out + [r for r in looks(folder, twin) if r.status == "fail" or not more] + more + (
            sites(folder, twin))
    except (CheckError, OSError):
        return out  # the row `assets` says what is wrong with twin.yaml or its meshes
