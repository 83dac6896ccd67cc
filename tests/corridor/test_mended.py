"""Build: what the checks found goes back to the meshes once, and only where it can help."""

from __future__ import annotations

from pathlib import Path

import pytest
from synth import lumpy_cabinet, toy_cabinet_twin

from part2gs_robotics.build import Told, Written, _Corridor
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.mend import mendable
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks import check


class Short(_Corridor):
    """The corridor from a finished twin on: writes and checks it without looks and scale."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.seconds, self.keys = folder, {}, []

    def _written(self, bare: Twin, told: Told) -> Written:
        folder = self.folder / str(len(self.keys))
        folder.mkdir()
        self.keys.append(told.key)
        write_mjcf(bare, folder)
        return check(folder, only=("overlap",)), "\n".join(bare.notes)


@pytest.mark.parametrize("lump", [0.0, 0.008])
def test_a_twin_is_written_again_only_where_its_parts_overlapped(
        tmp_path: Path, lump: float) -> None:
    twin = lumpy_cabinet(lump) if lump else toy_cabinet_twin(1)
    corridor, told = Short(tmp_path), Told(None, None, None, None, "key")
    written = corridor._written(twin, told)
    assert mendable(written[0]) == bool(lump)
    report, summary = corridor._mended(twin, told, written)
    assert not mendable(report)
    assert len(corridor.keys) == len(set(corridor.keys)) == (2 if lump else 1)
    assert ("Mending, round 1" in summary) == bool(lump)
    assert ("mend 1" in corridor.seconds) == bool(lump)
