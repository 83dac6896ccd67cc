"""Settings that must hold before any test imports mujoco, and scenes that tests share."""

from __future__ import annotations

import importlib
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import toys
from ros_stubs import modules
from toys import Box, cameras, drawn, gaussians_of, scene_of, seen_surface

# mujoco picks its OpenGL backend at import; capture draws off screen.
os.environ.setdefault("MUJOCO_GL", "egl")


def _one_thread(library):
    """Small arrays: handing them between threads of a busy machine costs more than the sums."""
    threads = library.get_num_threads()
    library.set_num_threads(1)
    yield
    library.set_num_threads(threads)


@pytest.fixture
def one_torch_thread():
    """Let torch use one thread."""
    import torch

    yield from _one_thread(torch)


@pytest.fixture
def one_numba_thread():
    """Let numba use one thread."""
    import numba

    yield from _one_thread(numba)


@pytest.fixture(scope="session")
def load():
    """Return a function that imports scripts of benchmarks/ as they import one another."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "benchmarks"))
        yield importlib.import_module


@pytest.fixture
def stubs(monkeypatch):
    """Let launch files import stand-ins for ROS."""
    for name, module in modules().items():
        monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture(scope="session")
def ball_scene(tmp_path_factory):
    """A good scene of two balls, 24 photos of 48 pixels per state: copy it before a change."""
    from synth_photos import write_ball_scene

    return write_ball_scene(tmp_path_factory.mktemp("balls") / "scene")


@pytest.fixture
def scene(ball_scene, tmp_path):
    """Return a copy of the good scene, to be changed."""
    return Path(shutil.copytree(ball_scene, tmp_path / "scene"))


@pytest.fixture
def build(capsys):
    """Return a function that runs `build` with words and returns exit code and stderr."""
    from part2gs_robotics import cli

    def run(scene, *words):
        # few steps: a case that is not refused should fail the test, not stall it
        code = cli.main(["build", str(scene), "--steps", "1", *words])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err + captured.out
        return code, captured.err

    return run


@pytest.fixture
def assert_refused(build, tmp_path):
    """Return a function that checks a refusal: exit code, four-part message, nothing left."""

    def check(scene, fragments, *words):
        before = sorted(tmp_path.rglob("*"))
        code, message = build(scene, *words)
        assert code == 2, message
        assert message.startswith("error: ")
        for fragment in fragments:
            assert fragment in message
        assert message.count(". ") >= 1, "says what was expected after what was wrong"
        assert sorted(tmp_path.rglob("*")) == before, "nothing is left behind"

    return check


@pytest.fixture(scope="session")
def toy():
    """Textured boxes: shapes, cameras, exact images, Gaussians and landing grids."""
    return toys


SLIDE = (np.array([1.0, 0, 0]), 0.3)
HINGE = (np.array([0.0, 0, 1]), np.array([0.0, -0.05, 0.0]), -0.9)


@pytest.fixture(scope="session")
def slid(toy):
    """A block on a base, slid by 0.3 along x: both states as seen."""
    from part2gs_robotics.model.se3 import make

    base, block = Box((0, 0, 0), (0.8, 0.6, 0.25), 1), Box((0.05, 0.1, 0.25), (0.4, 0.5, 0.5), 2)
    moved = Box(block.lo, block.hi, 2, make(np.eye(3), SLIDE[0] * SLIDE[1]))
    return SimpleNamespace(axis=SLIDE[0], value=SLIDE[1], block=block,
                           states=(seen_surface([base, block]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def turned(toy):
    """A thin door at the front of a base, turned by -0.9 rad about a vertical line."""
    from part2gs_robotics.model.se3 import screw_motion

    base, door = Box((0, 0, 0), (0.8, 0.6, 0.6), 1), Box((0, -0.05, 0), (0.8, -0.01, 0.6), 3)
    moved = Box(door.lo, door.hi, 3, screw_motion(*HINGE, 0.0))
    return SimpleNamespace(axis=HINGE[0], origin=HINGE[1], value=HINGE[2], block=door,
                           states=(seen_surface([base, door]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def screwed(toy):
    """A block on a base, turned by 0.9 rad about a vertical line and risen by 0.12."""
    from part2gs_robotics.model.se3 import screw_motion

    base, block = Box((0, 0, 0), (0.8, 0.6, 0.25), 1), Box((0.15, 0.1, 0.25), (0.6, 0.4, 0.5), 2)
    axis, origin, value, rise = np.array([0.0, 0, 1]), np.array([0.4, 0.3, 0.3]), 0.9, 0.12
    moved = Box(block.lo, block.hi, 2, screw_motion(axis, origin, value, rise))
    return SimpleNamespace(axis=axis, origin=origin, value=value, pitch=rise / value, block=block,
                           states=(seen_surface([base, block]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def look_alikes(toy):
    """Two equal blocks on a base, slid along x by 0.3 and 0.2: a study, the truth, the photos."""
    from part2gs_robotics.model.joint import Joint
    from part2gs_robotics.model.se3 import make

    base = Box((0, 0, 0), (0.9, 0.8, 0.25), 1)
    truth = [Joint("prismatic", np.array([1.0, 0, 0]), np.array([0.2, 0.4, 0.4]), way)
             for way in (0.3, 0.2)]
    places = [((0.05, 0.06, 0.25), (0.4, 0.36, 0.5)), ((0.05, 0.44, 0.25), (0.4, 0.74, 0.5))]
    before = [base, *(Box(*place, 2) for place in places)]
    after = [base, *(Box(*place, 2, make(np.eye(3), h.axis * h.value))
                     for place, h in zip(places, truth, strict=True))]
    pairs = [gaussians_of(boxes, 0.04) for boxes in (before, after)]
    eyes = cameras(16, 56, np.array([0.45, 0.4, 0.25]), 1.1)
    scene = scene_of(tuple(drawn(gaussians, *eyes, 56) for gaussians, _ in pairs))
    study = toys.study_of(scene, (pairs[0][0], pairs[1][0]))
    return SimpleNamespace(study=study, truth=truth, scene=scene,
                           owners=tuple(owner for _, owner in pairs))


@pytest.fixture(scope="session")
def judge(look_alikes):
    """Return the judge of the look-alikes' study."""
    from part2gs_robotics.decide.judge import Judge

    return Judge(look_alikes.study)


@pytest.fixture(scope="session")
def right(judge, look_alikes):
    """The candidate of both true motions, judged."""
    from part2gs_robotics.decide.candidate import on_base

    return judge.judge(on_base(look_alikes.truth))
