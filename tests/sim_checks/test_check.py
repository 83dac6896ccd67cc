"""The checks pass a sound twin and catch planted defects."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.model.solids import to_manifold, to_mesh
from part2gs_robotics.model.twin import PartMesh, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport, format_text


def write(twin: Twin, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    write_mjcf(twin, folder)
    write_urdf(twin, folder)
    write_twin_yaml(twin, folder)
    return folder


def failed(report: CheckReport) -> set[tuple[str, str]]:
    return {(r.name, r.subject) for r in report.results if r.status == "fail"}


def change(twin: Twin, index: int, **fields: object) -> Twin:
    parts = list(twin.parts)
    parts[index] = dataclasses.replace(parts[index], **fields)
    return dataclasses.replace(twin, parts=tuple(parts))


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CheckReport]:
    folder = write(toy_cabinet_twin(4), tmp_path_factory.mktemp("sound") / "twin")
    return folder, check(folder)


def test_sound_twin_passes_everything(sound: tuple[Path, CheckReport]) -> None:
    report = sound[1]
    assert report.ok, format_text(report)
    assert report.exit_code == 0
    assert [report.verdict(j) for j in report.joints] == ["pass"] * 4
    assert all(r.status == "pass" for r in report.results)
    assert {r.name for r in report.results} >= {
        "compile", "mesh", "inertia", "limits", "observed state", "reach", "tracking",
        "others still", "warnings", "overlap", "phantom contact", "time step", "gain x 100",
        "hold", "passive", "same twin", "push", "drift", "stands", "collision",
    }  # fmt: skip


def test_report_is_json_and_text(sound: tuple[Path, CheckReport]) -> None:
    report = sound[1]
    tree = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert tree["ok"] is True
    assert len(tree["curves"]) == 4
    assert len(tree["curves"][0]["positions"]) == 21
    assert tree["losses"][0]["vector_field_loss"] == 1e-4
    assert tree["losses"][0]["overlap_depth"] == 0.0
    assert "verdict: pass" in format_text(report)


def test_nothing_is_written_into_the_checked_folder(sound: tuple[Path, CheckReport]) -> None:
    assert not [p for p in sound[0].iterdir() if p.name == "MUJOCO_LOG.TXT" or p.name[0] == "."]


def test_urdf_alone_gets_servos_and_passes(sound: tuple[Path, CheckReport]) -> None:
    report = check(sound[0] / "twin.urdf", quick=True)
    assert report.ok, format_text(report)
    assert any("servos added" in note for note in report.notes)


def test_single_hull_drawer_is_caught(tmp_path: Path) -> None:
    """The commonest mistake: one mesh geom per part loads fine and never opens."""
    twin = toy_cabinet_twin(1)
    for index in (0, 1):
        twin = change(twin, index, pieces=(to_mesh(to_manifold(twin.parts[index].mesh).hull()),))
    report = check(write(twin, tmp_path / "t"), only=("actuation", "overlap"))
    assert {("reach", "part_1_joint"), ("phantom contact", "part_1_joint")} <= failed(report)
    assert ("overlap", "part_1_joint") not in failed(report)  # the true surfaces are fine


def test_wrong_axis_overlaps(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(1)
    joint = dataclasses.replace(twin.parts[1].joint, axis=np.array([0.8, 0.6, 0.0]))
    report = check(write(change(twin, 1, joint=joint), tmp_path / "t"), only=("overlap", "states"))
    assert {("overlap", "part_1_joint"), ("observed state", "state_1")} <= failed(report)
    assert ("observed state", "state_0") not in failed(report)


def test_blocked_drawer_is_caught(tmp_path: Path) -> None:
    """A bolt in front of the drawer, seen in the picture: overlap and reach both say so."""
    twin = toy_cabinet_twin(1)
    bolt = box((0.52, 0.1, 0.05), (0.6, 0.5, 0.06))
    base = twin.parts[0]
    mesh = to_mesh(
        to_manifold(base.mesh)
        + bolt
        + box((0.45, 0.0, 0.05), (0.6, 0.018, 0.06))
        + box((0.52, 0.0, 0.05), (0.6, 0.11, 0.06))
    )
    twin = change(twin, 0, mesh=mesh, pieces=(*base.pieces, to_mesh(bolt)))
    report = check(write(twin, tmp_path / "t"), only=("actuation", "overlap"))
    assert {("reach", "part_1_joint"), ("overlap", "part_1_joint")} <= failed(report)


def open_mesh(mesh: PartMesh) -> PartMesh:
    return PartMesh(mesh.vertices, mesh.faces[2:], mesh.colors)


def test_open_mesh_is_caught_and_overlap_is_not_claimed(tmp_path: Path) -> None:
    folder = write(toy_cabinet_twin(1), tmp_path / "t")
    path = folder / "assets/part_1_visual.obj"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-2]) + "\n")
    report = check(folder, only=("mesh", "overlap"))
    assert ("mesh", "part_1") in failed(report)
    assert any(r.name == "overlap" and r.status == "incomplete" for r in report.results)
    assert report.exit_code == 1


def edit(folder: Path, old: str, new: str) -> Path:
    text = (folder / "twin.xml").read_text()
    assert old in text
    (folder / "twin.xml").write_text(text.replace(old, new, 1))
    return folder


def test_impossible_inertia_does_not_compile_and_says_what_to_do(tmp_path: Path) -> None:
    folder = write(toy_cabinet_twin(1), tmp_path / "t")
    text = (folder / "twin.xml").read_text()
    start = text.index('fullinertia="', text.index('name="part_1"'))
    end = text.index('"', start + 13)
    (folder / "twin.xml").write_text(text[:start] + 'fullinertia="1 1 9 0 0 0' + text[end:])
    report = check(folder)
    assert ("compile", "twin.xml") in failed(report)
    assert any("recompute it from a closed mesh" in r.detail for r in report.results)


def test_observed_state_outside_the_range_is_caught(tmp_path: Path) -> None:
    twin = change(toy_cabinet_twin(1), 1, limits=(0.0, 0.2))
    report = check(write(twin, tmp_path / "t"), only=("limits",))
    assert failed(report) == {("limits", "part_1_joint")}


def test_missing_keyframe_is_caught(tmp_path: Path) -> None:
    folder = edit(write(toy_cabinet_twin(1), tmp_path / "t"), 'name="state_1"', 'name="other"')
    assert failed(check(folder, only=("states",))) == {("observed state", "state_1")}


def test_quick_and_only_say_what_was_left_out(sound: tuple[Path, CheckReport]) -> None:
    report = check(sound[0], only=("mesh",))
    assert {r.name for r in report.results} == {
        "compile", "same twin", "mesh", "self-intersection"}
    assert any("not run" in note and "overlap" in note for note in report.notes)


@pytest.mark.parametrize(("content", "message"), [
    (None, "does not exist"),
    ("", "well-formed|no element"),
    ("<mujoco>", "well-formed"),
    ('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "document type"),
    ('<mujoco><asset><mesh file="../../etc/passwd"/></asset></mujoco>', "leaves the folder"),
    ('<mujoco><asset><mesh file="/etc/passwd"/></asset></mujoco>', "leaves the folder"),
    ('<mujoco><include file="../x.xml"/></mujoco>', "leaves the folder"),
])  # fmt: skip
def test_unusable_files_are_refused(tmp_path: Path, content: str | None, message: str) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    if content is not None:
        (folder / "m.xml").write_text(content)
    with pytest.raises(CheckError, match=message):
        check(folder / "m.xml")


@pytest.mark.parametrize("content", [
    "<robot name='a'/>", "<cabinet/>", "<mujoco><worldbody><geom size='-1'/></worldbody></mujoco>",
    '<mujoco><asset><mesh file="gone.obj"/></asset></mujoco>',
])  # fmt: skip
def test_models_that_do_not_compile_fail_without_an_exception(tmp_path: Path, content: str) -> None:
    (tmp_path / "m.xml").write_text(content)
    report = check(tmp_path / "m.xml")
    assert report.exit_code == 1
    assert ("compile", "m.xml") in failed(report)


def test_nan_compiles_with_a_warning_only_and_is_caught(tmp_path: Path) -> None:
    body = '<body pos="nan 0 0"><geom size=".1"/></body>'
    (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    report = check(tmp_path / "m.xml")
    assert ("compile", "m.xml") in failed(report)


def test_folder_without_a_twin_and_unknown_group(tmp_path: Path) -> None:
    with pytest.raises(CheckError, match=r"holds no twin\.xml"):
        check(tmp_path)
    with pytest.raises(CheckError, match="unknown check 'speed'"):
        check(tmp_path, only=("speed",))


def test_base_alone_passes(tmp_path: Path) -> None:
    report = check(write(toy_cabinet_twin(0), tmp_path / "t"))
    assert report.ok, format_text(report)
    assert report.joints == ()


@pytest.mark.parametrize("defect", ["half", "shifted", "most missing"])
def test_pieces_that_are_not_the_part_are_caught(defect: str, tmp_path: Path) -> None:
    """Half as large, shifted by a third of the part, or without its four largest boards."""
    twin = toy_cabinet_twin(1)
    base = twin.parts[0]
    solids = [to_manifold(p) for p in base.pieces]
    if defect == "half":
        solids = [s.scale([0.5] * 3) for s in solids]
    elif defect == "shifted":
        solids = [s.translate([0.0, 0.0, 0.3]) for s in solids]
    else:
        solids = sorted(solids, key=lambda s: s.volume())[:-4]
    sick = change(twin, 0, pieces=tuple(to_mesh(s) for s in solids))
    assert ("collision", "base") in failed(check(write(sick, tmp_path), only=("overlap",)))


@pytest.mark.parametrize("step", ["1e-308", "1e-30", "1e30"])
def test_a_time_step_of_no_world_is_named(tmp_path: Path, step: str) -> None:
    (tmp_path / "m.xml").write_text(
        f'<mujoco><option timestep="{step}"/><worldbody><body><joint name="j" range="0 1"/>'
        '<geom size=".1"/></body></worldbody></mujoco>')
    report = check(tmp_path / "m.xml", quick=True)
    assert report.exit_code == 1
    assert "timestep" in report.results[0].detail
