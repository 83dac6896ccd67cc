"""Motors of a URDF: just strong enough passes, just too weak warns, and speed is kept."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.sim_checks.motors import LONGEST, check_motors, motors_of
from part2gs_robotics.sim_checks.subject import make_subject

LINK = """<link name="{name}"><inertial><origin xyz="{at} 0 0"/><mass value="3"/><inertia ixx=".01"
 ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial><collision><origin xyz="{at} 0 0"/><geometry>
 <box size=".1 .05 .05"/></geometry></collision></link>"""
ARM = ("<robot name='r'>" + LINK.format(name="base", at=0) + LINK.format(name="arm", at=0.3)
       + """<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/>
 <origin xyz="0 0 .4"/><axis xyz="0 -1 0"/><limit lower="-0.5" upper="1" {limit}/></joint>
 </robot>""")
WEIGHT = 3 * 9.81 * 0.3  # N m: all of it at q = 0


@pytest.fixture(autouse=True)
def _no_log_file() -> Iterator[None]:
    with engine_messages():
        yield


def row(folder: Path, limit: str):
    path = folder / "arm.urdf"
    path.write_text(ARM.format(limit=limit))
    (found,) = check_motors(make_subject(path, ours=False), path)
    return found


def test_a_motor_that_just_carries_its_arm_passes_and_a_weaker_one_warns(tmp_path: Path) -> None:
    assert row(tmp_path, f'effort="{1.1 * WEIGHT}" velocity="0.5"').status == "pass"
    weak = row(tmp_path, f'effort="{0.9 * WEIGHT}" velocity="0.5"')
    assert weak.status == "warn"
    assert weak.value < 0.99
    pull = float(weak.detail.rpartition(" ")[2])
    assert pull == pytest.approx(WEIGHT, rel=0.01)
    assert "raise effort of hinge" in weak.cause


def test_a_velocity_limit_is_what_the_drive_takes(tmp_path: Path) -> None:
    found = row(tmp_path, 'effort="30" velocity="0.5"')
    assert f"{1.875 * 1.5 / 0.5:.3g} s each" in found.detail
    assert found.status == "pass"
    slow = row(tmp_path, f'effort="30" velocity="{1.875 * 1.5 / LONGEST / 2}"')
    assert slow.status == "warn"
    assert "raise velocity" in slow.cause


@pytest.mark.parametrize(("limit", "lacking"), [
    ('effort="0" velocity="1"', "effort"), ('effort="1" velocity="0"', "velocity"),
    ('effort="nan" velocity="heavy"', "effort and velocity"), ("", "effort and velocity")])
def test_a_motor_that_is_none_is_named(tmp_path: Path, limit: str, lacking: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.format(limit=limit))
    assert set(motors_of(path)) == {"hinge"}
    if "heavy" not in limit:  # which the engine does not read
        found = row(tmp_path, limit)
        assert found.status == "warn"
        assert found.detail.startswith(lacking)


def test_other_files_have_no_such_rows(tmp_path: Path) -> None:
    (tmp_path / "m.xml").write_text("<mujoco><worldbody><body><joint/><geom size='1'/></body>"
                                    "</worldbody></mujoco>")
    assert check_motors(make_subject(tmp_path / "m.xml", ours=False), tmp_path / "m.xml") == []
