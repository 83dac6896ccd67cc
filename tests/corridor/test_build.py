"""Corridor: what a stage saves is what it loads, a killed build goes on where it stopped."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synth import toy_cabinet_twin
from synth_photos import write_ball_scene

from part2gs_robotics.config import Config, ReadConfig, resolve
from part2gs_robotics.errors import StoreError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.twin import Texture
from part2gs_robotics.outputs import output_folder
from part2gs_robotics.plan import make_plan, settle_plan
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.runtime.store import Saved, read_stage, write_stage
from part2gs_robotics.stages import (
    load_built,
    load_fit,
    load_motion,
    load_textures,
    save_built,
    save_fit,
    save_motion,
    save_textures,
)


def through_disk(saved: Saved, folder: Path) -> Saved:
    write_stage(folder / "stage", "key", saved)
    read = read_stage(folder / "stage", "key")
    assert read is not None
    return read


def equal(a: object, b: object) -> bool:
    """Compare dataclasses, containers and arrays by value, type of arrays included."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, tuple | list):
        return isinstance(b, type(a)) and len(a) == len(b) and all(map(equal, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(equal(getattr(a, f.name), getattr(b, f.name))
                                          for f in fields(a))  # type: ignore[arg-type]
    return a == b or (a != a and b != b)


def joint(kind: Any = "revolute") -> Joint:
    return Joint(kind, np.array([0.0, 0, 1]), np.array([0.1, 0.2, 0.3]), 1.25, 0.0, 0.01,
                 float("nan"), 0.02, {"fixed": 12.0, "revolute": -3.0}, 0.9)


def motion(count: int, notes: tuple[str, ...] = ()) -> Motion:
    rng = np.random.default_rng(0)
    probs = [rng.random((n, count + 1)).astype(np.float32) for n in (5, 7)]
    return Motion((probs[0], probs[1]), tuple(joint() for _ in range(count)), (0,) * count,
                  tuple({"contact_loss": 0.5, "repel_points": 3.0} for _ in range(count)), notes,
                  {"search": 2.5})


def some_gaussians(higher: int) -> Gaussians:
    rng = np.random.default_rng(0)
    shapes = {"means": (9, 3), "quats": (9, 4), "log_scales": (9, 3), "logit_opacities": (9,),
              "sh0": (9, 3), "shN": (9, higher, 3)}
    return Gaussians(**{k: rng.normal(size=v).astype(np.float32) for k, v in shapes.items()})


@pytest.mark.parametrize("gains", [None, np.full((4, 3), 1.25)])
def test_fit_survives_the_store(tmp_path: Path, gains: F64 | None) -> None:
    fitted = (some_gaussians(3), ((0.5, 20.25), (3.0, 31.5)), gains)
    assert equal(load_fit(through_disk(save_fit(fitted), tmp_path)), fitted)


def test_motion_survives_the_store(tmp_path: Path) -> None:
    moved = replace(motion(2, ("a note",)), shades=(0.5, *[0.25] * 7))
    assert equal(load_motion(through_disk(save_motion(moved), tmp_path)), moved)


def test_parts_survive_the_store(tmp_path: Path) -> None:
    built = motion(2, ("a note",)), toy_cabinet_twin().parts
    assert equal(load_built(through_disk(save_built(built), tmp_path)), built)


def test_textures_survive_the_store(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    textures = tuple(Texture(rng.random((n, 3, 2)).astype(np.float32),
                             rng.integers(0, 256, (n, 7, 3)).astype(np.uint8)) for n in (4, 9))
    assert equal(load_textures(through_disk(save_textures(textures), tmp_path)), textures)


def test_output_is_beside_the_scene_and_never_in_it(tmp_path: Path) -> None:
    scene = tmp_path / "door"
    scene.mkdir()
    assert output_folder(scene, None) == tmp_path / "door_twin"
    assert output_folder(scene, "elsewhere") == Path("elsewhere")
    for inside in (scene, scene / "out", scene / "start" / ".." / "out"):
        with pytest.raises(StoreError, match="never written"):
            output_folder(scene, str(inside))


@pytest.fixture(scope="module")
def ball_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ball_scene(tmp_path_factory.mktemp("b") / "scene", side=64)


def test_open_decisions_are_settled(ball_scene: Path) -> None:
    plan = make_plan(read_scene(ball_scene, ReadConfig()), Config())
    parts, matt = toy_cabinet_twin().parts, some_gaussians(0)
    one, two = (settle_plan(plan, (matt, matt), motion(count), parts) for count in (1, 2))
    assert not one["view-dependent colour"].used
    gloss = settle_plan(plan, (matt, some_gaussians(3)), motion(1), parts)
    assert gloss["view-dependent colour"].used
    assert gloss["view-dependent colour"].reason.endswith("in state 1")
    assert not one["part competition"].used
    assert two["part competition"].used
    assert two["repel points"] == plan["repel points"], "off by default, so nothing is open"
    repelling = make_plan(read_scene(ball_scene, ReadConfig()), resolve({"repel": True}))
    pushed = settle_plan(repelling, (matt, matt), motion(2), parts)["repel points"]
    assert pushed.reason.startswith("6 points between parts; images keep the pull on 0 of 2 joints")
    bare = Motion((np.zeros((0, 2), np.float32),) * 2, (joint(),), (0,))
    settled = settle_plan(repelling, (matt, matt), bare, parts)["repel points"]
    assert settled.reason.startswith("no seam within reach")
    assert not settled.used
    pieces = two["convex decomposition"]
    assert pieces.used == any(len(part.pieces) > 1 for part in parts)


def words(scene: Path, out: Path) -> list[str]:
    return ["build", str(scene), "-o", str(out), "--preset", "draft", "--steps", "120",
            "--half-steps", "60", "--parts", "1", "--start-gaussians", "3000", "--resolution",
            "48", "--hull-resolution", "64"]


def start(scene: Path, out: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "part2gs_robotics", *words(scene, out)],
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen[str]) -> int:
    _, errors = process.communicate(timeout=300)
    assert process.returncode in (0, 1), errors
    assert "Traceback" not in errors
    return process.returncode


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 300
    while not path.exists() and process.poll() is None:
        assert time.monotonic() < deadline, f"{path} was never written"
        time.sleep(0.05)


@pytest.mark.slow
def test_killed_build_continues_and_equals_an_uninterrupted_one(ball_scene: Path,
                                                                tmp_path: Path) -> None:
    code = finish(start(ball_scene, tmp_path / "whole"))
    out = tmp_path / "killed"
    for stage, number in (("01_fit_0", signal.SIGKILL), ("03_articulate", signal.SIGTERM)):
        process = start(ball_scene, out)
        wait_for(out / "stages" / stage / "manifest.json", process)
        process.send_signal(number)
        process.communicate(timeout=60)
        assert process.returncode == (130 if number == signal.SIGTERM else -signal.SIGKILL)
        assert not (out / "twin.xml").exists(), "no twin before it is whole"
    assert finish(start(ball_scene, out)) == code
    for name in ("twin.xml", "twin.urdf", "assets/base_visual.obj", "gaussians.ply"):
        assert (out / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    events = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    resumed = [e["stage"] for e in events if e.get("resumed")]
    assert resumed.count("fit_0") == 2
    assert resumed.count("articulate") == 1
    (out / "report.html").unlink()
    assert finish(start(ball_scene, out)) == code, "the same command writes the page again"
    page = (out / "report.html").read_text()
    assert page.count('class="wipe"') == page.count('class="marked"') > 1


@pytest.mark.slow
def test_failing_build_keeps_the_earlier_twin(ball_scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    finish(start(ball_scene, out))
    before = {path: path.read_bytes() for path in (*out.iterdir(), *out.glob("assets/*"))
              if path.is_file() and path.name not in ("log.jsonl", "build.lock")}
    (out / "stages" / "04_mesh" / "manifest.json").unlink()
    code = ("import errno, os, sys\nfrom part2gs_robotics import cli\n"
            "from part2gs_robotics.exporters import urdf\n"
            "def full(*a): raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))\n"
            "urdf.write_urdf = full\nsys.exit(cli.main(sys.argv[1:]))\n")
    done = subprocess.run([sys.executable, "-c", code, *words(ball_scene, out)],
                          capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2, done.stderr
    assert "No space left" in done.stderr
    after = {path: path.read_bytes() for path in before}
    assert after == before
    assert not [path for path in out.rglob("*") if ".new-" in path.name or ".tmp-" in path.name]
