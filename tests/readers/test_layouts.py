"""Layouts of other projects, written by code that shares nothing with the readers."""

from __future__ import annotations

import struct
from functools import cache

import cv2
import layout_writers as writers
import numpy as np
import pytest
from layout_writers import FOCAL, SIDE
from synth_photos import ball_photo, ring_of_cameras

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.layouts import read_layout
from part2gs_robotics.readers.lenses import COUNTS, LENSES, Lens, split
from part2gs_robotics.readers.read_scene import read_scene

# Of every model of COLMAP: own parameters like those of a phone's or of a wide lens.
LENS_PARAMS = {
    "SIMPLE_PINHOLE": [], "PINHOLE": [], "SIMPLE_RADIAL": [0.08], "RADIAL": [0.08, -0.03],
    "OPENCV": [0.06, -0.02, 0.003, -0.004], "OPENCV_FISHEYE": [0.05, -0.02, 0.01, -0.003],
    "FULL_OPENCV": [0.06, -0.02, 0.003, -0.004, 0.01, 0.02, -0.01, 0.005], "FOV": [0.9],
    "SIMPLE_RADIAL_FISHEYE": [0.05], "RADIAL_FISHEYE": [0.05, -0.02],
    "THIN_PRISM_FISHEYE": [0.05, -0.02, 0.003, -0.004, 0.01, 0.002, 0.001, -0.002],
    "RAD_TAN_THIN_PRISM_FISHEYE": [0.05, -0.02, 0.01, 0, 0, 0, 0.003, -0.004, 0.001, 0, 0.002, 0],
    "SIMPLE_DIVISION": [-0.05], "DIVISION": [-0.05], "SIMPLE_FISHEYE": [], "FISHEYE": [],
    "EUCM": [0.6, 1.1]}  # fmt: skip


def lens(model):
    focal = [FOCAL] if LENSES[model][0] == 1 else [FOCAL, 1.01 * FOCAL]
    return (*focal, SIDE / 2 + 0.7, SIDE / 2 - 0.4, *LENS_PARAMS[model])


def matrix(params, model):
    (fx, fy, cx, cy), own = split(model, params)
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), own


def assert_same(got, want, pixels=0):
    for a, b in zip(got.states, want.states, strict=True):
        assert len(a) == len(b)
        np.testing.assert_allclose(a.viewmats, b.viewmats, atol=1e-9)
        np.testing.assert_allclose(a.Ks, b.Ks, rtol=1e-8)
        assert np.abs(a.alphas.astype(int) - b.alphas).max() <= pixels
        on = b.alphas > 127
        assert np.abs(a.images[on].astype(int) - b.images[on]).max() <= pixels


@pytest.mark.parametrize(("layout", "write"), [
    ("paris", writers.write_paris), ("dta", writers.write_dta),
    ("colmap", writers.write_colmap),
    ("colmap", lambda folder: writers.write_colmap(folder, "txt")),
    ("colmap", lambda folder: writers.write_colmap(folder, places=("state_0", "state_1"))),
    ("colmap", lambda folder: writers.write_colmap(folder, places=("start/images", "end/images"))),
])
def test_the_same_scene_comes_out_of_every_layout(ball_scene, tmp_path, layout, write):
    got = read_scene(write(tmp_path / "scene"), ReadConfig())
    assert got.layout == layout
    assert_same(got, read_scene(ball_scene, ReadConfig()))


def test_a_colmap_model_per_state_is_read(ball_scene, tmp_path):
    writers.write_colmap(tmp_path / "both")
    for state, place in enumerate(("a", "b")):
        home = tmp_path / f"scene/state_{state}"
        writers.write_colmap(home, places=("images",) if state == 0 else ("images/b",))
        (tmp_path / "both/images" / place).exists()
    # state 1's own photos: both states share the cameras of the ring
    for file in (tmp_path / "scene/state_1/images/b").iterdir():
        file.write_bytes((tmp_path / "both/images/b" / file.name).read_bytes())
    model = tmp_path / "scene/state_0/sparse/0/images.bin"
    model.write_bytes(model.read_bytes().replace(b"images/photo", b"photo"))
    assert_same(read_scene(tmp_path / "scene", ReadConfig()), read_scene(ball_scene, ReadConfig()))


