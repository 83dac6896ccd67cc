"""Captured scenes: pictures, cameras, depth and truth agree with the model's geometry."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from part2gs_robotics.capture.cameras import FOV_RAD, place_cameras
from part2gs_robotics.capture.capture import Shots, capture
from part2gs_robotics.capture.joint_states import parse_states
from part2gs_robotics.cli import main
from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import CheckError, ConfigError, SceneError
from part2gs_robotics.readers.read_scene import read_scene

BALL = """<mujoco><worldbody><geom type="plane" size="9 9 .1"/>
<body><geom type="sphere" size=".3" pos=".4 -.2 1" rgba=".8 .2 .1 1"/></body>
<body name="lid"><joint name="hinge" type="hinge" axis="0 0 2" pos="1 0 0" range="0 90"/>
<geom type="sphere" size=".01" pos=".4 -.2 1"/></body></worldbody></mujoco>"""
BOX = """<mujoco><compiler angle="radian"/><worldbody>
<body name="case"><geom type="box" size=".2 .15 .1"/>
  <body name="drawer" pos="0 -.3 0"><joint name="slide" type="slide" axis="0 -1 0" range="0 .2"/>
    <geom type="box" size=".1 .1 .05"/>
    <body name="flap"><joint name="turn" type="hinge" axis="1 0 0" pos="0 -.1 .05"/>
      <geom type="box" size=".1 .01 .05" pos="0 -.12 0"/></body></body>
