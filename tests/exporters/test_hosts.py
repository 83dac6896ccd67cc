"""A twin in other people's worlds: nothing of it leaks, and it moves there as it does alone."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.exporters.dynamics import physics_of
from part2gs_robotics.exporters.mjcf import joint_name, write_mjcf
from part2gs_robotics.model.kinematics import moving_parts

MOVING = 4
TWINS = ("twin.xml", "twin_actuated.xml")
# Bodies without inertials and with plain numbers: whatever a neighbour leaks changes them.
BODIES = """<body name="ball"><freejoint name="free"/><geom name="ball" size=".1"/></body>
<body name="arm" pos="3 0 0"><joint name="elbow" axis="0 1 0" range="-90 45"/>
  <geom name="arm" type="box" size=".1 .2 .3"/>
  <body name="hand" euler="30 0 0"><joint name="wrist" type="slide" range="0 .2"/>
    <geom name="hand" type="capsule" size=".05 .1"/></body></body>"""
MOTOR = '<actuator><position name="m" joint="elbow" kp="5"/></actuator>'
ALONE = f"<mujoco><worldbody>{BODIES}</worldbody>{MOTOR}</mujoco>"
BESIDE = '<mujoco><include file="{}"/><worldbody>' + BODIES + f"</worldbody>{MOTOR}</mujoco>"


@pytest.fixture(autouse=True)
def _no_log_file() -> Iterator[None]:
    with engine_messages():
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("twin")
    write_mjcf(toy_cabinet_twin(MOVING), path)
    return path


def settings(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return all a neighbour could change in the bodies of ALONE."""
    found = {}
    for name in ("ball", "arm", "hand"):
        body, geom = model.body(name), model.geom(name)
        found |= {f"{name} {key}": np.array(getattr(body, key))
                  for key in ("mass", "inertia", "ipos", "iquat", "quat")}
        found |= {f"{name} {key}": np.array(getattr(geom, key))
                  for key in ("solref", "solimp", "friction", "contype", "group", "rgba", "margin")}
    for name in ("elbow", "wrist"):
        joint = model.joint(name)
        found |= {f"{name} {key}": np.array(getattr(joint, key))
                  for key in ("range", "damping", "armature", "frictionloss", "solimp", "solref")}
    motor = model.actuator("m")
    found |= {key: np.array(getattr(motor, key)) for key in ("gainprm", "biasprm", "forcerange")}
    options = ("timestep", "gravity", "integrator", "cone", "impratio", "jacobian")
    return found | {f"option {key}": np.array(getattr(model.opt, key)) for key in options}


@pytest.mark.parametrize("name", TWINS)
def test_include_leaves_the_neighbours_as_they_are(folder: Path, name: str) -> None:
    (folder / "host.xml").write_text(BESIDE.format(name))
    alone = settings(mujoco.MjModel.from_xml_string(ALONE))
    beside = settings(mujoco.MjModel.from_xml_path(str(folder / "host.xml")))
    for key, value in alone.items():
        np.testing.assert_array_equal(beside[key], value, err_msg=key)


@pytest.mark.parametrize("name", TWINS)
def test_the_twin_is_in_a_host_what_it_is_alone(folder: Path, name: str) -> None:
    (folder / "host.xml").write_text(BESIDE.format(name))
    alone = mujoco.MjModel.from_xml_path(str(folder / name))
    host = mujoco.MjModel.from_xml_path(str(folder / "host.xml"))
    for j in range(alone.njnt):
        one, two = alone.joint(j), host.joint(alone.joint(j).name)
        for key in ("range", "damping", "armature", "frictionloss", "axis", "pos", "solimp"):
            np.testing.assert_array_equal(getattr(one, key), getattr(two, key))
    for b in range(1, alone.nbody):
        one, two = alone.body(b), host.body(alone.body(b).name)
        np.testing.assert_array_equal(one.mass, two.mass)
        np.testing.assert_array_equal(one.inertia, two.inertia)


def test_scene_takes_a_free_sphere(folder: Path) -> None:
    (folder / "more.xml").write_text(
        '<mujoco><include file="scene.xml"/><worldbody><body name="ball" pos="2 0 3"><freejoint/>'
        '<geom size=".1"/></body></worldbody></mujoco>')
    model = mujoco.MjModel.from_xml_path(str(folder / "more.xml"))
    scene = mujoco.MjModel.from_xml_path(str(folder / "scene.xml"))
    assert model.nq == scene.nq + 7
    assert model.body("ball").mass[0] == pytest.approx(1000 * 4 / 3 * np.pi * 1e-3)


def test_nothing_that_counts_for_a_whole_model_is_written(folder: Path) -> None:
    for name in TWINS:
        root = ET.parse(folder / name).getroot()
        assert {child.tag for child in root} <= {
            "default", "asset", "worldbody", "actuator", "equality", "keyframe"}
        (unnamed,) = root.findall("default")
        assert [child.tag for child in unnamed] == ["default"]
        for one in unnamed.iter("default"):
            assert one is unnamed or one.get("class", "").startswith("toy_cabinet_")


def copies(folder: Path, name: str) -> mujoco.MjModel:
    """Return a world with the twin twice, turned and shifted."""
    world = mujoco.MjSpec()
    for prefix, pos, quat in (("a_", (0, 0, 0), (1, 0, 0, 0)), ("b_", (3, -1, 2), (0.5,) * 4)):
        frame = world.worldbody.add_frame(pos=pos, quat=quat)
        world.attach(mujoco.MjSpec.from_file(str(folder / name)), prefix=prefix, frame=frame)
    return world.compile()