def test_masks_lie_beside_colmaps_photos(ball_scene, tmp_path):
    scene = writers.write_colmap(tmp_path / "scene")
    for file in sorted((scene / "images").rglob("*.png")):
        rgba = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        mask = scene / "masks" / file.relative_to(scene / "images")
        writers.save(mask.with_name(f"{file.name}.png") if "a" in mask.parts else mask,
                     rgba[..., 3])
        cv2.imwrite(str(file), rgba[..., :3])
    assert_same(read_scene(scene, ReadConfig()), read_scene(ball_scene, ReadConfig()))


def test_depth_of_dta_is_millimetres(tmp_path):
    scene = writers.write_dta(tmp_path / "scene")
    for file in (scene / "color_segmented").iterdir():
        writers.save(scene / "depth_filtered" / file.name, np.full((SIDE, SIDE), 4000, np.uint16))
    _, states = read_layout(scene, ReadConfig())
    assert all(image.depth is not None and image.depth_unit == 1e-3
               for state in states for image in state)
    _, states = read_layout(scene, ReadConfig(depth=False))
    assert all(image.depth is None for state in states for image in state)


@pytest.mark.parametrize("model", LENSES)
def test_lenses_are_those_of_colmap(model):
    import pycolmap

    assert list(LENSES).index(model) == int(getattr(pycolmap.CameraModelId, model))
    params = lens(model)
    assert len(params) == COUNTS[model]
    camera = pycolmap.Camera(model=model, width=SIDE, height=SIDE, params=list(params))
    rays = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2))
    rays[0] = 0
    K, own = matrix(params, model)
    np.testing.assert_allclose(Lens(K, model, own).pixels(rays),
                               camera.img_from_cam(np.c_[rays, np.ones(100)]), atol=1e-9)


def test_every_model_of_colmap_is_known_but_the_sphere():
    import pycolmap

    names = {name for name in dir(pycolmap.CameraModelId) if name.isupper()} - {"INVALID"}
    assert names - {"EQUIRECTANGULAR"} == set(LENSES)


WIDE, SPAN = 320, 1.1  # pixels and tangent of a pinhole photo of all that a lens can see


@cache
def wide_photos():
    """Return photos of that pinhole by view and state, drawn once for all lenses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("synth_photos.FOV", 2 * np.arctan(SPAN))
        return [[ball_photo(pose, WIDE, state) for pose in ring_of_cameras(writers.VIEWS)]
                for state in (0, 1)]


def seen_along(rays, index, state):
    """Return what rays [H, W, 2] of a view meet."""
    at = ((rays / SPAN + 1) * WIDE / 2 - 0.5).astype(np.float32)
    return cv2.remap(wide_photos()[state][index], at[..., 0], at[..., 1], cv2.INTER_LINEAR)


@pytest.mark.parametrize("model", LENSES)
def test_undistorted_photos_are_those_of_the_pinhole(tmp_path, model):
    """A photo of the lens is drawn ray by ray; read back it must be the pinhole's photo."""
    import pycolmap

    camera = pycolmap.Camera(model=model, width=SIDE, height=SIDE, params=list(lens(model)),
                             camera_id=7)
    grid = np.stack(np.meshgrid(np.arange(SIDE) + 0.5, np.arange(SIDE) + 0.5), -1)
    rays = np.asarray(camera.cam_from_img(grid.reshape(-1, 2)))[:, :2].reshape(SIDE, SIDE, 2)
    scene = read_scene(writers.write_colmap(tmp_path / "scene", "txt", camera,
                                            view=lambda n, s: seen_along(rays, n, s)), ReadConfig())
    state = scene.states[0]
    for index in range(writers.VIEWS):
        K = state.Ks[index]
        want = seen_along((grid - K[:2, 2]) / np.diag(K)[:2], index, 0)
        off = np.abs(want[..., 3].astype(float) - state.alphas[index])
        assert off.mean() < 4.0, "outlines agree to a fraction of a pixel"


