"""Passive joints by the stated rule: a finger moves a door, in any unit and at any size."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import scaled, toy_cabinet_twin

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.dynamics import COAST, FRICTION, HOLD, physics_of
from part2gs_robotics.exporters.inertia import density
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.xmlio import numbers
from part2gs_robotics.model.materials import MATERIALS, density_of

EDGE = 0.6  # m from the door's hinge to its free edge


def test_rule_of_the_passive_numbers() -> None:
    """The drawer by hand: 7.1 kg on slides."""
    drawer = physics_of(toy_cabinet_twin(1)).joints[1]
    assert drawer.mass == pytest.approx(7.1028864)
    six = 5e-6  # the numbers have six digits
    assert drawer.friction == pytest.approx(FRICTION * drawer.mass * 9.81, rel=six)
    assert drawer.damping == pytest.approx(1.02 * drawer.mass / COAST, rel=six)


def test_a_finger_moves_a_door(tmp_path: Path) -> None:
    """At rest 2.6 kg of door give way to half a newton at the edge, and 2 N open it in 2 s."""
    write_mjcf(toy_cabinet_twin(2), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    door = model.joint("part_2_joint")
    assert 0.1 < door.frictionloss[0] / EDGE < 0.5
    data = mujoco.MjData(model)
    data.qfrc_applied[door.dofadr[0]] = 2.0 * EDGE
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    assert data.joint("part_2_joint").qpos[0] > np.deg2rad(80)


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_twin_moves_alike_in_every_unit(factor: float) -> None:
    """Time constants and the share of friction in the weight know no unit."""
    metres = toy_cabinet_twin(4)
    one, two = physics_of(metres), physics_of(scaled(metres, factor))
    assert one.step == pytest.approx(two.step)
    for index, a in one.joints.items():
        b = two.joints[index]
        assert a.damping / a.inertia == pytest.approx(b.damping / b.inertia, rel=1e-6)
        assert a.friction / a.inertia == pytest.approx(
            b.friction / b.inertia / (factor if index == 1 else 1.0), rel=1e-5)  # six digits
        assert a.frequency == pytest.approx(b.frequency, rel=1e-5)  # six digits of kp


def test_friction_lets_a_tilted_door_stand() -> None:
    """A door 1 degree off plumb is pulled less hard than friction holds."""
    dyn = physics_of(toy_cabinet_twin(2)).joints[2]
    assert dyn.friction > dyn.mass * 9.81 * (EDGE / 2) * np.sin(np.deg2rad(1))


def test_a_part_stands_where_it_stood() -> None:
    """The lever hangs 4 cm below its pivot in state 0, and stood half a radian aside in state 1."""
    dyn = physics_of(toy_cabinet_twin(3)).joints[3]
    assert dyn.friction == pytest.approx(HOLD * dyn.mass * 9.81 * 0.04 * np.sin(0.5), rel=1e-5)


@pytest.mark.parametrize(("end", "lies"), [(np.pi / 2, True), (1.01 * np.pi / 2, True), (2, False)])
def test_a_part_that_lies_on_its_stop_needs_no_friction(end: float, lies: bool) -> None:
    """The lever stands on its pivot in state 0 and has fallen level in state 1."""
    twin = toy_cabinet_twin(3)
    joint = dataclasses.replace(twin.parts[3].joint, value=np.pi / 2)
    lever = dataclasses.replace(twin.parts[3], joint=joint, limits=(0.0, end))
    dyn = physics_of(dataclasses.replace(twin, parts=(*twin.parts[:3], lever),
                                         up=np.array([0, 0, -1.0]))).joints[3]
    least = FRICTION * 9.81 * np.sqrt(dyn.inertia * dyn.mass)
    held = HOLD * dyn.mass * 9.81 * 0.04
    assert dyn.friction == pytest.approx(least if lies else held, rel=1e-5)


def test_what_carries_a_part_turns_its_joint(tmp_path: Path) -> None:
    """A lever's axis goes round with its door: on a wall that leans, its weight pulls elsewhere."""
    twin = toy_cabinet_twin(3)
    still = dataclasses.replace(twin.parts[3].joint, value=0.0)
    lever = dataclasses.replace(twin.parts[3], joint=still, limits=(-0.5, 0.5))
    twin = dataclasses.replace(twin, parts=(*twin.parts[:3], lever), up=np.array([0, 0.6, 0.8]))
    write_mjcf(twin, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    data, gravity = mujoco.MjData(model), physics_of(twin).gravity
    pulls = []
    for key in (0, 1):
        mujoco.mj_resetDataKeyframe(model, data, key)
        model.opt.gravity[:] = gravity
        mujoco.mj_forward(model, data)
        pulls.append(abs(float(data.qfrc_bias[model.joint("part_3_joint").dofadr[0]])))
    assert pulls[0] != pytest.approx(pulls[1], rel=0.1)
    assert physics_of(twin).joints[3].friction == pytest.approx(HOLD * max(pulls), rel=1e-5)


@pytest.mark.parametrize(("material", "want"), [
    (None, 600.0), ("steel", 7850.0), ("712.5", 712.5), ("furniture", 600.0)])
def test_material_is_a_name_or_a_number(material: str | None, want: float) -> None:
    twin = dataclasses.replace(toy_cabinet_twin(1), material=material)
    assert density(twin) == want
    base = physics_of(toy_cabinet_twin(1)).masses[0].mass
    assert physics_of(twin).masses[0].mass == pytest.approx(base * want / 600)


def test_unknown_material_is_named() -> None:
    twin = dataclasses.replace(toy_cabinet_twin(1), material="cheese")
    with pytest.raises(ExportError, match="'cheese' of the twin is unknown"):
        density(twin)


@pytest.mark.parametrize("text", ["", "nan", "inf", "-1", "0", "1e9", "Steel", "1,5"])
def test_what_is_no_material(text: str) -> None:
    assert density_of(text) is None
    assert all(density_of(name) == value for name, value in MATERIALS.items())


@pytest.mark.parametrize(("vector", "text"), [
    ((1.0, 1.2e-17, -3e-16), "1 0 0"), ((-0.0, 0.0), "0 0"), ((0.6, 0.8 + 1e-13, 0), "0.6 0.8 0"),
    ((1e-12, 2e-12), "1e-12 2e-12"), ((1 / 3, 1e-5 / 3), "0.3333333333 3.3333e-06"),
    ((12345.678901234,), "12345.6789")])
def test_numbers_have_ten_digits_and_no_noise(vector: tuple[float, ...], text: str) -> None:
    assert numbers(vector) == text
