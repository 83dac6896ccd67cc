"""Simulations side by side: at once, in order, and no less is told than in turn."""

from __future__ import annotations

import threading
from functools import partial
from pathlib import Path

import mujoco
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.assets.engine import distinct, engine_messages
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.runtime import threads
from part2gs_robotics.runtime.threads import in_threads
from part2gs_robotics.sim_checks import check

UNSTABLE = """<mujoco><worldbody><body name="lid">
<joint name="j" type="slide" range="0 1" limited="true" stiffness="-1e15"/>
<geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody></mujoco>"""


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "_cores", lambda: 2)


def test_tasks_run_at_once_and_come_back_in_order(two_cores: None) -> None:
    meet = threading.Barrier(2, timeout=60)  # broken, an error, if tasks ran in turn

    def task(k: int) -> int:
        meet.wait()
        return k

    assert in_threads([partial(task, k) for k in range(4)]) == [0, 1, 2, 3]


def test_one_task_or_one_core_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    here = threading.current_thread()
    assert in_threads([threading.current_thread]) == [here]
    monkeypatch.setattr(threads, "_cores", lambda: 1)
    assert in_threads([threading.current_thread] * 3) == [here] * 3
    assert in_threads([]) == []


def test_what_goes_wrong_is_raised_and_the_rest_never_begins(two_cores: None) -> None:
    begun = list[int]()
    wait = threading.Event()

    def fails() -> None:
        raise FloatingPointError("QACC is nan")

    def slow(k: int) -> None:
        begun.append(k)
        wait.wait(0.2)

    with pytest.raises(FloatingPointError, match="QACC is nan"):
        in_threads([fails, *(partial(slow, k) for k in range(40))])
    assert len(begun) < 40


def test_the_engine_warns_from_any_thread(
        two_cores: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)

    def blow_up() -> int:
        model = mujoco.MjModel.from_xml_string(UNSTABLE)
        data = mujoco.MjData(model)
        data.qvel[0] = 1e20
        mujoco.mj_step(model, data)
        return int(data.warning[int(mujoco.mjtWarning.mjWARN_BADQVEL)].number)

    with engine_messages() as said:
        assert in_threads([blow_up] * 4) == [1] * 4
    assert len(distinct(said)) == 1
    assert not any(tmp_path.iterdir())


def test_a_check_says_the_same_on_one_core_and_on_two(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mjcf(toy_cabinet_twin(), tmp_path)
    found = []
    for cores in (1, 2):
        monkeypatch.setattr(threads, "_cores", lambda cores=cores: cores)
        found.append(check(tmp_path / "twin.xml", steps=5))
    assert found[0].results == found[1].results
    assert found[0].curves == found[1].curves
    assert {"reach", "time step", "hold", "passive"} <= {r.name for r in found[0].results}
