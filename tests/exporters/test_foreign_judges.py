"""Other people's readers: usd-core's validators, both ends of MuJoCo's range."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest
from random_twins import random_twin
from synth import toy_cabinet_twin

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.glb import write_glb
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.sound import sound_twin
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.exporters.usd import write_usd
from part2gs_robotics.model.kinematics import part_transforms

FLOOR = "3.13.0"  # of mujoco in pyproject.toml


@pytest.mark.parametrize("seed", range(12))
def test_usd_complies(seed: int, tmp_path: Path) -> None:
    from pxr import Usd, UsdValidation

    write_usd(sound_twin(random_twin(seed)), tmp_path)
    judges = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert any("PhysicsJointChecker" in str(judge.GetMetadata().name) for judge in judges)
    stage = Usd.Stage.Open(str(tmp_path / "twin.usd"))
    found = UsdValidation.ValidationContext(judges).Validate(stage)
    assert [error.GetMessage() for error in found] == []


def test_without_usd_core_the_pip_line_is_said(tmp_path: Path,
                                               monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(ExportError, match=r"pip install 'part2gs-robotics\[usd\]'"):
        write_usd(toy_cabinet_twin(1), tmp_path)


def test_animation_ends_where_state_1_was_seen(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(4)
    write_glb(twin, tmp_path)
    data = (tmp_path / "twin.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    tree, chunk = json.loads(data[20:20 + length]), data[28 + length:]
    last: dict[tuple[int, str], np.ndarray] = {}
    (motion,) = tree["animations"]
    for channel in motion["channels"]:
        found = tree["accessors"][motion["samplers"][channel["sampler"]]["output"]]
        start = tree["bufferViews"][found["bufferView"]]["byteOffset"]
        width = {"VEC3": 3, "VEC4": 4}[found["type"]]
        values = np.frombuffer(chunk, "<f4", found["count"] * width, start).reshape(-1, width)
        last[channel["target"]["node"], channel["target"]["path"]] = values[-1].astype(float)
    places = part_transforms(twin, [p.joint.value for p in twin.parts[1:]])
    parents = {child: i for i, node in enumerate(tree["nodes"]) for child in
               node.get("children", [])}

    def world(node: int) -> np.ndarray:
        from scipy.spatial.transform import Rotation

        out = np.eye(4)
        out[:3, 3] = last.get((node, "translation"), tree["nodes"][node]["translation"])
        out[:3, :3] = Rotation.from_quat(last.get((node, "rotation"), [0, 0, 0, 1])).as_matrix()
        return out if parents[node] == 0 else world(parents[node]) @ out

    for index, part in enumerate(twin.parts):
        origin = np.zeros(3) if part.joint is None else part.joint.origin
        place = world(index + 1)
        np.testing.assert_allclose(place[:3, :3], places[index][:3, :3], atol=1e-6)
        np.testing.assert_allclose(place[:3, 3], (places[index] @ [*origin, 1])[:3], atol=1e-6)


@pytest.mark.slow
def test_both_ends_of_the_declared_range_compile(tmp_path: Path) -> None:
    """Twenty twins, MJCF and URDF: the oldest MuJoCo finds the masses and places of the newest."""
    venv.create(tmp_path / "venv", with_pip=True)
    python = tmp_path / "venv/bin/python"
    done = subprocess.run([python, "-m", "pip", "install", "-q", f"mujoco=={FLOOR}"], check=False,
                          capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"mujoco {FLOOR} cannot be installed here")
    for seed in range(20):
        folder = tmp_path / str(seed)
        folder.mkdir()
        twin = sound_twin(random_twin(seed))
        write_mjcf(twin, folder)
        write_urdf(twin, folder)
    code = ("import sys, pathlib, mujoco, json\nout = []\n"
            "for f in sorted(pathlib.Path(sys.argv[1]).glob('[0-9]*/*')):\n"
            "  if f.suffix in ('.xml', '.urdf'):\n"
            "    m = mujoco.MjModel.from_xml_path(str(f)); d = mujoco.MjData(m)\n"
            "    mujoco.mj_forward(m, d)\n"
            "    out.append([f.name] + [x.tolist() for x in (m.body_mass, d.xpos, m.jnt_range)])\n"
            "print(json.dumps(out))\n")
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    old, new = (json.loads(subprocess.run([p, "-c", code, tmp_path], check=True, text=True,
                                          capture_output=True, env=clean).stdout)
                for p in (python, sys.executable))
    assert len(old) == len(new) == 80
    for one, two in zip(old, new, strict=True):
        assert one[0] == two[0]
        for a, b in zip(one[1:], two[1:], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_exports_of_one_twin_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_usd(toy_cabinet_twin(2), tmp_path / name)
        write_glb(toy_cabinet_twin(2), tmp_path / name)
    for file in ("twin.usd", "twin.glb"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
