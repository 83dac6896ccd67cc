"""Files of others: packages resolved within their home, USD translated, bombs and leaks refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.assets.model_files import check_model_files, home_of, package_file
from part2gs_robotics.assets.opened import opened
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.usd import write_usd

BOX = "v -.1 -.1 -.1\nv .1 -.1 -.1\nv 0 .1 -.1\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
URDF = """<robot name="r"><link name="base"><collision><geometry>
<mesh filename="{name}"/></geometry></collision></link>
<link name="lid"><inertial><mass value="1"/>
<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>
<joint name="h" type="revolute"><parent link="base"/><child link="lid"/><axis xyz="0 1 0"/>
<limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def package(folder: Path, name: str, marked: bool = True) -> Path:
    for place in ("urdf", "meshes"):
        (folder / "pack" / place).mkdir(parents=True)
    if marked:
        (folder / "pack/package.xml").write_text("<package/>")
    (folder / "pack/meshes/a.obj").write_text(BOX)
    (folder / "pack/urdf/m.urdf").write_text(URDF.format(name=name))
    return folder / "pack/urdf/m.urdf"


def compiled(path: Path, root: Path | None = None) -> mujoco.MjModel:
    with opened(path, root) as file:
        assert file.name.startswith(path.name)
        return mujoco.MjSpec.from_file(str(file)).compile()


@pytest.mark.parametrize("name", ["package://pack/meshes/a.obj", "../meshes/a.obj",
                                  "package://other_name/meshes/a.obj"])
def test_a_package_is_found_by_its_package_xml(tmp_path: Path, name: str) -> None:
    assert compiled(package(tmp_path, name)).nmesh == 1


def test_without_a_mark_the_user_names_the_folder(tmp_path: Path) -> None:
    path = package(tmp_path, "package://pack/meshes/a.obj", marked=False)
    assert home_of(path) == path.parent.resolve()
    with pytest.raises(CheckError, match=r"leaves the folder|is not found"), opened(path):
        pass
    assert compiled(path, tmp_path).nmesh == 1
    with pytest.raises(CheckError, match="does not lie in"):
        home_of(path, tmp_path / "pack/meshes")


@pytest.mark.parametrize("name", ["package://pack/../../secret.obj", "package://../secret.obj",
                                  "../../secret.obj", "package://pack/none.obj"])
def test_no_package_leads_out_of_its_home(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.obj").write_text(BOX)
    path = package(tmp_path, name)
    assert name.startswith("..") or package_file(name, path, home_of(path)) is None
    with pytest.raises(CheckError, match=r"leaves the folder|is not found"), opened(path):
        pass


def test_nothing_is_left_behind(tmp_path: Path) -> None:
    path = package(tmp_path, "package://pack/meshes/a.obj")
    before = sorted(tmp_path.rglob("*"))
    with opened(path) as copy:
        assert copy != path
    assert not copy.exists()
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("text", [
    '<texture name="t" builtin="flat" type="2d" width="99999" height="99999"/>',
    '<hfield name="f" nrow="9999" ncol="9999" size="1 1 1 1"/>'])
def test_what_would_fill_the_memory_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.xml").write_text(f"<mujoco><asset>{text}</asset></mujoco>")
    with pytest.raises(CheckError, match="asks for"):
        check_model_files(tmp_path / "m.xml")


def test_copies_of_copies_are_refused_and_plain_ones_are_not(tmp_path: Path) -> None:
    def written(depth: int) -> Path:
        copies = '<replicate count="50" offset="1 0 0">' * depth
        body = f"{copies}<geom size='.1'/>{'</replicate>' * depth}"
        (tmp_path / "m.xml").write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
        return tmp_path / "m.xml"

    assert check_model_files(written(2))
    with pytest.raises(CheckError, match=r"<replicate count='50'> asks for 125000"):
        check_model_files(written(3))


@pytest.mark.parametrize("name", ["none", "utf-7x", "utf-32"])
def test_encodings_that_cannot_be_read_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / "m.xml").write_text(f'<?xml version="1.0" encoding="{name}"?><mujoco/>')
    with pytest.raises(CheckError, match=r"encoding|well-formed"):
        check_model_files(tmp_path / "m.xml")


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("usd")
    write_usd(toy_cabinet_twin(3), folder)
    return folder / "twin.usd"