def test_a_lens_that_folds_is_refused():
    K = np.array([[40.0, 0, 24], [0, 40, 24], [0, 0, 1]])
    assert Lens(K, "SIMPLE_RADIAL", (-90.0,)).fitting((48, 48)) is None
    fitting = Lens(K, "SIMPLE_RADIAL", (0.0,)).fitting((48, 48))
    np.testing.assert_allclose(fitting, K, atol=1e-6)


def torn(name, change):
    def run(scene):
        path = scene / "sparse/0" / name
        path.write_bytes(change(path.read_bytes()))
    return run


COLMAP_CASES = {
    "cameras cut": ("bin", torn("cameras.bin", lambda b: b[:30]), "is left|are left"),
    "images cut": ("bin", torn("images.bin", lambda b: b[:-9]), "middle of an entry|are left"),
    "1e9 images": ("bin", torn("images.bin", lambda b: struct.pack("<Q", 10**9) + b[8:]),
                   "says it holds 1000000000 entries"),
    "2^64-1 cameras": ("bin", torn("cameras.bin", lambda b: b"\xff" * 8 + b[8:]),
                       "says it holds 18446744073709551615"),
    "no cameras": ("bin", torn("cameras.bin", lambda b: b"\0" * 8), "0 cameras"),
    "unknown model": ("bin", torn("cameras.bin", lambda b: b[:12] + struct.pack("<i", 99)
                                  + b[16:]), "camera model '99' is not supported"),
    "a sphere": ("txt", torn("cameras.txt", lambda b: b.replace(b"PINHOLE", b"EQUIRECTANGULAR")),
                 "'EQUIRECTANGULAR' is not supported"),
    "NaN focal": ("txt", torn("cameras.txt", lambda b: b"7 PINHOLE 48 48 nan 60 24 24\n"),
                  "finite numbers"),
    "too few parameters": ("txt", torn("cameras.txt", lambda b: b"7 OPENCV 48 48 60 60 24 24\n"),
                           "8 parameters of OPENCV"),
    "words for numbers": ("txt", torn("cameras.txt", lambda b: b"7 PINHOLE wide 48 1 1 1 1\n"),
                          r"cameras.txt:1: .* cannot be read"),
    "a pose of words": ("txt", torn("images.txt", lambda b: b"1 1 0 0 zero 0 0 0 7 a/b.png\n\n"),
                        r"images.txt:1: .* cannot be read"),
    "a long quaternion": ("txt", torn("images.txt", lambda b:
                                      b"1 2 0 0 0 0 0 4 7 a/photo 000.png\n\n"),
                          "unit quaternion"),
    "a camera that is not there": ("txt", torn("images.txt", lambda b:
                                               b"1 1 0 0 0 0 0 4 8 a/photo 000.png\n\n"),
                                   "camera 8 is not in the model"),
    "a name that leaves": ("txt", torn("images.txt", lambda b:
                                       b"1 1 0 0 0 0 0 4 7 ../../../etc/passwd\n\n"),
                           "leads outside the scene"),
    "photos of another size": ("txt", torn("cameras.txt", lambda b:
                                           b"7 PINHOLE 96 96 60 60 48 48\n"),
                               "camera says 96 x 96"),
    "huge distortion": ("txt", torn("cameras.txt", lambda b:
                                    b"7 SIMPLE_RADIAL 48 48 60 24 24 1e9\n"), "below 100"),
    "a lens that folds": ("txt", torn("cameras.txt", lambda b:
                                      b"7 SIMPLE_RADIAL 48 48 20 24 24 -90\n"),
                          "no pinhole photo fits"),
    "one folder": ("txt", torn("images.txt", lambda b: b.replace(b" b/", b" a/")),
                   "in 1 folders"),
    "photos gone": ("txt", lambda scene: (scene / "images/a/photo 003.png").unlink(),
                    "1 of 48 frames"),
    "a photo without pose": ("bin", lambda scene: (scene / "images/a/extra.png").write_bytes(
        (scene / "images/a/photo 003.png").read_bytes()), "1 of 25 images have no camera"),
}  # fmt: skip


