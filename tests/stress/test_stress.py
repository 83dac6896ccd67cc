"""Extremes against closed forms: orders of accuracy, references, similarity, walls, advice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth import toy_cabinet_twin, write_all

from part2gs_robotics import cli
from part2gs_robotics.assets.engine import engine_messages
from part2gs_robotics.errors import CheckError
from part2gs_robotics.sim_checks.subject import make_subject
from part2gs_robotics.stress import bullet, closed, extremes, motions, scaled, stress
from part2gs_robotics.stress.advice import advice, apply, frontier
from part2gs_robotics.stress.cells import Cell, Start, error_of, judged, run, with_options
from part2gs_robotics.stress.precision import INTEGRATORS, SECONDS, diagram, diverges_at

JOINT = """<mujoco><compiler angle="radian"/><option timestep=".002" gravity="0 0 0"
  integrator="{integrator}"/><worldbody>{stop}<body name="b">
  <joint name="j" type="{kind}" axis="1 0 0" range="0 1" damping="{damping}" armature=".1"/>
  <geom type="box" size=".1 .1 .1" mass="2"/></body></worldbody>
  <actuator><position joint="j" kp="{kp}" kv="{kv}"/></actuator></mujoco>"""


@pytest.fixture(autouse=True)
def _no_log_file() -> Iterator[None]:
    with engine_messages():
        yield


def joint(folder: Path, **numbers: object) -> Path:
    given = {"integrator": "implicitfast", "kind": "slide", "damping": 3, "kp": 900, "kv": 60,
             "stop": ""}
    (folder / "m.xml").write_text(JOINT.format(**(given | numbers)))
    return folder / "m.xml"


def damped(times: np.ndarray, mass: float, stiff: float, damping: float) -> np.ndarray:
    """Return 1/2 of the way from 1/4 to 3/4 of an oscillator m x'' + c x' + k x = k x1."""
    a, b = np.roots([mass, damping, stiff]).astype(complex)
    return np.real(0.75 - 0.5 * (a * np.exp(b * times) - b * np.exp(a * times)) / (a - b))


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_orders_are_those_of_theory_and_the_reference_knows_its_error(tmp_path, kind) -> None:
    subject = make_subject(joint(tmp_path, kind=kind))
    inertia = 2.0 if kind == "slide" else 2 * (0.2**2 + 0.2**2) / 12
    found = diagram("smooth", motions.smooth(subject))
    for name in INTEGRATORS:
        order = 4 if name == "RK4" else 1
        assert found.orders[name] == pytest.approx(order, abs=0.3), name
    times = SECONDS * np.arange(1, 9) / 8
    right = damped(times, inertia + 0.1, 900, 63)
    away = np.abs(found.reference[:, 0] - right).max()
    assert away <= max(found.own_error, 1e-12), "the reference is as good as it says"
    assert found.own_error < 1e-10
    own = run(motions.smooth(subject), SECONDS, 128)
    said = next(c for c in found.line("implicitfast") if c.set["step"] == SECONDS / 128)
    assert np.abs(own.path[:, 0] - right).max() == pytest.approx(said.error, rel=1e-6)


def test_a_coarse_reference_says_a_larger_error_and_keeps_it(tmp_path: Path) -> None:
    start = motions.smooth(make_subject(joint(tmp_path)))
    right = damped(SECONDS * np.arange(1, 9) / 8, 2.1, 900, 63)
    for finest in (64, 256):
        found = diagram("smooth", start, finest)
        assert np.abs(found.reference[:, 0] - right).max() <= found.own_error
        assert found.own_error > 1e-10


def test_a_stop_is_met_and_its_reference_converges(tmp_path: Path) -> None:
    """Ball and stop: the error falls with the step, and the reference is within what it says."""
    path = joint(tmp_path)
    start = motions.contact(make_subject(path), path)
    assert start.model.nq == 8, "a ball is there"
    one, two = (diagram("contact", start, n) for n in (1024, 4096))
    assert error_of(run(with_options(start, integrator=3), SECONDS, 1024), two.reference) <= (
        one.own_error + two.own_error)
    line = {c.set["step"]: c for c in two.line("implicitfast")}
    assert line[SECONDS / 1024].error < line[SECONDS / 128].error < line[SECONDS / 16].error
    assert max(c.penetration for c in two.cells) > 0


def test_the_ladder_ends_where_explicit_theory_says(tmp_path: Path) -> None:
    """Semi-implicit Euler of x'' = -w^2 x is stable up to w h = 2: h = 63 ms for w = 31.6."""
    path = joint(tmp_path, kp=2100, kv=0, damping=0, integrator="Euler")
    found = diagram("smooth", motions.smooth(make_subject(path)), 256)
    rate = np.sqrt(2100 / 2.1)
    assert diverges_at(found.line("Euler")) == SECONDS / 4 > 2 / rate > SECONDS / 8


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_mass_ratios_and_gains_are_held_to_their_closed_forms(tmp_path, kind) -> None:
    subject = make_subject(joint(tmp_path, kind=kind))
    model, joints = subject.model, subject.joints
    assert frontier(closed.mass_ratios(model, joints), "ratio") == (1e-6, 1e6)
    model.opt.integrator = 0
    model.opt.disableflags |= 1 << 14  # Euler without implicit damping
    broken = closed.mass_ratios(model, joints)
    assert any(c.status == "ok" for c in broken)
    model.opt.disableflags &= ~(1 << 14)
    stiff = closed.gains(model, joints)
    assert stiff[0].status == "ok"
    assert stiff[-1].status == "diverged", "an explicit spring of a billion"


