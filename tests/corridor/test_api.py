"""The program as functions: what they give is what the commands write."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics import api, cli
from part2gs_robotics.errors import CheckError, ConfigError, SceneError, StoreError

HEAVY = "torch", "numba", "mujoco", "scipy", "cv2", "trimesh"


def test_importing_it_loads_nothing() -> None:
    code = ("import sys, part2gs_robotics.api; "
            f"print([name for name in {HEAVY!r} if name in sys.modules])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_written_twin_reads_back(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(4)
    assert api.write_twin(twin, tmp_path / "out") == ()
    back = api.read_twin(tmp_path / "out")
    assert [part.name for part in back.parts] == [part.name for part in twin.parts]
    for one, two in zip(back.parts[1:], twin.parts[1:], strict=True):
        np.testing.assert_allclose(one.joint.axis, two.joint.axis, atol=1e-9)
        assert one.limits == pytest.approx(two.limits)
    api.write_twin(back, tmp_path / "again")  # masses of meshes that were rounded to 10 digits
    api.write_twin(api.read_twin(tmp_path / "again"), tmp_path / "third")
    for file in ("twin.xml", "twin.urdf", "scene.xml", "twin_actuated.xml"):
        assert (tmp_path / "third" / file).read_bytes() == (tmp_path / "again" / file).read_bytes()


def test_what_cannot_be_written_is_repaired_and_told(tmp_path: Path) -> None:
    (told,) = api.write_twin(replace(toy_cabinet_twin(1), name="Küche 1"), tmp_path / "out")
    assert "Küche 1" in told
    assert api.read_twin(tmp_path / "out").name == "kuche_1"


def test_checks_and_exports_are_those_of_the_commands(tmp_path: Path, capsys) -> None:
    api.write_twin(toy_cabinet_twin(1), tmp_path)
    report = api.check(tmp_path, steps=5)
    assert report.ok
    assert cli.main(["check", str(tmp_path), "--sweep-values", "5"]) == report.exit_code
    files = api.export(tmp_path, "urdf")
    capsys.readouterr()
    assert cli.main(["export", str(tmp_path), "--format", "urdf", "-o", str(tmp_path / "b")]) == 0
    for file in files:
        other = tmp_path / "b" / file.relative_to(tmp_path / "urdf")
        assert file.read_bytes() == other.read_bytes()


def test_errors_are_those_of_the_program(tmp_path: Path) -> None:
    with pytest.raises(SceneError):
        api.build(tmp_path, tmp_path.parent / "out")
    with pytest.raises(ConfigError, match="Nearest valid"):
        api.build(tmp_path, part=2)
    with pytest.raises(ConfigError, match="--parts is 0"):
        api.build(tmp_path, parts=0)
    with pytest.raises(CheckError):
        api.read_twin(tmp_path)
    with pytest.raises(CheckError):
        api.check(tmp_path)
    api.write_twin(toy_cabinet_twin(1), tmp_path / "twin")
    with pytest.raises(ConfigError, match="mjcf"):
        api.export(tmp_path / "twin", "stl")
    (tmp_path / "file").touch()
    with pytest.raises(StoreError):
        api.write_twin(toy_cabinet_twin(1), tmp_path / "file")