@pytest.mark.parametrize("name", COLMAP_CASES)
def test_bad_models_are_refused(tmp_path, name):
    kind, breaking, message = COLMAP_CASES[name]
    scene = writers.write_colmap(tmp_path / "scene", kind)
    breaking(scene)
    with pytest.raises(SceneError, match=message) as caught:
        read_scene(scene, ReadConfig())
    assert "Expected" in str(caught.value)


def rewrite(name, old, new):
    def run(scene):
        path = scene / name
        path.write_text(path.read_text().replace(old, new, 1))
    return run


OTHERS = {
    "paris: one state": (writers.write_paris, lambda s: (s / "end/camera_train.json").unlink(),
                         "camera_train.json: cannot be read"),
    "paris: no K": (writers.write_paris, rewrite("start/camera_train.json", '"K"', '"L"'),
                    "K has shape"),
    "paris: a key that leaves": (writers.write_paris, rewrite("start/camera_train.json", '"0000"',
                                                              '"../../../x"'), "leads outside"),
    "paris: photo gone": (writers.write_paris, lambda s: (s / "end/train/0001.png").unlink(),
                          "1 of 24 frames"),
    "paris: no matrix": (writers.write_paris,
                         rewrite("start/camera_train.json", "[[", '"x", [['), "."),
    "dta: no camera": (writers.write_dta, lambda s: (s / "cam_K.txt").unlink(),
                       "cam_K.txt: cannot be read"),
    "dta: camera of words": (writers.write_dta, lambda s: (s / "cam_K.txt").write_text("a b c"),
                             "3 x 3 numbers"),
    "dta: camera of NaN": (writers.write_dta,
                           lambda s: (s / "cam_K.txt").write_text("nan " * 9), "NaN or infinity"),
    "dta: a third state": (writers.write_dta, rewrite("init_keyframes.yml", "time: 0", "time: 2"),
                           "time is '2'"),
    "dta: another name": (writers.write_dta, rewrite("init_keyframes.yml", "frame_0_0000",
                                                     "../../x"), "not a keyframe"),
    "dta: alias": (writers.write_dta, lambda s: (s / "init_keyframes.yml").write_text(
        "a: &a [1, 2]\nb: *a\n"), "YAML alias"),
    "dta: nested": (writers.write_dta, lambda s: (s / "init_keyframes.yml").write_text(
        "[" * 50_000), "nests deeper"),
    "dta: no YAML": (writers.write_dta, lambda s: (s / "init_keyframes.yml").write_text("a: [1"),
                     "cannot be read as YAML"),
    "dta: a list": (writers.write_dta, lambda s: (s / "init_keyframes.yml").write_text("- 1\n"),
                    "no mapping"),
    "dta: an object": (writers.write_dta, lambda s: (s / "init_keyframes.yml").write_text(
        "a: !!python/object/apply:os.system [true]\n"), "cannot be read as YAML"),
    "dta: a short matrix": (writers.write_dta, rewrite("init_keyframes.yml", "  - 0.0\n", ""),
                            "cam_in_ob has shape"),
    "dta: photo gone": (writers.write_dta,
                        lambda s: (s / "color_segmented/1_0003.png").unlink(), "1 of 48 frames"),
}  # fmt: skip


@pytest.mark.parametrize("name", OTHERS)
def test_bad_scenes_of_others_are_refused(tmp_path, name):
    write, breaking, message = OTHERS[name]
    scene = write(tmp_path / "scene")
    breaking(scene)
    with pytest.raises(SceneError, match=message) as caught:
        read_scene(scene, ReadConfig())
    assert "Expected" in str(caught.value)
