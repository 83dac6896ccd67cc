"""Faces of one surface that cut each other are counted and reported, never a failure."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import PartMesh, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport
from part2gs_robotics.sim_checks.self_intersection import NAME, cutting_faces


def merged(a: PartMesh, b: PartMesh) -> PartMesh:
    """Return both surfaces as one list of faces, without any boolean."""
    return PartMesh(
        np.concatenate([a.vertices, b.vertices]),
        np.concatenate([a.faces, b.faces + len(a.vertices)]),
        np.concatenate([a.colors, b.colors]),
    )


ONE = to_mesh(box((0, 0, 0), (1, 1, 1)))
CROSSING = to_mesh(box((0.5, 0.3, 0.2), (1.5, 1.3, 1.2)))
APART = to_mesh(box((2, 0, 0), (3, 1, 1)))


def test_boxes_that_cross_are_counted() -> None:
    assert cutting_faces(merged(ONE, CROSSING)) > 0
    assert cutting_faces(ONE) == 0
    assert cutting_faces(merged(ONE, APART)) == 0


def test_count_does_not_depend_on_place_and_size() -> None:
    crossing = merged(ONE, CROSSING)
    moved = dataclasses.replace(crossing, vertices=crossing.vertices * 0.01 + 7.0)
    assert cutting_faces(moved) == cutting_faces(crossing)


def checked(folder: Path, twin: Twin) -> CheckReport:
    write_mjcf(twin, folder)
    return check(folder / "twin.xml", only=("mesh",))


def with_crossing_drawer() -> Twin:
    twin = toy_cabinet_twin(1)
    mesh = twin.parts[1].mesh
    shifted = dataclasses.replace(mesh, vertices=mesh.vertices + 0.013)
    drawer = dataclasses.replace(twin.parts[1], mesh=merged(mesh, shifted))
    return dataclasses.replace(twin, parts=(twin.parts[0], drawer))


def test_check_warns_of_the_part_and_passes(tmp_path: Path) -> None:
    report = checked(tmp_path, with_crossing_drawer())
    rows = {r.subject: r for r in report.results if r.name == NAME}
    assert report.ok
    assert rows["base"].value == 0
    assert rows["part_1"].value is not None
    assert rows["part_1"].value > 0
    assert "warning" in rows["part_1"].detail
    assert any(note.startswith("warning:") and "part_1" in note for note in report.notes)


def test_missing_library_is_said_and_nothing_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pymeshlab", None)  # import raises, as without libGL
    report = checked(tmp_path, with_crossing_drawer())
    rows = [r for r in report.results if r.name == NAME]
    assert [r.status for r in rows] == ["skipped", "skipped"]
    assert all("pymeshlab cannot be loaded" in r.detail for r in rows)
    assert report.ok
