"""The scripts of examples/ do what they say on small twins, run as their users run them."""

from __future__ import annotations

import importlib
import runpy
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest
import yaml
from synth import handled_twin, toy_cabinet_twin
from synth_photos import write_ball_scene

from part2gs_robotics import api

ROOT = Path(__file__).resolve().parents[2]
LONGEST = 112  # lines: who copies an example reads all of it
# Settings that build the two balls in half a minute.
SMALL = {"steps": 60, "half_steps": 30, "parts": 1, "start_gaussians": 1500, "resolution": 40,
         "hull_resolution": 48, "sweep_values": 5}  # fmt: skip


@pytest.fixture(scope="module")
def example() -> Callable[[str], ModuleType]:
    """Return a function that imports a script of examples/."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "examples"))
        yield importlib.import_module


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("twin") / "out"
    assert api.write_twin(handled_twin(), folder) == (), "nothing to repair"
    return folder


def test_examples_are_short_and_the_page_names_them() -> None:
    page = (ROOT / "examples/README.md").read_text()
    for path in (ROOT / "examples").glob("*.py"):
        assert len(path.read_text().splitlines()) <= LONGEST, path.name
        assert f"`{path.name}`" in page
        assert f"python examples/{path.name}" in path.read_text(), "says how to call it"


def test_bad_input_is_told_and_not_raised(example, tmp_path: Path, capsys) -> None:
    assert example("build_twin").main(tmp_path / "none", tmp_path / "out") == 2
    assert capsys.readouterr().out.startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_scene_is_built(example, tmp_path: Path, capsys) -> None:
    scene = write_ball_scene(tmp_path / "balls")
    (scene / "scene.yaml").write_text(yaml.safe_dump(SMALL))
    code = example("build_twin").main(scene, tmp_path / "out")
    said = capsys.readouterr().out
    assert code in (0, 1)
    assert "part_1 on base: " in said
    assert f"checks {'FAIL' if code else 'pass'}" in said
    assert len(api.read_twin(tmp_path / "out").parts) == 2


def test_a_twin_is_edited(example, twin: Path, tmp_path: Path, capsys) -> None:
    before = {path: path.read_bytes() for path in twin.rglob("*") if path.is_file()}
    assert example("edit_twin").main(twin, tmp_path / "new") == 0
    assert "part_1 is front, from 0.000 to 0.300; checks pass" in capsys.readouterr().out
    old = mujoco.MjModel.from_xml_path(str(twin / "twin.xml"))
    new = mujoco.MjModel.from_xml_path(str(tmp_path / "new" / "twin.xml"))
    heavier = 1050 / 600  # the example's density, and what is assumed without one
    assert new.body("front").mass == pytest.approx(heavier * old.body("part_1").mass, rel=1e-5)
    np.testing.assert_allclose(new.joint("front_joint").range, (0, 0.3), atol=1e-9)
    assert (tmp_path / "new/glb").is_dir()
    said = yaml.safe_load((tmp_path / "new/twin.yaml").read_text())
    assert said["joints"][0]["range"] | {"value": 0} == {"value": 0, "source": "assumed",
                                                         "note": "set by hand"}
    assert {path: path.read_bytes() for path in before} == before, "the twin it came from stays"


@pytest.mark.parametrize("metres", [1.0, 0.001])
def test_a_gripper_opens_the_door(example, tmp_path: Path, twin: Path, metres: float) -> None:
    if metres != 1.0:  # the same door in millimetres
        from synth import scaled

        twin = tmp_path / "out"
        api.write_twin(scaled(handled_twin(), 1 / metres), twin)
    assert example("open_door").main(twin, "part_2", 30.0) == pytest.approx(30.0, abs=2.0)


def test_a_gripper_pulls_a_drawer(example, twin: Path) -> None:
    assert example("open_door").main(twin, "part_1", 0.15) == pytest.approx(0.15, abs=0.01)


def test_a_gripper_that_does_not_close_opens_nothing(example, twin: Path, monkeypatch) -> None:
    script = example("open_door")
    monkeypatch.setattr(script, "GRIP", -5.0)
    assert script.main(twin, "part_2", 30.0) < 1.0


def test_a_door_without_a_handle_is_refused(example, tmp_path: Path) -> None:
    api.write_twin(toy_cabinet_twin(2), tmp_path / "plain")
    with pytest.raises(SystemExit, match="nothing stands out"):
        example("open_door").main(tmp_path / "plain", "part_2", 30.0)
    with pytest.raises(SystemExit, match=r"base: .* there are part_1, part_2$"):
        example("open_door").main(tmp_path / "plain", "base", 30.0)


def test_the_environment_passes_the_checker_of_gymnasium(example, twin: Path) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    script = example("gym_env")
    env = gymnasium.make("Twin-v0", folder=twin, part="part_2", render_mode="rgb_array")
    check_env(env.unwrapped)
    env.reset(seed=1)
    picture = env.render()
    assert np.ptp(picture) > 50, "something is seen"
    env.close()
    assert script.main(twin, "part_2") > -script.THERE, "servos bring it there"


def test_the_environment_moves_what_it_is_told_to(example, twin: Path) -> None:
    pytest.importorskip("gymnasium")
    env = example("gym_env").TwinEnv(twin, "part_2")
    first, _ = env.reset(seed=3)
    again, _ = env.reset(seed=3)
    np.testing.assert_array_equal(first, again)
    for _ in range(60):
        seen, *_ = env.step(np.array([-1.0, 1.0]))
    np.testing.assert_allclose(seen[:2], (0, 1), atol=0.02)


def test_scripts_run_from_the_command_line(twin: Path, tmp_path: Path, monkeypatch, capsys) -> None:
    def run(script: str, *words: str) -> None:
        monkeypatch.setattr(sys, "argv", [script, *words])
        runpy.run_path(str(ROOT / "examples" / f"{script}.py"), run_name="__main__")

    with pytest.raises(SystemExit) as done:
        run("edit_twin", str(twin), str(tmp_path / "new"))
    assert done.value.code == 0
    run("open_door", str(twin), "part_2", "25")
    assert "part_2: asked 25, reached 24" in capsys.readouterr().out


def test_copies_need_nothing_of_the_repository(twin: Path, tmp_path: Path, monkeypatch) -> None:
    copied = Path(shutil.copy(ROOT / "examples/open_door.py", tmp_path / "my_door.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    assert importlib.import_module(copied.stem).main(twin, "part_2", 25.0) > 20
