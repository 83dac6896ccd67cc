"""Servos: every number against its closed form, every defect by the row meant for it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest

from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.sim_checks.response import (
    FAST,
    SLOW,
    check_response,
    run_of,
    step_of,
    turns_of,
)
from part2gs_robotics.sim_checks.rest import check_rest
from part2gs_robotics.sim_checks.stability import check_stability
from part2gs_robotics.sim_checks.subject import Subject, make_subject

KP, MASS, WAY = 900.0, 1.0, 0.9  # rad/s of the servo: 30
SLIDER = """<mujoco><option timestep=".001" gravity="{gravity}" integrator="implicitfast"/>
  <worldbody><body name="b">
    <joint name="j" type="slide" axis="0 0 1" range="0 1" limited="true" {joint}/>
    <geom type="box" size=".1 .1 .1" mass="1"/>{more}
  </body></worldbody>
  <actuator><position joint="j" kp="{kp}" kv="{kv}" {force}/></actuator>
</mujoco>"""


@pytest.fixture(autouse=True)
def _no_log_file() -> Iterator[None]:
    with engine_messages():
        yield


def slider(folder: Path, **given: object) -> Subject:
    numbers = {"kp": KP, "kv": 60, "force": "", "joint": "", "gravity": "0 0 0", "more": ""} | given
    (folder / "m.xml").write_text(SLIDER.format(**numbers))
    return make_subject(folder / "m.xml")


def failed(rows: list) -> set[str]:
    return {r.name for r in rows if r.status == "fail"}


def test_a_critically_damped_step_is_that_of_the_book(tmp_path: Path) -> None:
    """x = 1 - (1 + w t) exp(-w t): no overshoot; 5 % are left at w t = 4.744."""
    subject = slider(tmp_path)
    step = step_of(subject, subject.joints[0])
    assert abs(step.overshoot) < 1e-4
    assert step.settling == pytest.approx(4.744 / 30, abs=0.006)  # a sample is 5 ms
    assert step.turns == 0


@pytest.mark.parametrize("zeta", [0.1, 0.3, 0.5])
def test_overshoot_and_turns_of_a_loose_servo(tmp_path: Path, zeta: float) -> None:
    """exp(-pi zeta / sqrt(1 - zeta^2)); a turn every half period until 0.1 % of the speed."""
    subject = slider(tmp_path, kv=60 * zeta)
    step = step_of(subject, subject.joints[0])
    root = np.sqrt(1 - zeta**2)
    assert step.overshoot == pytest.approx(np.exp(-np.pi * zeta / root), rel=0.02)
    swings = 30 * root / np.pi * min(3.0, np.log(1e3) / (30 * zeta))
    assert abs(step.turns - swings) <= 2
    rows = check_response(subject)
    assert ("overshoot" in failed(rows)) == (zeta < 0.4)


def test_a_servo_without_damping_is_caught_three_ways(tmp_path: Path) -> None:
    rows = check_response(slider(tmp_path, kv=1))
    assert {"overshoot", "settling", "jitter"} <= failed(rows)
    assert all(r.cause == "" for r in rows)  # the runner adds what mends it


def test_a_soft_servo_settles_late(tmp_path: Path) -> None:
    """Overdamped: time constant kv / kp = 1 s, 5 % are left after 3 s."""
    subject = slider(tmp_path, kp=100, kv=100)
    assert step_of(subject, subject.joints[0]).settling > 1.5
    rows = check_response(subject)
    assert "settling" in failed(rows)
    json.dumps([r.to_dict() for r in rows], allow_nan=False)  # never is no number


def test_a_step_does_not_depend_on_the_force_range(tmp_path: Path) -> None:
    """A servo that saturates swings whatever its gains are; the fast drive is its trial."""
    subject = slider(tmp_path, force='forcerange="-20 20"')
    assert abs(step_of(subject, subject.joints[0]).overshoot) < 1e-4


def test_effort_is_weight_over_force_range(tmp_path: Path) -> None:
    """Slowly lifted, a kilogram takes 9.81 N of 20."""
    subject = slider(tmp_path, gravity="0 0 -9.81", kp=1e4, kv=200, force='forcerange="-20 20"')
    run = run_of(subject, subject.joints[0], SLOW)
    assert run.effort == pytest.approx(9.81 / 20, rel=0.03)  # and 0.06 N to set it in motion
    assert run.speeding == pytest.approx(1.0, abs=0.02)


def test_a_servo_that_can_hardly_lift_is_caught(tmp_path: Path) -> None:
    weak = slider(tmp_path, gravity="0 0 -9.81", kp=1e4, kv=200, force='forcerange="-10 10"')
    assert {"fast drive", "effort"} <= failed(check_response(weak, stress=True))
    weaker = slider(tmp_path, gravity="0 0 -9.81", kp=1e4, kv=200, force='forcerange="-9 9"')
    assert "hold" in failed(check_rest(weaker))


def test_the_fast_drive_commands_what_it_says(tmp_path: Path) -> None:
    """A stiff servo follows: 1.875 span / time at the top, both ends reached."""
    subject = slider(tmp_path, kp=1e6, kv=2e3)
    run = run_of(subject, subject.joints[0], FAST)
    assert run.speeding == pytest.approx(1.0, abs=0.01)
    assert (run.top, run.bottom) == pytest.approx((1.0, 0.0), abs=1e-3)


def test_a_joint_that_outruns_its_command_is_caught(tmp_path: Path) -> None:
    rows = check_response(slider(tmp_path, kv=4))
    assert "fast drive" in failed(rows)


def test_turns_are_counted_but_for_creeping() -> None:
    assert turns_of(np.array([1.0, 0.5, -0.5, 0.4, 1e-4, -1e-4])) == 2
    assert turns_of(np.zeros(5)) == 0


def test_a_soft_servo_stays_below_its_end_by_its_droop(tmp_path: Path) -> None:
    """Weight over stiffness: 9.81 / 900 = 1.09 % of the way."""
    subject = slider(tmp_path, gravity="0 0 -9.81")
    run = run_of(subject, subject.joints[0], SLOW)
    assert 1.0 - run.top == pytest.approx(9.81 / KP, rel=0.01)
    assert {"slow drive", "fast drive"} <= failed(check_response(subject, stress=True))


def test_half_way_droops_by_weight_over_stiffness(tmp_path: Path) -> None:
    subject = slider(tmp_path, gravity="0 0 -9.81", kp=2000, kv=90)
    (row,) = [r for r in check_rest(subject) if r.name == "hold"]
    assert row.value == pytest.approx(9.81 / 2000, rel=1e-3)
    assert row.status == "pass"
    assert "gravity pulls -9.81" in row.detail


def test_rest_is_droop_and_trembling(tmp_path: Path) -> None:
    subject = slider(tmp_path, gravity="0 0 9.81", kp=2000, kv=90)
    (row,) = [r for r in check_rest(subject, stress=True) if r.name == "rest"]
    assert row.value == pytest.approx(9.81 / 2000 / 0.01, rel=1e-2)  # of the 1 % allowed
    loose = slider(tmp_path, gravity="0 0 9.81", kp=500, kv=0)
    assert "rest" in failed(check_rest(loose, stress=True))


def test_chance_in_the_simulation_is_caught(tmp_path: Path) -> None:
    subject, rng = slider(tmp_path), np.random.default_rng(0)
    assert "determinism" not in failed(check_rest(subject))

    def disturb(_: object, data: mujoco.MjData) -> None:
        data.qfrc_applied[0] = rng.normal()

    mujoco.set_mjcb_control(disturb)
    try:
        assert "determinism" in failed(check_rest(subject))
    finally:
        mujoco.set_mjcb_control(None)


def test_ten_seconds_of_energy_find_what_two_do_not(tmp_path: Path) -> None:
    """Anti-damping of 1 /s feeds a swing by exp(10) instead of exp(2)."""
    (tmp_path / "m.xml").write_text(
        """<mujoco><compiler angle="radian"/>
        <option integrator="Euler" timestep=".001"><flag eulerdamp="disable"/></option>
        <worldbody><body name="b"><joint name="j" axis="0 1 0" range="-3 3" limited="true"
          damping="-.04"/><geom type="box" size=".02 .02 .02" pos=".01 0 -.3" mass="1"/></body>
        </worldbody></mujoco>""")
    subject = make_subject(tmp_path / "m.xml")
    short, long = (next(r for r in check_stability(subject, stress=s) if r.name == "passive")
                   for s in (False, True))
    assert long.value > short.value
    assert "in 10 s" in long.detail
