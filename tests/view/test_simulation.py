"""A twin moved by hand: servos go where they are asked, and what is in the way stops them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synth import toy_cabinet_twin, union_part

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.kinematics import part_transforms
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.view.simulation import LONGEST, Simulation


def written(twin: Twin, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    write_mjcf(twin, folder)
    write_twin_yaml(twin, folder, {})
    return folder


def settled(simulation: Simulation, seconds: float = 3.0) -> Simulation:
    for _ in range(round(seconds / LONGEST)):
        simulation.advance(LONGEST)
    return simulation


def facing_slides() -> Twin:
    """Two blocks on rails along x, 0.2 m apart: each can reach the other."""
    base = union_part("base", -1, [((-1, -1, -0.1), (1, 1, 0))], None, (0.0, 0.0), (90, 90, 90))
    blocks = [union_part(name, 0, [((x, 0, 0.01), (x + 0.1, 0.1, 0.11))],
                         Joint("prismatic", np.array([way, 0, 0]), np.array([x, 0, 0.0]), 0.1),
                         (0.0, 0.4), (200, 0, 0))
              for name, x, way in (("part_1", -0.2, 1.0), ("part_2", 0.1, -1.0))]
    return Twin("slides", (base, *blocks), meters_per_unit=1.0, up=np.array([0, 0, 1.0]))


def test_joints_go_where_they_are_asked_and_parts_with_them(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(4)
    simulation = Simulation(written(twin, tmp_path))
    asked = [0.2, 1.0, 0.3, 1.5]
    for number, target in enumerate(asked):
        simulation.ask(number, target)
    q = settled(simulation).positions()
    np.testing.assert_allclose(q, asked, atol=0.02)
    for ours, pose in zip(part_transforms(twin, q), simulation.poses(), strict=True):
        np.testing.assert_allclose(pose, ours, atol=2e-3)  # a screw's rise is a soft equality


def test_a_block_stops_at_the_other_and_the_contact_is_named(tmp_path: Path) -> None:
    simulation = Simulation(written(facing_slides(), tmp_path))
    assert settled(simulation, 0.5).touching() == ()
    simulation.ask(0, 0.4)
    q = settled(simulation).positions()
    assert 0.19 < q[0] < 0.3, "0.2 m to the other block, which gives way a little"
    (touch,) = simulation.touching()
    assert (touch.one, touch.other) == ("part_1", "part_2")
    assert 0 <= touch.depth < 0.005
    simulation.ask(0, 0.0)
    assert settled(simulation).touching() == ()


def test_targets_stay_inside_the_range(tmp_path: Path) -> None:
    simulation = Simulation(written(toy_cabinet_twin(2), tmp_path))
    simulation.ask(1, 99.0)
    simulation.ask(0, -99.0)
    assert simulation.targets == [0.0, 1.5]


def test_a_pulled_point_comes_to_the_hand(tmp_path: Path) -> None:
    """Drawer, door, a lever that rides on the door, a screw: each by a point far from its axis."""
    twin = toy_cabinet_twin(4)
    simulation = Simulation(written(twin, tmp_path))
    at = [0.1, 0.7, 0.2, 0.5]
    for number, start in enumerate(at):
        simulation.ask(number, start)
    at = settled(simulation).positions()
    for number, step in enumerate((0.03, 0.05, 0.04, 0.05)):
        place = twin.parts[number + 1].mesh.vertices.max(0)
        held, hand = (np.array(part_transforms(twin, q)[number + 1] @ [*place, 1])[:3]
                      for q in (at, [*at[:number], at[number] + step, *at[number + 1:]]))
        simulation.pull(number, held, hand)
        assert simulation.targets[number] - at[number] == pytest.approx(step, rel=0.1)


def test_a_point_on_the_axis_pulls_at_nothing(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(2)
    simulation = Simulation(written(twin, tmp_path))
    origin = twin.parts[2].joint.origin
    simulation.pull(1, origin, origin + 1.0)
    assert simulation.targets == [0.0, 0.0]


@pytest.mark.parametrize(("spoil", "message"), [
    (lambda f: (f / "twin.yaml").unlink(), "twin.yaml"),
    (lambda f: (f / "scene.xml").unlink(), "scene.xml"),
    (lambda f: (f / "scene.xml").write_text("<mujoco><x/></mujoco>"), "MuJoCo does not compile"),
    (lambda f: (f / "scene.xml").write_text("<mujoco/>"), "has no base"),
    (lambda f: (f / "scene.xml").write_text('<mujoco><include file="../x"/></mujoco>'), "scene"),
])
def test_a_folder_that_is_no_twin_is_refused(tmp_path: Path, spoil, message: str) -> None:
    folder = written(toy_cabinet_twin(1), tmp_path / "twin")
    spoil(folder)
    with pytest.raises(CheckError, match=message):
        Simulation(folder)