def test_closed_forms_solve_their_equations() -> None:
    times, mass, damping, force = np.linspace(0.1, 1, 400), 2.0, 3.0, 5.0
    x = closed.pushed(mass, damping, force, times)
    v, step = np.gradient(x, times), slice(5, -5)
    left = mass * np.gradient(v, times) + damping * v
    assert np.allclose(left[step], force, rtol=1e-3)
    for tiny in (0.0, 1e-12, 1e-6):
        assert closed.pushed(2.0, tiny, 4.0, np.array([1.0]))[0] == pytest.approx(1.0, rel=1e-6)
    y = closed.settled(10.0, times)
    back = 0.5 * 100 - 100 * y - 20 * np.gradient(y, times)
    assert np.allclose(np.gradient(np.gradient(y, times), times)[step], back[step], atol=0.05)


def test_a_scaled_model_moves_as_the_model(tmp_path: Path) -> None:
    path = joint(tmp_path, stop='<geom type="box" pos="1 0 0" size=".1 .3 .3"/>')
    start = motions.contact(make_subject(path), path)
    cells = {c.set["scale"]: c for c in scaled.scales(start)}
    assert all(cells[s].error < 1e-3 for s in (0.1, 1.0, 10.0, 1000.0)), cells
    wrong = replace(scaled.scaled(start, 10.0), qvel=start.qvel)
    right = run(start, SECONDS, 128).path
    assert judged(run(wrong, SECONDS, 128), right, {}).error > 0.01, "a planted one is seen"


def test_walls_stop_slow_balls_and_let_fast_ones_through(tmp_path: Path) -> None:
    model = make_subject(joint(tmp_path)).model
    for wall in (1e-2, 1e-1):
        safe = bullet.fastest(model, 1.0, wall)
        # A ball whose one step is longer than wall and ball is through whatever the wall does.
        assert 0 < safe < (wall + 4 * bullet.BALL) / 0.002
    assert bullet.fastest(model, 1.0, 1e-1) > bullet.fastest(model, 1.0, 1e-2)
    assert bullet.thrown(model, 1.0, 0.01, 100.0).error == 1.0
    assert bullet.thrown(model, 1.0, 0.01, 0.1).error == 0.0
    assert bullet.thinnest(model) == pytest.approx(0.2)


def test_room_ends_where_geometry_ends(tmp_path: Path) -> None:
    """A plate 3 mm beside the way of the block: 2 mm of wrapping pass, 5 mm rub or jam."""
    stop = '<geom type="box" pos=".5 .2031 0" size="1 .1 .3"/>'
    subject = make_subject(joint(tmp_path, stop=stop))
    cells = {c.set["clearance"]: c for c in extremes.room(subject, 1.0)}
    assert cells[0.002].status == "ok"
    assert cells[0.005].error > cells[0.002].error + 1e-4


def test_a_frontier_is_the_longest_run_that_holds() -> None:
    def cell(value: float, status: str) -> Cell:
        return Cell({"x": value}, status, 0.0, 0.0)

    cells = [cell(v, s) for v, s in zip((1, 2, 3, 4, 5, 5), ("ok", "diverged", "ok", "ok", "ok",
                                                            "inaccurate"), strict=True)]
    assert frontier(cells, "x") == (3, 4)
    assert np.isnan(frontier([cell(1, "diverged")], "x")[0])


def test_advice_keeps_limits_and_is_written(tmp_path: Path) -> None:
    subject = make_subject(joint(tmp_path))
    ways = [diagram(k, s, 512) for k, s in (("smooth", motions.smooth(subject)),
                                            ("contact", motions.contact(subject, tmp_path
                                                                        / "m.xml")))]
    found = advice(*ways, "implicitfast")
    assert found.good
    assert found.smooth <= 0.01
    assert found.contact <= 0.05
    assert advice(*ways, "Euler", 0.005).step <= 0.005
    scene = tmp_path / "scene.xml"
    scene.write_text('<mujoco>\n <option gravity="0 0 -9"  timestep="0.5"/></mujoco>')
    apply(scene, found.to_dict())
    assert f'timestep="{found.step:.10g}"' in scene.read_text()
    assert f'integrator="{found.integrator}"' in scene.read_text()
    assert 'gravity="0 0 -9"' in scene.read_text()
    for text in ("<mujoco/>", None):
        scene.unlink() if text is None else scene.write_text(text)
        with pytest.raises(CheckError, match=r"option|exist"):
            apply(scene, found.to_dict())


def test_a_twin_has_rows_numbers_and_pictures(tmp_path: Path) -> None:
    twin = write_all(toy_cabinet_twin(2), tmp_path / "twin")
    study = stress(twin)
    assert study is not None
    assert {r.status for r in study.rows} == {"pass"}
    assert study.chosen.step <= 0.002 * (1 + 1e-9)
    cells = study.numbers["cells"]
    assert len(cells["solver"]) == 75
    assert {"status", "error", "seconds", "penetration", "warnings", "iterations"} <= set(
        cells["solref"][0])
    for svg in study.numbers["pictures"].values():
        assert svg.startswith("<svg")
        assert "NaN" not in svg
    (tmp_path / "still.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    assert stress(tmp_path / "still.xml") is None


def test_a_start_that_blows_up_is_a_cell_like_any(tmp_path: Path) -> None:
    start = motions.smooth(make_subject(joint(tmp_path, kp=1e12, kv=0, integrator="Euler")))
    cell = judged(run(start, SECONDS, 128), np.zeros((8, 1)), {})
    assert cell.status == "diverged"
    assert isinstance(start, Start)


def test_apply_needs_stress(tmp_path: Path, capsys) -> None:
    assert cli.main(["check", str(tmp_path), "--apply"]) == 2
    assert "--stress" in capsys.readouterr().err
