"""Settings that must hold before any test imports mujoco, and a toy world of textured boxes."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

# mujoco picks its OpenGL backend at import; capture draws off screen.
os.environ.setdefault("MUJOCO_GL", "egl")


@dataclass(frozen=True)
class Box:
    """A textured box lo..hi, placed by `move` (world_from_box); seed picks its colours."""

    lo: tuple[float, float, float]
    hi: tuple[float, float, float]
    seed: int = 0
    move: np.ndarray = field(default_factory=lambda: np.eye(4))


def paint(points, seed):
    """Return [n, 3] colours in 0.1..0.9: smooth waves of a fifth of a unit and longer."""
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(3, 4, 3)) * 9.0
    phases = rng.uniform(0, 2 * np.pi, (3, 4))
    mixed = np.sin(np.einsum("cwi,ni->ncw", waves, points) + phases).mean(-1)
    return np.clip(rng.uniform(0.35, 0.65, 3) + 0.6 * mixed, 0.1, 0.9)


def cameras(count, side, centre, diag):
    """Return Ks and viewmats of cameras spread over a sphere that see all of the object."""
    k = np.arange(count) + 0.5
    up, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    level = np.sqrt(1 - up**2)
    views = []
    for way in np.stack([level * np.cos(turn), level * np.sin(turn), up], 1):
        z = -way
        x = np.cross(z, [0.0, 0, 1])
        x /= np.linalg.norm(x)
        rot = np.stack([x, np.cross(z, x), z])
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = rot, -rot @ (centre + 2.2 * diag * way)
        views.append(view)
    focal = 1.9 * side
    K = np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1.0]])
    return np.repeat(K[None], count, 0), np.stack(views)


def cast(boxes, Ks, viewmats, side):
    """Return StateViews of boxes, ray-cast exactly, with depth."""
    from part2gs_robotics.scene import StateViews

    rows, cols = np.mgrid[:side, :side] + 0.5
    count = len(Ks)
    depth = np.full((count, side * side), np.inf)
    color = np.zeros((count, side * side, 3))
    for v in range(count):
        local = np.stack([(cols - Ks[v][0, 2]) / Ks[v][0, 0], (rows - Ks[v][1, 2]) / Ks[v][1, 1],
                          np.ones_like(rows)], -1).reshape(-1, 3)
        for box in boxes:
            box_from_camera = np.linalg.inv(viewmats[v] @ box.move)
            ways, eye = local @ box_from_camera[:3, :3].T, box_from_camera[:3, 3]
            near, far = (np.array([box.lo, box.hi])[:, None] - eye) / (ways + 1e-300)
            enter, leave = np.minimum(near, far).max(1), np.maximum(near, far).min(1)
            hit = (enter < leave) & (enter > 0) & (enter < depth[v])
            depth[v, hit] = enter[hit]
            color[v, hit] = paint(eye + ways[hit] * enter[hit, None], box.seed)
    shape = (count, side, side)
    solid = np.isfinite(depth).reshape(shape)
    return StateViews(
        np.round(color * 255).astype(np.uint8).reshape(*shape, 3), solid.astype(np.uint8) * 255,
        Ks, viewmats, np.where(solid, depth.reshape(shape), 0).astype(np.float32),
        tuple(f"{v:03d}" for v in range(count)), np.zeros(count, bool))


def gaussians_of(boxes, spacing):
    """Return flat Gaussians on the faces of the boxes, and [N] the box of each."""
    from part2gs_robotics import se3
    from part2gs_robotics.gaussians import SH_C0, Gaussians

    means, quats, logs, colors, owner = [], [], [], [], []
    for b, box in enumerate(boxes):
        lo, hi = np.array(box.lo), np.array(box.hi)
        for axis in range(3):
            steps = []
            for i in range(3):
                n = max(1, round((hi[i] - lo[i]) / spacing))
                steps.append(lo[i] + (np.arange(n) + 0.5) * (hi[i] - lo[i]) / n)
            steps[axis] = np.array([lo[axis], hi[axis]])
            points = np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3)
            flat = np.full(3, np.log(0.6 * spacing))
            flat[axis] = np.log(0.02 * spacing)
            means.append(se3.apply(box.move, points))
            quats.append(np.tile(se3.quat_from_rotation(box.move[:3, :3]), (len(points), 1)))
            logs.append(np.tile(flat, (len(points), 1)))
            colors.append(paint(points, box.seed))
            owner.append(np.full(len(points), b))
    total = sum(map(len, means))
    return Gaussians(
        np.concatenate(means).astype(np.float32), np.concatenate(quats).astype(np.float32),
        np.concatenate(logs).astype(np.float32), np.full(total, 3.0, np.float32),
        ((np.concatenate(colors) - 0.5) / SH_C0).astype(np.float32),
        np.zeros((total, 0, 3), np.float32)), np.concatenate(owner)


def drawn(gaussians, Ks, viewmats, side):
    """Return StateViews of Gaussians, drawn by the product's own renderer."""
    from part2gs_robotics.render import render
    from part2gs_robotics.scene import StateViews

    g, images, alphas = gaussians, [], []
    for K, view in zip(Ks, viewmats, strict=True):
        out = render(g.means, g.quats, g.scales, g.opacities, g.colors, view, K, side, side)
        straight = out.color / np.maximum(out.alpha, 1e-3)[..., None]
        images.append(np.round(np.clip(straight, 0, 1) * 255).astype(np.uint8))
        alphas.append(np.round(out.alpha * 255).astype(np.uint8))
    return StateViews(np.stack(images), np.stack(alphas), Ks, viewmats, None,
                      tuple(str(v) for v in range(len(Ks))), np.zeros(len(Ks), bool))


