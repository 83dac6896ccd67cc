"""Stability rows: gains and steps that cannot be trusted are named."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.exporters.dynamics import physics_of
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.stability import check_stability, run_to_end
from part2gs_robotics.sim_checks.subject import make_subject

SLIDER = """<mujoco>
  <option timestep="{step}" gravity="0 0 0" integrator="{integrator}"/>
  <worldbody><body name="b">
    <joint name="j" type="slide" axis="1 0 0" range="0 1" limited="true" damping="{damping}"/>
    <geom type="box" size=".1 .1 .1" mass="{mass}"/>
  </body></worldbody>
  <actuator><position joint="j" kp="{kp}" kv="{kv}" {force}/></actuator>
</mujoco>"""


@pytest.fixture(autouse=True)
def _no_log_file() -> Iterator[None]:
    """The rooms below `check` leave the engine's words to it."""
    with engine_messages():
        yield


def slider(folder: Path, **numbers: object) -> Path:
    given = {"step": 0.002, "integrator": "implicitfast", "damping": 1, "mass": 1, "kp": 900,
             "kv": 60, "force": ""}  # fmt: skip
    (folder / "m.xml").write_text(SLIDER.format(**(given | numbers)))
    return folder / "m.xml"


def test_sound_slider_passes(tmp_path: Path) -> None:
    rows = check_stability(make_subject(slider(tmp_path)))
    assert [r.name for r in rows].count("time step") == 2
    assert all(r.status == "pass" for r in rows), rows


@pytest.mark.parametrize("numbers", [
    {"kp": 1e8, "kv": 10, "integrator": "Euler"},  # explicit spring: frequency x step = 20
    {"kp": 1e5, "kv": 600, "integrator": "implicitfast"},  # stable, but not at gain x 100
    # simulation.md: a force-limited servo on a drawer a million times too light stalls silently
    {"mass": 7e-6, "kp": 900, "kv": 60, "damping": 0, "force": 'forcerange="-50 50"'},
])  # fmt: skip
def test_unstable_servo_is_named_with_its_step(tmp_path: Path, numbers: dict[str, object]) -> None:
    rows = check_stability(make_subject(slider(tmp_path, **numbers)))
    bad = [r for r in rows if r.status == "fail"]
    assert bad
    assert any(r.subject == "j" and "h" in r.detail for r in bad)


def test_model_is_left_as_it_was(tmp_path: Path) -> None:
    subject = make_subject(slider(tmp_path))
    before = subject.model.opt.timestep, subject.model.actuator_gainprm.copy()
    run_to_end(subject, subject.joints[0], 0.0005, 100.0)
    assert subject.model.opt.timestep == before[0]
    assert (subject.model.actuator_gainprm == before[1]).all()


def test_two_runs_are_equal_to_the_last_bit(tmp_path: Path) -> None:
    subject = make_subject(slider(tmp_path))
    ends = {run_to_end(subject, subject.joints[0], 0.002, 1.0).position for _ in range(2)}
    assert len(ends) == 1


def test_free_energy_is_caught(tmp_path: Path) -> None:
    """Negative damping feeds a pendulum: the passive row says so."""
    (tmp_path / "m.xml").write_text(
        """<mujoco><option integrator="Euler"><flag eulerdamp="disable"/></option><worldbody>
        <body name="b"><joint name="j" axis="0 1 0" range="-3 3" limited="true" damping="-2"/>
        <geom type="box" size=".1 .1 .1" pos=".01 0 -.3" mass="1"/></body></worldbody></mujoco>"""
    )
    report = check(tmp_path / "m.xml", only=("stability",))
    assert any(r.name in ("passive", "hold") and r.status == "fail" for r in report.results)


def test_time_step_of_the_exporter_resolves_gain_x_100() -> None:
    physics = physics_of(toy_cabinet_twin(4))
    fastest = max(d.frequency for d in physics.joints.values())
    assert 10 * fastest * physics.step < 4.83  # implicit critical damping, explicit spring
