"""What is read out of each format is what an engine makes of it, and all formats say the same."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest
from random_twins import random_twin
from synth import scaled, toy_cabinet_twin, write_all

from part2gs_robotics.agree.compare import compared
from part2gs_robotics.agree.described import moved
from part2gs_robotics.agree.folder import further
from part2gs_robotics.agree.meshes import Meshes
from part2gs_robotics.agree.of_glb import of_glb
from part2gs_robotics.agree.of_mujoco import of_mujoco
from part2gs_robotics.agree.of_urdf import of_urdf
from part2gs_robotics.agree.of_usd import of_usd
from part2gs_robotics.agree.of_yaml import of_yaml
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.sound import sound_twin
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.sim_checks import check


def solid(twin: Twin) -> Twin:
    """Return the twin, every part with a piece; random ones have a base without."""
    return dataclasses.replace(twin, parts=tuple(
        p if p.pieces else dataclasses.replace(p, pieces=(p.mesh,)) for p in twin.parts))


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 47])
def test_all_formats_of_a_random_twin_agree(tmp_path: Path, seed: int) -> None:
    folder = write_all(sound_twin(solid(random_twin(seed))), tmp_path / "t")
    assert len(further(folder)) == 3
    report = check(folder, only=("files",))
    wrong = [f"{r.name} {r.subject}: {r.detail}" for r in report.results if r.status != "pass"]
    assert not wrong


@pytest.mark.parametrize("factor", [1e-3, 1.0, 1e3])
def test_a_twin_of_any_unit_agrees(tmp_path: Path, factor: float) -> None:
    folder = write_all(scaled(toy_cabinet_twin(4), factor), tmp_path / "t")
    report = check(folder, only=("files",))
    assert [r.status for r in report.results] == ["pass"] * len(report.results)


@pytest.mark.parametrize("seed", range(5))
def test_chains_put_parts_where_the_engine_does(tmp_path: Path, seed: int) -> None:
    """Of MJCF and URDF alike: by our reading of numbers, and by the engine's own kinematics."""
    twin = sound_twin(solid(random_twin(seed)))
    folder, rng = write_all(twin, tmp_path / "t"), np.random.default_rng(seed)
    told, _, _ = of_yaml(folder)
    model = mujoco.MjModel.from_xml_path(str(folder / "twin.xml"))
    data, start = mujoco.MjData(model), mujoco.MjData(model)
    mujoco.mj_kinematics(model, start)
    values = {n: float(rng.uniform(-1, 1)) * (1.0 if d.kind != "prismatic" else twin_size(told))
              for n, d in told.drives().items() if d.kind != "fixed"}
    for name, value in values.items():
        at = model.joint(f"{name}_joint").qposadr[0]
        data.qpos[at] = value
        if told.bodies[name].drive.kind == "screw":
            data.qpos[at + 1] = value * told.bodies[name].drive.pitch
    mujoco.mj_kinematics(model, data)
    for file in (told, of_mujoco("twin.xml", model), of_urdf(folder / "twin.urdf", Meshes(folder))):
        for name, body in file.bodies.items():
            there = moved(file, name, values)
            local = start.body(name).xmat.reshape(3, 3).T @ (body.center - start.body(name).xpos)
            true = data.body(name).xmat.reshape(3, 3) @ local + data.body(name).xpos
            found = there[:3, :3] @ body.center + there[:3, 3]
            scale = twin_size(told) + np.abs(true).max()
            assert np.abs(found - true).max() < 1e-7 * scale, f"{file.file}: {name}"


def twin_size(file) -> float:
    points = np.concatenate([b.surface for b in file.bodies.values()])
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def test_numbers_of_a_box_are_those_by_hand(tmp_path: Path) -> None:
    """The door: a board of 0.018 x 0.6 x 0.4 m at 600 kg/m3, in every format."""
    folder = write_all(toy_cabinet_twin(2), tmp_path / "t")
    model = mujoco.MjModel.from_xml_path(str(folder / "twin.xml"))
    twin = of_yaml(folder)[1]
    mass = 600 * 0.018 * 0.6 * 0.4
    moments = mass / 12 * np.array([0.6**2 + 0.4**2, 0.018**2 + 0.4**2, 0.018**2 + 0.6**2])
    files = [of_yaml(folder)[0], of_mujoco("twin.xml", model),
             of_urdf(folder / "twin.urdf", Meshes(folder)),
             of_glb(folder / "glb/twin.glb", "glb", twin),
             of_usd(folder / "usd/twin.usd", "usd", twin)]
    for file in files:
        door = file.bodies["part_2"]
        assert door.mass == pytest.approx(mass, rel=1e-6)
        assert door.center == pytest.approx([0.512, 0.3, 0.6], abs=1e-6)
        assert door.inertia == pytest.approx(np.diag(moments), rel=1e-5, abs=1e-9)
        assert np.ptp(door.surface, axis=0) == pytest.approx([0.018, 0.6, 0.4], abs=1e-6)
        assert door.drive.limits == pytest.approx((0.0, 1.5), rel=1e-6)
        assert door.drive.axis == pytest.approx([0, 0, -1], abs=1e-6)


def test_without_openusd_it_is_said_and_nothing_fails(tmp_path: Path, monkeypatch) -> None:
    folder = write_all(toy_cabinet_twin(1), tmp_path / "t")
    monkeypatch.setitem(sys.modules, "pxr", None)
    report = check(folder, only=("files",))
    (row,) = [r for r in report.results if r.status != "pass"]
    assert (row.name, row.subject, row.status) == ("readable", "usd/twin.usd", "warn")
    assert report.exit_code == 0


@pytest.mark.parametrize("name", ["twin.urdf", "sdf/model.sdf", "glb/twin.glb", "twin.yaml"])
def test_damaged_bytes_never_crash(tmp_path: Path, name: str) -> None:
    """Bytes changed, cut out and doubled: a row or a refusal, never another error."""
    folder, rng = write_all(toy_cabinet_twin(2), tmp_path / "t"), np.random.default_rng(0)
    good, verdicts = (folder / name).read_bytes(), set[str]()
    for _ in range(25):
        data = bytearray(good)
        for _ in range(rng.integers(1, 6)):
            at, length = rng.integers(len(data)), int(rng.integers(1, 30))
            data[at:at + length] = (rng.bytes(length), b"", b"nan", b"-1e308")[rng.integers(4)]
        (folder / name).write_bytes(bytes(data))
        try:
            verdicts |= {r.status for r in check(folder, only=("files",)).results}
        except CheckError as error:
            verdicts.add("told" if re.search("Needed|[Ee]xpected", str(error)) else str(error))
    assert verdicts & {"fail", "told"}
    assert verdicts <= {"pass", "warn", "fail", "told"}


def test_too_few_files_leave_nothing_to_compare(tmp_path: Path) -> None:
    folder = write_all(toy_cabinet_twin(1), tmp_path / "t")
    told, twin, _ = of_yaml(folder)
    rows = compared([told, dataclasses.replace(told, file="other")], 1.0)
    assert {r.status for r in rows} == {"pass"}
    assert twin.parts[1].name == "part_1"