def test_a_stage_is_the_twin_that_mjcf_has(stage: Path, tmp_path: Path) -> None:
    """The same bodies at any joint positions, masses and inertias: two exporters, two readers."""
    write_mjcf(toy_cabinet_twin(3), tmp_path)
    one, two = compiled(stage), mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    names = [two.body(b).name for b in range(1, two.nbody)]
    assert [one.body(b).name for b in range(1, one.nbody)] == names
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(two.jnt_range[:, 0], two.jnt_range[:, 1])
        centers = []
        for model in (one, two):
            data = mujoco.MjData(model)
            data.qpos[:] = q
            mujoco.mj_fwdPosition(model, data)
            centers.append(data.xipos[1:].copy())
        np.testing.assert_allclose(centers[0], centers[1], atol=2e-6)  # float32 places
    np.testing.assert_allclose(one.body_mass, two.body_mass, rtol=1e-6)
    np.testing.assert_allclose(one.jnt_range, two.jnt_range, rtol=1e-6)
    np.testing.assert_allclose(one.dof_damping, two.dof_damping, rtol=1e-5)
    np.testing.assert_allclose(np.sort(one.body_inertia[1:], 1), np.sort(two.body_inertia[1:], 1),
                               rtol=1e-4)


def test_shapes_and_turned_joints_of_a_stage_by_hand(tmp_path: Path) -> None:
    """Centimetres, Y up, a joint that names the child first, a cube and a cylinder."""
    (tmp_path / "s.usda").write_text("""#usda 1.0
(metersPerUnit = 0.01
 upAxis = "Y")
def Xform "r" {
  def Xform "a" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {
    def Cube "c" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
      double size = 10
    }
  }
  def Xform "b" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {
    double3 xformOp:translate = (0, 30, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Cylinder "d" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
      double radius = 5
      double height = 20
      uniform token axis = "Y"
    }
  }
  def PhysicsFixedJoint "f" {
    rel physics:body1 = </r/a>
  }
  def PhysicsRevoluteJoint "j" {
    rel physics:body0 = </r/b>
    rel physics:body1 = </r/a>
    point3f physics:localPos0 = (0, -20, 0)
    point3f physics:localPos1 = (0, 10, 0)
    uniform token physics:axis = "Z"
    float physics:lowerLimit = 0
    float physics:upperLimit = 90
  }
}
""")
    model = compiled(tmp_path / "s.usda")
    assert model.opt.gravity[1] == -9.81
    assert model.body("b").parentid == model.body("a").id
    np.testing.assert_allclose(model.body("b").pos, [0, 0.3, 0], atol=1e-9)
    np.testing.assert_allclose(model.joint("j").axis, [0, 0, -1])  # seen from the other side
    np.testing.assert_allclose(model.joint("j").range, [0, np.pi / 2], rtol=1e-6)
    assert model.body_mass[model.body("a").id] == pytest.approx(1000 * 0.1**3, rel=1e-4)
    assert model.body_mass[model.body("b").id] == pytest.approx(np.pi * 0.05**2 * 0.2 * 1000,
                                                                rel=0.02)  # 32 sides


@pytest.mark.parametrize("content", [
    b"", b"PXR-USDC" + bytes(200), b"#usda 1.0\n", b"#usda 1.0\ndef Xform 'x' {",
    b'#usda 1.0\n(subLayers = [@../secret.usda@])\n'])
def test_stages_that_cannot_be_used_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "secret.usda").write_text("#usda 1.0\n")
    (tmp_path / "in/s.usda").write_bytes(content)
    with pytest.raises(CheckError, match="cannot be read as a USD stage"), opened(
            tmp_path / "in/s.usda"):
        pass
