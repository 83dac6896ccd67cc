"""The engine's warnings are reported and leave no file where the user stands."""

from __future__ import annotations

import logging
import warnings
from pathlib import Path

import mujoco
import pytest

from part2gs_robotics.assets.engine import distinct, engine_messages
from part2gs_robotics.capture.capture import Shots, capture
from part2gs_robotics.sim_checks import check

# A slide without damping behind a spring of huge negative stiffness: QACC is huge at once.
UNSTABLE = """<mujoco><worldbody><body name="lid">
<joint name="j" type="slide" range="0 1" limited="true" stiffness="-1e15"/>
<geom type="box" size=".1 .1 .1" mass="1"/></body></worldbody>{rest}</mujoco>"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "cwd").mkdir()
    monkeypatch.chdir(tmp_path / "cwd")
    return tmp_path


def model(folder: Path, text: str) -> Path:
    (folder / "m.xml").write_text(text)
    return folder / "m.xml"


def provoke() -> mujoco.MjData:
    compiled = mujoco.MjModel.from_xml_string(UNSTABLE.format(rest=""))
    data = mujoco.MjData(compiled)
    data.qvel[0] = 1e20
    mujoco.mj_step(compiled, data)
    return data


def test_warnings_are_collected_and_counted_without_a_file(here: Path) -> None:
    with engine_messages() as said:
        data = provoke()
    assert distinct(said)[0].startswith("Nan, Inf or huge value in QVEL at DOF 0")
    assert data.warning[int(mujoco.mjtWarning.mjWARN_BADQVEL)].number == 1
    assert not any(Path.cwd().iterdir())
    provoke()  # the default this guards against
    assert (Path.cwd() / "MUJOCO_LOG.TXT").exists()


def test_an_earlier_listener_is_put_back() -> None:
    outer: list[str] = []
    mujoco.set_mju_user_warning(outer.append)
    try:
        with engine_messages() as said:
            provoke()
        assert (len(outer), len(said)) == (0, 1)
        provoke()
        assert len(outer) == 1
    finally:
        mujoco.set_mju_user_warning(None)


def test_repeated_warnings_are_one() -> None:
    said = ["Bad. Time = 0.1.\nmore", "Bad. Time = 0.2.", "", "Worse"]
    assert distinct(said) == ("Bad.", "Worse")


def test_check_reports_warnings_and_leaves_no_file(here: Path) -> None:
    report = check(model(here, UNSTABLE.format(rest="")), only=("stability",))
    assert not report.ok
    assert any("the engine warned: Nan, Inf or huge value" in note for note in report.notes)
    assert any("BADQ" in r.detail for r in report.results)
    assert not any(Path.cwd().iterdir())


def test_capture_says_warnings_and_leaves_no_file(
    here: Path, caplog: pytest.LogCaptureFixture
) -> None:
    odd = '<custom><numeric name="n" data="nan"/></custom>'
    path = model(here, UNSTABLE.format(rest=odd))
    with caplog.at_level(logging.WARNING):
        capture(path, here / "scene", Shots(4, size=32))
    assert [r.getMessage() for r in caplog.records if "nan" in r.getMessage().lower()]
    assert not any(Path.cwd().iterdir())


def test_warnings_of_the_compiler_are_messages_too() -> None:
    with engine_messages() as said:
        warnings.warn("Inertia matrix is too close to singular", UserWarning, stacklevel=1)
    assert said == ["Inertia matrix is too close to singular"]
    with pytest.raises(UserWarning):
        warnings.warn("outside, it is one of Python's again", UserWarning, stacklevel=1)