def transforms(model: mujoco.MjModel, prefix: str, positions: dict[str, float]) -> list[np.ndarray]:
    data = mujoco.MjData(model)
    for joint, q in positions.items():
        data.joint(prefix + joint).qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return [np.block([[data.body(prefix + p.name).xmat.reshape(3, 3),
                       data.body(prefix + p.name).xpos[:, None]], [np.zeros((1, 3)), 1.0]])
            for p in toy_cabinet_twin(MOVING).parts]


@pytest.mark.parametrize("name", TWINS)
def test_two_attached_copies_move_like_one_alone(folder: Path, name: str) -> None:
    twin = toy_cabinet_twin(MOVING)
    alone, both = mujoco.MjModel.from_xml_path(str(folder / name)), copies(folder, name)
    screw, rng = twin.parts[-1], np.random.default_rng(2)
    rest = {prefix: transforms(both, prefix, {})[0] for prefix in ("a_", "b_")}
    for _ in range(50):
        q = {joint_name(twin.parts[i]): rng.uniform(*twin.parts[i].limits)
             for i in moving_parts(twin)}
        q[f"{joint_name(screw)}_slide"] = screw.joint.pitch * q[joint_name(screw)]
        want = transforms(alone, "", q)
        for prefix, place in rest.items():
            for found, one in zip(transforms(both, prefix, q), want, strict=True):
                np.testing.assert_allclose(found, place @ one, atol=1e-9)
    for part in twin.parts:
        for prefix in rest:
            np.testing.assert_array_equal(both.body(prefix + part.name).mass,
                                          alone.body(part.name).mass)
    assert both.nu == 2 * alone.nu
    assert {"a_state_0", "a_state_1", "b_state_0", "b_state_1"} == {
        both.key(k).name for k in range(both.nkey)}


def test_attach_in_xml_shields_the_twin_from_a_host_in_radians(folder: Path) -> None:
    (folder / "radians.xml").write_text(
        '<mujoco><compiler angle="radian" meshdir="elsewhere"/><asset><model name="twin" '
        'file="twin.xml"/></asset><worldbody><frame><attach model="twin" prefix="t_"/></frame>'
        '</worldbody></mujoco>')
    host = mujoco.MjModel.from_xml_path(str(folder / "radians.xml"))
    np.testing.assert_allclose(host.joint("t_part_2_joint").range, (0, 1.5), atol=1e-9)


@pytest.mark.parametrize("host", [
    '<mujoco><compiler meshdir="{0}" texturedir="{0}"/><include file="{0}/twin.xml"/></mujoco>',
    '<mujoco><asset><model name="t" file="{0}/twin.xml"/></asset><worldbody><frame><attach '
    'model="t" prefix=""/></frame></worldbody></mujoco>'])
def test_a_host_in_another_folder_finds_the_meshes(tmp_path: Path, folder: Path,
                                                   host: str) -> None:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/twin").symlink_to(folder)
    (tmp_path / "host.xml").write_text(host.format("robots/twin"))
    found = mujoco.MjModel.from_xml_path(str(tmp_path / "host.xml"))
    alone = mujoco.MjModel.from_xml_path(str(folder / "twin.xml"))
    np.testing.assert_array_equal(found.mesh_vert, alone.mesh_vert)


def test_twin_is_passive_and_its_motors_are_one_more_file(folder: Path) -> None:
    passive, actuated, scene = (mujoco.MjModel.from_xml_path(str(folder / n))
                                for n in ("twin.xml", "twin_actuated.xml", "scene.xml"))
    assert passive.nu == 0
    assert actuated.nu == scene.nu == MOVING
    assert ET.parse(folder / "scene.xml").find("include").get("file") == "twin_actuated.xml"
    for model in (passive, actuated, scene):
        assert [model.key(k).name for k in range(model.nkey)] == ["state_0", "state_1"]
        np.testing.assert_array_equal(model.key_qpos, passive.key_qpos)
    for state in (0, 1):
        for a in range(actuated.nu):
            address = actuated.jnt_qposadr[actuated.actuator_trnid[a, 0]]
            assert actuated.key_ctrl[state, a] == actuated.key_qpos[state, address]
    assert (actuated.actuator_forcelimited == 1).all()


def test_servos_are_critically_damped(folder: Path) -> None:
    model = mujoco.MjModel.from_xml_path(str(folder / "twin_actuated.xml"))
    twin = toy_cabinet_twin(MOVING)
    for index, dyn in physics_of(twin).joints.items():
        a = model.actuator(f"{twin.parts[index].name}_servo").id
        kp, kv = -model.actuator_biasprm[a, 1], -model.actuator_biasprm[a, 2]
        assert kp == pytest.approx(dyn.kp, rel=1e-9)
        # 2 %: a door whose lever may swing feels a little lighter than with it held
        assert kv / (2 * np.sqrt(kp * (dyn.inertia + dyn.armature))) == pytest.approx(1, abs=0.02)


def test_scene_alone_holds_options_sky_light_and_ground(folder: Path) -> None:
    root = ET.parse(folder / "scene.xml").getroot()
    assert root.find("option") is not None
    assert root.find("worldbody/light") is not None
    assert {t.get("type") for t in root.iter("texture")} == {"skybox", "2d"}
