"""Readers: same scene from every layout, exact cameras, pixels changed only as said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from synth_photos import BALLS, FOV, ring_of_cameras, write_ball_scene

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers import image_files as images
from part2gs_robotics.readers.nerfstudio import camera_from_world
from part2gs_robotics.readers.read_scene import read_scene, read_scene_yaml


def change_json(file: Path, **values: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | values))


def write_png(file: Path, pixels: np.ndarray[Any, Any]) -> None:
    file.write_bytes(np.asarray(cv2.imencode(".png", pixels)[1]).tobytes())


@pytest.mark.parametrize("layout", ["artgs", "nerfstudio", "single"])
def test_every_layout_gives_the_same_scene(ball_scene: Path, tmp_path: Path, layout: Any) -> None:
    want = read_scene(ball_scene, ReadConfig())
    got = read_scene(write_ball_scene(tmp_path / "s", layout=layout), ReadConfig())
    assert got.layout == layout
    for a, b in zip(want.states, got.states, strict=True):
        assert np.array_equal(a.images, b.images)
        assert np.array_equal(a.alphas, b.alphas)
        assert np.allclose(a.Ks, b.Ks, rtol=1e-12)
        assert np.array_equal(a.viewmats, b.viewmats)


def test_cameras_project_known_points_onto_the_photo(ball_scene: Path) -> None:
    """The centre of a ball lies inside its own colour wherever it is in front."""
    state = read_scene(ball_scene, ReadConfig()).states[0]
    centre, _, radius, color = BALLS[1]
    for image, alpha, K, viewmat in zip(state.images, state.alphas, state.Ks, state.viewmats,
                                        strict=True):
        ball = viewmat[:3, :3] @ np.array(centre) + viewmat[:3, 3]
        base = viewmat[:3, 3]
        assert ball[2] > 0, "OpenCV axes look along +z"
        u, v, w = K @ ball
        row, column = int(v / w), int(u / w)
        assert alpha[row, column] == 255
        if ball[2] + radius < base[2]:  # nearer than the other ball: nothing hides it
            assert np.argmax(image[row, column]) == np.argmax(color)


def test_opengl_pose_becomes_opencv_camera_from_world() -> None:
    pose = ring_of_cameras(24)[5]
    viewmat = camera_from_world({"transform_matrix": pose.tolist()}, "frame")
    eye = viewmat @ np.append(pose[:3, 3], 1.0)
    assert np.allclose(eye[:3], 0, atol=1e-12)
    ahead = viewmat @ np.append(pose[:3, 3] - 2 * pose[:3, 2], 1.0)  # OpenGL looks along -z
    assert np.allclose(ahead[:3], [0, 0, 2])
    above = viewmat @ np.append(pose[:3, 3] + pose[:3, 1], 1.0)
    assert np.allclose(above[:3], [0, -1, 0])


def test_field_of_view_gives_the_focal_length(ball_scene: Path) -> None:
    K = read_scene(ball_scene, ReadConfig()).states[0].Ks[0]
    assert np.isclose(K[0, 0], 24 / np.tan(FOV / 2))
    assert K[0, 2] == K[1, 2] == 24


def test_intrinsics_of_a_frame_win_over_those_of_the_file(scene: Path) -> None:
    file = scene / "transforms_train_start.json"
    content = json.loads(file.read_text())
    content["frames"][2] |= {"fl_x": 70.0, "fl_y": 71.0, "cx": 23.0}
    file.write_text(json.dumps(content))
    Ks = read_scene(scene, ReadConfig()).states[0].Ks
    assert np.array_equal(Ks[2], [[70, 0, 23], [0, 71, 24], [0, 0, 1]])
    assert Ks[1, 0, 0] != 70


def test_every_eighth_view_is_held_out(ball_scene: Path) -> None:
    for state in read_scene(ball_scene, ReadConfig()).states:
        assert state.held_out.sum() == 3
        assert set(np.diff(np.flatnonzero(state.held_out))) == {8}


def test_downscaling_scales_cameras_and_averages_pixels(scene: Path) -> None:
    full = read_scene(scene, ReadConfig()).states[0]
    half_scene = read_scene(scene, ReadConfig(max_side=32, crop=False))
    half = half_scene.states[0]
    assert (half.width, half.height) == (32, 32)
    assert np.allclose(half.Ks[:, :2], full.Ks[:, :2] * 32 / 48)
    assert abs(half.alphas.mean() - full.alphas.mean()) < 1.0  # rounding of one count
    assert any("--max-side 32" in note for note in half_scene.notes)


def middles(state) -> np.ndarray:
    """Return [V, 3] the ray through the middle of every mask."""
    rows, columns = np.indices(state.alphas.shape[1:]) + 0.5
    weight = state.alphas / state.alphas.sum((1, 2), keepdims=True)
    pixels = np.stack([(weight * columns).sum((1, 2)), (weight * rows).sum((1, 2)),
                       np.ones(len(weight))], 1)
    return np.einsum("vij,vj->vi", np.linalg.inv(state.Ks), pixels)


@pytest.mark.parametrize("side", [40, 24])
def test_large_images_are_cut_round_the_object_and_cameras_follow(ball_scene: Path, side) -> None:
    """What is cut is ground alone, and every mask stays where its camera sees it."""
    whole = read_scene(ball_scene, ReadConfig())
    cut = read_scene(ball_scene, ReadConfig(max_side=side))
    plain = read_scene(ball_scene, ReadConfig(max_side=side, crop=False))
    for full, near, far in zip(whole.states, cut.states, plain.states, strict=True):
        assert max(near.width, near.height) <= side
        assert np.allclose(middles(near), middles(full), atol=0.2 / full.Ks[0, 0, 0])
        shown = [state.alphas.sum() / state.Ks[:, 0, 0].mean() ** 2 for state in (full, near)]
        assert shown[1] == pytest.approx(shown[0], rel=0.01), "nothing of the object is lost"
        assert near.Ks[:, 0, 0].min() > 1.05 * far.Ks[:, 0, 0].max(), "its pixels are finer"
        ring = [near.alphas[:, 0], near.alphas[:, -1], near.alphas[:, :, 0], near.alphas[:, :, -1]]
        assert max(edge.max() for edge in ring) == 0, "ground all round"
    assert len({state.Ks[0, 0, 0] for state in cut.states}) == 1, "both states at one scale"
    assert sum("cropped round the object" in note for note in cut.notes) == 2
    assert not any("cropped" in note for note in (*whole.notes, *plain.notes))


def test_photos_that_are_filled_are_not_cut(scene: Path) -> None:
    names = json.loads((scene / "transforms_train_start.json").read_text())["frames"]
    file = scene / f"{names[0]['file_path']}"
    file = file if file.suffix else file.with_suffix(".png")
    pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    pixels[..., 3] = 255
    cv2.imwrite(str(file), pixels)
    state = read_scene(scene, ReadConfig(max_side=40)).states[0]
    assert (state.width, state.height) == (40, 40)
    assert state.Ks[0, 0, 2] == pytest.approx(20)


def test_colour_under_alpha_zero_never_bleeds_into_the_object() -> None:
    rgb = np.zeros((8, 8, 3), np.uint8)
    rgb[:, :3] = (200, 100, 50)
    rgb[:, 3:] = 255  # white that nobody should see
    alpha = np.zeros((8, 8), np.uint8)
    alpha[:, :3] = 255
    small, small_alpha = images.resize_area(rgb, alpha, (4, 4))
    assert small_alpha[:, 1].tolist() == [128] * 4
    assert small[:, :2].reshape(-1, 3).tolist() == [[200, 100, 50]] * 8


def test_images_without_extension_or_with_jpg_name_are_found(scene: Path) -> None:
    file = scene / "transforms_train_start.json"
    content = json.loads(file.read_text())
    content["frames"][0]["file_path"] = "start/train/rgba/0000"
    content["frames"][1]["file_path"] = "start/train/rgb/0001.jpg"  # masked twin in ../rgba
    file.write_text(json.dumps(content))
    assert len(read_scene(scene, ReadConfig()).states[0]) == 24


def test_stray_files_and_answers_change_nothing(scene: Path) -> None:
    before = read_scene(scene, ReadConfig())
    for name in (".DS_Store", "start/train/rgba/.DS_Store", "start/train/rgba/Thumbs.db",
                 "num_slots.json", "joint_types_paris.json", "transforms_test_start.json",
                 "start/train/rgba/._0000.png"):
        (scene / name).write_text("not what it seems")
    after = read_scene(scene, ReadConfig())
    assert np.array_equal(before.states[0].images, after.states[0].images)
    assert before.notes == after.notes


def test_allow_missing_drops_frames_and_photos(scene: Path) -> None:
    (scene / "start/train/rgba/0000.png").unlink()
    file = scene / "transforms_train_end.json"
    content = json.loads(file.read_text())
    content["frames"].pop()
    file.write_text(json.dumps(content))
    states = read_scene(scene, ReadConfig(allow_missing=True)).states
    assert [len(state) for state in states] == [23, 23]


@pytest.mark.parametrize("how", ["mask_path", "sibling"])
def test_masks_beside_photos_equal_alpha(scene: Path, how: str) -> None:
    want = read_scene(scene, ReadConfig()).states[0].alphas
    folder = scene / "start/train" / ("masks" if how == "sibling" else "other")
    folder.mkdir()
    for file in (scene / "start/train/rgba").iterdir():
        pixels = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
        write_png(folder / file.name, pixels[..., 3])
        write_png(file, pixels[..., :3])
    json_file = scene / "transforms_train_start.json"
    content = json.loads(json_file.read_text())
    if how == "mask_path":
        for frame in content["frames"]:
            frame["mask_path"] = f"start/train/other/{Path(frame['file_path']).name}"
    json_file.write_text(json.dumps(content))
    assert np.array_equal(read_scene(scene, ReadConfig()).states[0].alphas, want)


def test_inverted_masks_are_turned(scene: Path) -> None:
    want = read_scene(scene, ReadConfig()).states[0].alphas
    for state in ("start", "end"):
        for file in (scene / state / "train/rgba").iterdir():
            pixels = np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
            pixels[..., 3] = 255 - pixels[..., 3]
            write_png(file, pixels)
    got = read_scene(scene, ReadConfig(invert_masks=True)).states[0].alphas
    assert np.array_equal(got, want)


def test_undistortion_inverts_the_lens() -> None:
    """A dot drawn where the distorted camera sees a point is found where the pinhole sees it."""
    K = np.array([[120.0, 0, 64.0], [0, 118.0, 63.0], [0, 0, 1]])
    lens = (-0.2, 0.05, 0.002, -0.003, 0.0)
    undistorter = images.Undistorter(K, lens, (128, 128))
    shift = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    for point in np.array([[0.1, 0.1, 1.0], [-0.2, 0.15, 1.0], [0.2, -0.2, 1.0]]):
        seen = cv2.projectPoints(point[None], np.zeros(3), np.zeros(3), K - shift,
                                 np.array(lens))[0].reshape(2)  # integer pixel centres
        rows, columns = np.mgrid[:128, :128]
        dot = np.exp(-((columns - seen[0]) ** 2 + (rows - seen[1]) ** 2) / 8.0)
        gray = np.repeat((255 * dot).astype(np.uint8)[..., None], 3, axis=2)
        flat = undistorter.color(gray, gray[..., 0])[1].astype(float)
        found = np.array([(flat * columns).sum(), (flat * rows).sum()]) / flat.sum() + 0.5
        want = (undistorter.K @ point)[:2]
        assert np.abs(found - want).max() < 0.1  # a tenth of a pixel: sampling of the dot


def test_distorted_scene_is_undistorted_once(scene: Path) -> None:
    for name in ("transforms_train_start.json", "transforms_train_end.json"):
        change_json(scene / name, k1=0.01, camera_model="OPENCV")
    read = read_scene(scene, ReadConfig())
    assert sum("distortion removed from 24 images" in note for note in read.notes) == 2


def test_16_bit_and_grey_images_become_8_bit_rgb(tmp_path: Path) -> None:
    rgba = np.zeros((4, 4, 4), np.uint16)
    rgba[..., 0], rgba[..., 3] = 65535, 32896  # BGR order on disk: blue
    write_png(tmp_path / "a.png", rgba)
    rgb, alpha = images.read_rgba(tmp_path / "a.png")
    assert rgb[0, 0].tolist() == [0, 0, 255]
    assert alpha is not None
    assert alpha[0, 0] == 128
    write_png(tmp_path / "g.png", np.full((4, 4), 7, np.uint8))
    rgb, alpha = images.read_rgba(tmp_path / "g.png")
    assert rgb.tolist() == np.full((4, 4, 3), 7).tolist()
    assert alpha is None


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_size_is_read_from_the_header(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"image{suffix}"
    pixels = np.zeros((37, 53, 3), np.uint8)
    file.write_bytes(np.asarray(cv2.imencode(suffix, pixels)[1]).tobytes())
    assert images.image_size(file) == (53, 37)


def test_every_truncated_header_is_refused(tmp_path: Path) -> None:
    for suffix in (".png", ".jpg"):
        data = np.asarray(cv2.imencode(suffix, np.zeros((8, 8, 3), np.uint8))[1]).tobytes()
        for length in range(20):
            (tmp_path / "cut").write_bytes(data[:length])
            with pytest.raises(SceneError, match="not a PNG or JPEG"):
                images.image_size(tmp_path / "cut")


def test_units_and_up_are_kept(ball_scene: Path) -> None:
    read = read_scene(ball_scene, ReadConfig(scale=0.5, up=(0.0, 0.0, 2.0)))
    assert read.meters_per_unit == 0.5
    assert read.up is not None
    assert read.up.tolist() == [0, 0, 1]


def test_scene_yaml_is_optional(tmp_path: Path) -> None:
    assert read_scene_yaml(tmp_path) == {}
    (tmp_path / "scene.yaml").write_text("")
    assert read_scene_yaml(tmp_path) == {}
    (tmp_path / "scene.yaml").write_text("parts: 2\nup: [0, 0, 1]\n")
    assert read_scene_yaml(tmp_path) == {"parts": 2, "up": [0, 0, 1]}