</body></worldbody></mujoco>"""
URDF = """<robot name="r"><link name="base"><visual><geometry><box size=".4 .3 .2"/></geometry>
</visual></link><link name="door"><visual><origin xyz="0 -.2 0"/><geometry>
<box size=".4 .02 .2"/></geometry></visual></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="door"/>
<axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="1" velocity="1"/></joint></robot>"""

Rgba = NDArray[np.uint8]
Make = Callable[..., Path]


@pytest.fixture
def model(tmp_path: Path) -> Callable[[str, str], Path]:
    def write(text: str, name: str = "model.xml") -> Path:
        (tmp_path / "model").mkdir(exist_ok=True)
        (tmp_path / "model" / name).write_text(text)
        return tmp_path / "model" / name

    return write


def read_view(scene: Path, state: str, index: int) -> tuple[Rgba, NDArray[np.float64], float]:
    """Return the picture, camera_from_world in OpenCV axes, and the focal length in pixels."""
    cameras = json.loads((scene / f"transforms_train_{state}.json").read_text())
    frame = cameras["frames"][index]
    picture = cv2.imread(str(scene / frame["file_path"]), cv2.IMREAD_UNCHANGED)
    viewmat = np.linalg.inv(np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1]))
    return picture, viewmat, cameras["fl_x"]


def project(points: NDArray[np.float64], viewmat: NDArray[np.float64], focal: float, size: int):
    local = points @ viewmat[:3, :3].T + viewmat[:3, 3]
    return size / 2 + focal * local[:, :2] / local[:, 2:], local[:, 2]


def box_corners(centre: list[float], half: list[float]) -> NDArray[np.float64]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.array(centre) + signs * np.array(half)


def test_a_ball_lies_where_its_camera_says_to_a_tenth_of_a_pixel(model: Make, tmp_path: Path):
    scene = capture(model(BALL), tmp_path / "s", Shots(4, size=64)).scene
    for index in range(4):
        picture, viewmat, focal = read_view(scene, "start", index)
        alpha = picture[..., 3] / 255.0
        centre = np.array([[0.4, -0.2, 1.0]])
        (uv,), (z,) = project(centre, viewmat, focal, 64)
        rows, cols = np.indices(alpha.shape) + 0.5
        middle = np.array([(alpha * cols).sum(), (alpha * rows).sum()]) / alpha.sum()
        # Perspective shifts the outline's centroid by less than (r / z)^2 of its offset from the
        # image centre; nine levels of coverage leave 0.05 px.
        bound = 0.05 + (0.3 / z) ** 2 * np.linalg.norm(uv - 32) * 1.5
        assert np.linalg.norm(middle - uv) < bound


def test_depth_of_a_ball_is_its_nearest_point_in_thousandths(model: Make, tmp_path: Path):
    scene = capture(model(BALL), tmp_path / "s", Shots(4, size=64, depth=True)).scene
    _, viewmat, focal = read_view(scene, "end", 2)
    depth = cv2.imread(str(scene / "end/train/depth/0002.png"), cv2.IMREAD_UNCHANGED)
    (uv,), (z,) = project(np.array([[0.4, -0.2, 1.0]]), viewmat, focal, 64)
    away = np.linalg.norm(viewmat[:3, :3] @ [0.4, -0.2, 1.0] + viewmat[:3, 3])
    assert depth.dtype == np.uint16
    # The ray to the centre meets the ball 0.3 earlier. Half a pixel off that ray and the ball's
    # facets cost less than 2 mm.
    assert abs(depth[int(uv[1]), int(uv[0])] - 1000 * z * (1 - 0.3 / away)) < 2
    assert depth[0, 0] == 0


def test_outlines_match_the_truth_in_both_states(model: Make, tmp_path: Path):
    states = {"slide": (0.02, 0.18)}
    done = capture(model(BOX), tmp_path / "s", Shots(5, size=96), states)
    truth = json.loads((done.truth / "gt.json").read_text())
    (part,) = truth["parts"]
    assert (part["type"], part["parent"], part["q"]) == ("prismatic", 0, [0.02, 0.18])
    pixels = np.indices((96, 96)).transpose(1, 2, 0)[..., ::-1] + 0.5
    for state, q in (("start", 0.02), ("end", 0.18)):
        picture, viewmat, focal = read_view(done.scene, state, 3)
        expected = np.zeros((96, 96), np.bool_)
        shift = np.array([0, -q, 0])
        boxes = [box_corners([0, 0, 0], [0.2, 0.15, 0.1])]
        boxes += [box_corners([0, -0.3, 0], [0.1, 0.1, 0.05]) + shift]
        boxes += [box_corners([0, -0.42, 0], [0.1, 0.01, 0.05]) + shift]
        for corners in boxes:
            uv, _ = project(corners, viewmat, focal, 96)
            sides = ConvexHull(uv).equations
            expected |= (pixels @ sides[:, :2].T + sides[:, 2] < 0).all(-1)
        found = picture[..., 3] > 127
        # Nine sub-pixels decide a border pixel, its centre decides here: about 1 % of the area.
        assert (found & expected).sum() / (found | expected).sum() > 0.98


def test_truth_states_axes_so_that_motions_are_positive(model: Make, tmp_path: Path):
    done = capture(model(BOX), tmp_path / "s", Shots(4, size=32), {
        "slide": (0.15, 0.05), "turn": (0.0, -0.7),
    })  # fmt: skip
    slide, turn = json.loads((done.truth / "gt.json").read_text())["parts"]
    assert done.joints == ("slide", "turn")
    np.testing.assert_allclose(slide["axis"], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turn["axis"], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(turn["point"], [0, -0.4 - 0.15, 0.05], atol=1e-12)
    assert (slide["motion"], turn["motion"]) == pytest.approx((0.1, 0.7))
    assert (turn["parent"], turn["type"]) == (1, "continuous")


def test_default_states_cover_the_range(model: Make, tmp_path: Path):
    done = capture(model(BOX), tmp_path / "s", Shots(4, size=32))
    slide, turn = json.loads((done.truth / "gt.json").read_text())["parts"]
    assert slide["q"] == pytest.approx([0.01, 0.15])  # 5 % and 75 % of 0.2
    assert turn["q"] == pytest.approx([0.0, np.pi / 4])  # unlimited


def test_a_captured_scene_is_a_scene(model: Make, tmp_path: Path):
    scene = capture(model(BOX), tmp_path / "s", Shots(24, test_views=2, size=64)).scene
    read = read_scene(scene, ReadConfig())
    assert [len(state) for state in read.states] == [24, 24]
    assert len(list(scene.glob("end/test/rgba/*.png"))) == 2


def test_urdf_visuals_are_photographed(model: Make, tmp_path: Path):
    scene = capture(model(URDF, "model.urdf"), tmp_path / "s", Shots(4, size=48)).scene
    assert all((read_view(scene, "end", i)[0][..., 3] == 255).sum() > 100 for i in range(4))


def test_glass_shows_the_surface_that_alpha_and_depth_show(model: Make, tmp_path: Path):
    pictures = []
    for name, opacity in (("solid", "1"), ("glass", ".2")):
        path = model(BALL.replace(".8 .2 .1 1", f".8 .2 .1 {opacity}"))
        scene = capture(path, tmp_path / name, Shots(4, size=32)).scene
        pictures.append(read_view(scene, "start", 0)[0])
    np.testing.assert_array_equal(*pictures)


def test_the_same_seed_gives_the_same_bytes(model: Make, tmp_path: Path):
    path = model(BOX)
    first, same, other = (
        capture(path, tmp_path / name, Shots(4, size=32, seed=seed)).scene
        for name, seed in (("a", 1), ("b", 1), ("c", 2))
    )
    files = sorted(p.relative_to(first) for p in first.rglob("*.*"))
    assert len(files) == 10
    assert all((first / f).read_bytes() == (same / f).read_bytes() for f in files)
    assert any((first / f).read_bytes() != (other / f).read_bytes() for f in files)


def test_every_camera_holds_the_object_and_stands_apart():
    rng = np.random.default_rng(3)
    cloud = rng.normal(size=(200, 3)) * [0.5, 0.1, 0.3] + [5, 1, -2]
    cameras = place_cameras(cloud, 40, rng)
    for camera in cameras:
        np.testing.assert_allclose(camera[:3, :3] @ camera[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(camera[:3, :3]) > 0
        local = (cloud - camera[:3, 3]) @ camera[:3, :3]
        assert (local[:, 2] < 0).all()
        assert np.abs(local[:, :2] / -local[:, 2:]).max() <= np.tan(FOV_RAD / 2)
    backs = np.array([c[:3, 2] for c in cameras])
    apart = np.arccos(np.clip(backs @ backs.T - 2 * np.eye(40), -1, 1))
    assert np.rad2deg(apart.min()) > 5  # an even spiral of 40 leaves about 17 degrees


@pytest.mark.parametrize(
    ("text", "options", "error", "message"),
    [
        (BOX, {"views": 3}, ConfigError, "--views 3.* Expected 4 to 2000"),
        (BOX, {"views": 9999}, ConfigError, "--views 9999"),
        (BOX, {"size": 8}, ConfigError, "--size 8.* Expected 32 to 2048"),
        (BOX, {"states": {"sldie": (0, 0.1)}}, ConfigError, "sldie.*Available: slide, turn"),
        (BOX, {"states": {"slide": (0, 0.3)}}, ConfigError, r"leaves the joint's range \[0, 0.2\]"),
        (BOX, {"states": {"turn": (0, float("nan"))}}, ConfigError, "range"),
        (BOX, {"states": {"turn": (0.5, 0.5)}}, ConfigError, "does not move"),
        ("<mujoco/>", {}, CheckError, "nothing to photograph"),
        (BALL.replace('type="hinge"', 'type="ball"'), {}, (ConfigError, CheckError), "."),
        (BOX.replace('type="hinge"', 'type="twist"'), {}, CheckError, "does not compile"),
        ("<mujoco><worldbody>", {}, CheckError, "model.xml:1: is not well-formed"),
        ("", {}, CheckError, "not well-formed"),
    ],
)
def test_bad_input_is_named_and_leaves_nothing(
    model: Make, tmp_path: Path, text: str, options: dict, error: type, message: str
):
    states = options.get("states")
    numbers = {name: value for name, value in options.items() if name != "states"}
    with pytest.raises(error, match=message):
        capture(model(text), tmp_path / "s", Shots(**numbers), states)
    assert [p.name for p in tmp_path.iterdir()] == ["model"]


def test_states_are_read_from_words():
    assert parse_states(["a=0,1.5", "b=c=-1,2e-1"]) == {"a": (0, 1.5), "b=c": (-1, 0.2)}


@pytest.mark.parametrize("word", ["a", "a=", "a=1", "a=1,2,3", "a=x,1", "=1,2", ""])
def test_words_that_are_no_state_are_named(word: str):
    with pytest.raises(ConfigError, match=r"not understood.* Expected JOINT=Q0,Q1"):
        parse_states([word])
    with pytest.raises(ConfigError, match="given twice"):
        parse_states(["a=0,1", "a=0,1"])


def test_the_command_line_captures(model: Make, tmp_path: Path):
    words = ["--views", "4", "--size", "32", "--state", "slide=0.05,0.1", "--state", "turn=0,1"]
    assert main(["capture", str(model(BOX)), str(tmp_path / "s"), *words]) == 0
    parts = json.loads((tmp_path / "s.gt/gt.json").read_text())["parts"]
    assert [part["q"] for part in parts] == [[0.05, 0.1], [0, 1]]


def test_two_moving_joints_of_one_body_are_refused(model: Make, tmp_path: Path):
    extra = '<joint name="lift" type="slide" axis="0 0 1" range="0 1"/><joint name="slide"'
    path = model(BOX.replace('<joint name="slide"', extra))
    with pytest.raises(ConfigError, match="'drawer' has several moving joints"):
        capture(path, tmp_path / "s", Shots(4, size=32))
    capture(path, tmp_path / "s", Shots(4, size=32), {"lift": (0, 1)})


def test_existing_work_is_never_overwritten(model: Make, tmp_path: Path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s/precious.txt").write_text("kept")
    with pytest.raises(SceneError, match="exists and is not empty"):
        capture(model(BOX), tmp_path / "s", Shots(4, size=32))
    assert (tmp_path / "s/precious.txt").read_text() == "kept"


def test_an_unwritable_place_is_named(model: Make, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SceneError, match="cannot be written"):
        capture(model(BOX), tmp_path / "file/s", Shots(4, size=32))