def scene_of(states):
    """Return the Scene of two StateViews."""
    from part2gs_robotics.scene import Scene

    return Scene(Path("toy"), "toy", states)


def seen_surface(boxes, views=24, side=96, voxel=0.02):
    """Return surfels, landing grid (reach 0.1) and depth maps of ray-cast boxes within -1..1.6."""
    from part2gs_robotics.evidence import depth_maps_of_images
    from part2gs_robotics.landing import build_landing
    from part2gs_robotics.surfels import fuse_surfels

    state = cast(boxes, *cameras(views, side, np.array([0.4, 0.3, 0.3]), 1.7), side)
    maps = depth_maps_of_images(state)
    surfels = fuse_surfels(maps, state.images, voxel, stride=1)
    lo, hi = np.full(3, -0.8), np.full(3, 1.5)
    land = build_landing(surfels, np.zeros(len(surfels)), maps, lo, hi, voxel, 0.1)
    return SimpleNamespace(surfels=surfels, land=land, maps=maps, state=state)


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
def ball_scene(tmp_path_factory):
    """A good scene of two balls, 24 photos of 48 pixels per state: copy it before a change."""
    from part2gs_robotics.synth_photos import write_ball_scene

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
    return SimpleNamespace(Box=Box, cameras=cameras, cast=cast, gaussians_of=gaussians_of,
                           drawn=drawn, scene_of=scene_of, seen_surface=seen_surface)


SLIDE = (np.array([1.0, 0, 0]), 0.3)
HINGE = (np.array([0.0, 0, 1]), np.array([0.0, -0.05, 0.0]), -0.9)


@pytest.fixture(scope="session")
def slid(toy):
    """A block on a base, slid by 0.3 along x: both states as seen."""
    from part2gs_robotics.se3 import make

    base, block = Box((0, 0, 0), (0.8, 0.6, 0.25), 1), Box((0.05, 0.1, 0.25), (0.4, 0.5, 0.5), 2)
    moved = Box(block.lo, block.hi, 2, make(np.eye(3), SLIDE[0] * SLIDE[1]))
    return SimpleNamespace(axis=SLIDE[0], value=SLIDE[1], block=block,
                           states=(seen_surface([base, block]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def turned(toy):
    """A thin door at the front of a base, turned by -0.9 rad about a vertical line."""
    from part2gs_robotics.se3 import screw_motion

    base, door = Box((0, 0, 0), (0.8, 0.6, 0.6), 1), Box((0, -0.05, 0), (0.8, -0.01, 0.6), 3)
    moved = Box(door.lo, door.hi, 3, screw_motion(*HINGE, 0.0))
    return SimpleNamespace(axis=HINGE[0], origin=HINGE[1], value=HINGE[2], block=door,
                           states=(seen_surface([base, door]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def screwed(toy):
    """A block on a base, turned by 0.9 rad about a vertical line and risen by 0.12."""
    from part2gs_robotics.se3 import screw_motion

    base, block = Box((0, 0, 0), (0.8, 0.6, 0.25), 1), Box((0.15, 0.1, 0.25), (0.6, 0.4, 0.5), 2)
    axis, origin, value, rise = np.array([0.0, 0, 1]), np.array([0.4, 0.3, 0.3]), 0.9, 0.12
    moved = Box(block.lo, block.hi, 2, screw_motion(axis, origin, value, rise))
    return SimpleNamespace(axis=axis, origin=origin, value=value, pitch=rise / value, block=block,
                           states=(seen_surface([base, block]), seen_surface([base, moved])))


@pytest.fixture(scope="session")
def look_alikes(toy):
    """Two equal blocks on a base, slid along x by 0.3 and 0.2: a study, the truth, the photos."""
    from part2gs_robotics.motion_search import Hypothesis
    from part2gs_robotics.se3 import make
    from part2gs_robotics.study import gather

    base = Box((0, 0, 0), (0.9, 0.8, 0.25), 1)
    truth = [Hypothesis(0, np.array([1.0, 0, 0]), np.array([0.2, 0.4, 0.4]), way)
             for way in (0.3, 0.2)]
    places = [((0.05, 0.06, 0.25), (0.4, 0.36, 0.5)), ((0.05, 0.44, 0.25), (0.4, 0.74, 0.5))]
    before = [base, *(Box(*place, 2) for place in places)]
    after = [base, *(Box(*place, 2, make(np.eye(3), h.axis * h.value))
                     for place, h in zip(places, truth, strict=True))]
    pairs = [gaussians_of(boxes, 0.04) for boxes in (before, after)]
    eyes = cameras(16, 56, np.array([0.45, 0.4, 0.25]), 1.1)
    scene = scene_of(tuple(drawn(gaussians, *eyes, 56) for gaussians, _ in pairs))
    study = gather(scene, (pairs[0][0], pairs[1][0]))
    return SimpleNamespace(study=study, truth=truth, scene=scene,
                           owners=tuple(owner for _, owner in pairs))


@pytest.fixture(scope="session")
def judge(look_alikes):
    """Return the judge of the look-alikes' study."""
    from part2gs_robotics.judge import Judge

    return Judge(look_alikes.study)


@pytest.fixture(scope="session")
def right(judge, look_alikes):
    """The verdict on both true motions."""
    return judge.judge(look_alikes.truth)
