"""MJCF: what MuJoCo reads back is the twin."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.mjcf import joint_name, write_mjcf
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import moving_parts, part_transforms
from part2gs_robotics.model.twin import Twin


def load(twin: Twin, folder: Path, name: str = "twin.xml") -> mujoco.MjModel:
    write_mjcf(twin, folder)
    return mujoco.MjModel.from_xml_path(str(folder / name))


def set_positions(
    model: mujoco.MjModel, data: mujoco.MjData, twin: Twin, positions: np.ndarray
) -> None:
    for index, q in zip(moving_parts(twin), positions, strict=True):
        part = twin.parts[index]
        data.joint(joint_name(part)).qpos[:] = q
        if part.joint.kind == "screw":
            data.joint(f"{joint_name(part)}_slide").qpos[:] = part.joint.pitch * q
    mujoco.mj_kinematics(model, data)


def body_transform(data: mujoco.MjData, name: str) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = data.body(name).xmat.reshape(3, 3), data.body(name).xpos
    return out


def visual_vertices(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    geom = model.geom(f"{name}_visual").id
    mesh = model.geom_dataid[geom]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return (
        model.mesh_vert[start : start + count] @ data.geom_xmat[geom].reshape(3, 3).T
        + data.geom_xpos[geom]
    )


def test_kinematics_equal_the_twin_for_random_positions(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(4)
    model = load(twin, tmp_path)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(1000):
        q = np.array([rng.uniform(*twin.parts[i].limits) for i in moving_parts(twin)])
        set_positions(model, data, twin, q)
        for part, place in zip(twin.parts, part_transforms(twin, q), strict=True):
            np.testing.assert_allclose(body_transform(data, part.name), place, atol=1e-9)


def carried_last(twin: Twin) -> Twin:
    """Return the twin with the lever, which the door carries, after all parts on the base."""
    base, drawer, door, lever, cap = twin.parts
    return dataclasses.replace(twin, parts=(base, drawer, door, cap, lever))


@pytest.mark.parametrize("state", [0, 1])
@pytest.mark.parametrize("order", [lambda twin: twin, carried_last])
def test_keyframes_place_the_meshes_where_they_were_seen(tmp_path: Path, state: int,
                                                         order: Callable[[Twin], Twin]) -> None:
    twin = order(toy_cabinet_twin(4))
    model = load(twin, tmp_path)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(f"state_{state}").id)
    mujoco.mj_kinematics(model, data)
    values = [twin.parts[i].joint.value * state for i in moving_parts(twin)]
    for part, place in zip(twin.parts, part_transforms(twin, values), strict=True):
        seen = visual_vertices(model, data, part.name)
        want = part.mesh.vertices @ place[:3, :3].T + place[:3, 3]
        # float32 vertices of a metre-sized object: 1e-6
        assert np.abs(np.sort(seen, axis=0) - np.sort(want, axis=0)).max() < 2e-6


def test_masses_are_those_of_the_solids(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(2)
    model = load(twin, tmp_path)
    assert model.body("base").mass[0] == pytest.approx(
        22.3208352, rel=1e-9
    )  # 600 kg/m3 x 0.0372 m3, by hand
    assert model.body("part_2").mass[0] == pytest.approx(600 * 0.018 * 0.6 * 0.4, rel=1e-9)


def test_groups_contacts_and_options(tmp_path: Path) -> None:
    model = load(toy_cabinet_twin(2), tmp_path, "scene.xml")
    visual = model.geom_group == 2
    assert (model.geom_contype[visual] == 0).all()
    assert (model.geom_conaffinity[visual] == 0).all()
    assert (model.geom_contype[model.geom_group == 3] == 1).all()
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert (model.geom_solref[:, 0] > 0).all()
    assert (model.dof_armature > 0).all()
    assert (model.dof_damping > 0).all()
    assert (model.dof_frictionloss > 0).all()


def test_ground_lies_below_everything_along_up(tmp_path: Path) -> None:
    up = np.array([0.0, -1.0, 0.0])  # an OpenCV-like world: y down
    twin = dataclasses.replace(toy_cabinet_twin(2), up=up)
    model = load(twin, tmp_path, "scene.xml")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ground = model.geom("ground").id
    np.testing.assert_allclose(data.geom_xmat[ground].reshape(3, 3)[:, 2], up, atol=1e-9)
    np.testing.assert_allclose(model.opt.gravity, -9.81 * up, atol=1e-9)
    # the door swings to y = -0.6 sin(q): it never goes above y = 0.6
    assert data.geom_xpos[ground] @ up < -0.6


def test_unit_scale_enters_gravity_and_mass(tmp_path: Path) -> None:
    twin = dataclasses.replace(toy_cabinet_twin(1), meters_per_unit=0.1)
    model = load(twin, tmp_path, "scene.xml")
    assert model.opt.gravity[2] == pytest.approx(-98.1)
    assert model.body("base").mass[0] == pytest.approx(22.3208352e-3, rel=1e-9)


def test_base_alone_has_no_joints_and_compiles(tmp_path: Path) -> None:
    model = load(toy_cabinet_twin(0), tmp_path, "scene.xml")
    assert (model.nq, model.nu, model.nkey) == (0, 0, 0)


def test_fixed_part_is_welded(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(2)
    door = dataclasses.replace(
        twin.parts[2], joint=Joint("fixed", np.array([0, 0, 1.0]), np.zeros(3), 0.0)
    )
    model = load(dataclasses.replace(twin, parts=(*twin.parts[:2], door)), tmp_path)
    assert model.njnt == 1
    assert model.body("part_2").jntnum[0] == 0


def test_nan_is_refused(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(1)
    joint = dataclasses.replace(twin.parts[1].joint, origin=np.array([np.nan, 0, 0]))
    drawer = dataclasses.replace(twin.parts[1], joint=joint)
    with pytest.raises(ExportError, match="finite"):
        write_mjcf(dataclasses.replace(twin, parts=(twin.parts[0], drawer)), tmp_path)


def test_bad_part_name_is_refused(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(0)
    base = dataclasses.replace(twin.parts[0], name="../base")
    with pytest.raises(ExportError, match="cannot be a file name"):
        write_mjcf(dataclasses.replace(twin, parts=(base,)), tmp_path)
