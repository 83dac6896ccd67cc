"""URDF: the same kinematics, masses and names as the MJCF."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import joint_name, write_mjcf
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import moving_parts, part_transforms

MOVING = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("twin")
    write_mjcf(toy_cabinet_twin(MOVING), path)
    write_urdf(toy_cabinet_twin(MOVING), path)
    return path


def geom_transform(data: mujoco.MjData, name: str) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = data.geom(name).xmat.reshape(3, 3), data.geom(name).xpos
    return out


def world_vertices(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    mesh = model.geom_dataid[model.geom(name).id]
    start, place = model.mesh_vertadr[mesh], geom_transform(data, name)
    return (
        model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ place[:3, :3].T + place[:3, 3]
    )


def pose(model: mujoco.MjModel, positions: dict[str, float]) -> mujoco.MjData:
    data = mujoco.MjData(model)
    for name, q in positions.items():
        data.joint(name).qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return data


def test_urdf_mjcf_and_twin_agree_for_1000_random_positions(folder: Path) -> None:
    twin = toy_cabinet_twin(MOVING)
    models = [mujoco.MjModel.from_xml_path(str(folder / f)) for f in ("twin.xml", "twin.urdf")]
    rest = [pose(m, {}) for m in models]
    rng = np.random.default_rng(1)
    for _ in range(1000):
        q = [rng.uniform(*twin.parts[i].limits) for i in moving_parts(twin)]
        named = dict(zip([joint_name(twin.parts[i]) for i in moving_parts(twin)], q, strict=True))
        screw = twin.parts[-1]
        named[f"{joint_name(screw)}_slide"] = screw.joint.pitch * q[-1]
        posed = [pose(m, named) for m in models]
        for part, place in zip(twin.parts, part_transforms(twin, q), strict=True):
            for data, start in zip(posed, rest, strict=True):
                name = f"{part.name}_visual"
                moved = geom_transform(data, name) @ np.linalg.inv(geom_transform(start, name))
                np.testing.assert_allclose(moved, place, atol=1e-6)


def test_meshes_lie_in_the_same_place_in_both_files(folder: Path) -> None:
    models = [mujoco.MjModel.from_xml_path(str(folder / f)) for f in ("twin.xml", "twin.urdf")]
    data = [pose(m, {}) for m in models]
    for i in range(models[0].ngeom):
        a, b = (
            world_vertices(m, d, models[0].geom(i).name) for m, d in zip(models, data, strict=True)
        )
        np.testing.assert_allclose(a, b, atol=1e-6)  # float32 vertices of a metre-sized object


def test_masses_limits_and_dynamics_agree(folder: Path) -> None:
    mjcf, urdf = (mujoco.MjModel.from_xml_path(str(folder / f)) for f in ("twin.xml", "twin.urdf"))
    for part in toy_cabinet_twin(MOVING).parts:
        assert urdf.body(part.name).mass == pytest.approx(mjcf.body(part.name).mass)
        np.testing.assert_allclose(
            np.sort(urdf.body(part.name).inertia), np.sort(mjcf.body(part.name).inertia), rtol=1e-6
        )
    for j in range(mjcf.njnt):
        name = mjcf.joint(j).name
        if not name.endswith("_slide"):
            np.testing.assert_allclose(urdf.joint(name).range, mjcf.joint(name).range)
            for key in ("damping", "frictionloss"):
                want = getattr(mjcf.joint(name), key)[0]
                assert getattr(urdf.joint(name), key)[0] == pytest.approx(want)


def test_mesh_files_are_named_from_the_file(folder: Path) -> None:
    files = [m.get("filename") for m in ET.parse(folder / "twin.urdf").iter("mesh")]
    assert files
    assert all((folder / f).is_file() and f.startswith("assets/") for f in files)


def test_fixed_joint(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(1)
    part = dataclasses.replace(
        twin.parts[1], joint=Joint("fixed", np.array([0, 0, 1.0]), np.ones(3), 0.0)
    )
    write_urdf(dataclasses.replace(twin, parts=(twin.parts[0], part)), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.urdf"))
    assert model.njnt == 0


def test_root_is_a_massless_world_to_which_the_base_is_fixed(folder: Path) -> None:
    root = ET.parse(folder / "twin.urdf").getroot()
    joints = {j.find("child").get("link"): j for j in root.iter("joint")}
    (top,) = [link for link in root.iter("link") if link.get("name") not in joints]
    assert (top.get("name"), len(top)) == ("world", 0)
    assert joints["base"].get("type") == "fixed"
    assert joints["base"].find("parent").get("link") == "world"
    heavy = [link for link in root.iter("link") if link is not top]
    assert all(float(link.find("inertial/mass").get("value")) > 0 for link in heavy)


def test_the_world_stays_where_it_is(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(folder / "twin.urdf"))
    assert model.body("base").parentid[0] == 0
    assert model.body("base").weldid[0] == 0
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, "world_joint") == -1
