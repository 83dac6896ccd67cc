"""Every bad input ends with exit code 2, a message of four parts, and nothing half-written."""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

START = "transforms_train_start.json"
END = "transforms_train_end.json"
FIRST = "start/train/rgba/0000.png"
Break = Callable[[Path], list[str] | None]


def edit(change: Callable[[dict[str, Any]], object], name: str = START) -> Break:
    """Change the content of one camera file."""

    def run(scene: Path) -> None:
        content = json.loads((scene / name).read_text())
        change(content)
        (scene / name).write_text(json.dumps(content))

    return run


def edit_frame(**values: object) -> Break:
    return edit(lambda content: content["frames"][3].update(values))


def edit_pose(change: Callable[[np.ndarray[Any, Any]], object]) -> Break:
    def run(content: dict[str, Any]) -> None:
        pose = np.array(content["frames"][3]["transform_matrix"])
        change(pose)
        content["frames"][3]["transform_matrix"] = pose.tolist()

    return edit(run)


def text(name: str, content: str) -> Break:
    return lambda scene: (scene / name).write_text(content) and None


def data(name: str, content: bytes) -> Break:
    return lambda scene: (scene / name).write_bytes(content) and None


def remove(name: str) -> Break:
    return lambda scene: (scene / name).unlink()


def arguments(*words: str) -> Break:
    return lambda scene: list(words)


def png_header(width: int, height: int) -> bytes:
    body = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + body + struct.pack(">I", zlib.crc32(body))


def encoded(pixels: np.ndarray[Any, Any]) -> bytes:
    return bytes(np.asarray(cv2.imencode(".png", pixels)[1]).tobytes())


def all_images(change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]],
               state: str = "start") -> Break:
    def run(scene: Path) -> None:
        for file in (scene / state / "train" / "rgba").iterdir():
            pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            file.write_bytes(encoded(change(np.asarray(pixels))))

    return run


def with_alpha(value: int) -> Break:
    def run(pixels: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        pixels[..., 3] = value
        return pixels

    return all_images(run)


def empty_folder(scene: Path) -> None:
    shutil.rmtree(scene)
    scene.mkdir()


def three_images(content: dict[str, Any]) -> None:
    del content["frames"][3:]


def other_frame(content: dict[str, Any]) -> None:
    for frame in content["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] += [5.0, 0.0, 0.0]
        frame["transform_matrix"] = pose.tolist()


def opencv_axes(content: dict[str, Any]) -> None:
    for frame in content["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"])
                                     @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist()


def scattered_cameras(content: dict[str, Any]) -> None:
    rng = np.random.default_rng(0)
    for frame in content["frames"]:
        pose = np.array(frame["transform_matrix"])
        pose[:3, 3] += rng.uniform(-2, 2, 3)  # the object is 2 units wide
        frame["transform_matrix"] = pose.tolist()


def symlink_out(scene: Path) -> None:
    outside = scene.parent / "outside.png"
    shutil.move(scene / FIRST, outside)
    (scene / FIRST).symlink_to(outside)


def wrong_masks(scene: Path) -> None:
    all_images(lambda pixels: pixels[..., :3])(scene)
    (scene / "start/train/masks").mkdir()
    for file in (scene / "start/train/rgba").iterdir():
        (scene / "start/train/masks" / file.name).write_bytes(
            encoded(np.full((24, 24), 255, np.uint8)))


def float_depth(scene: Path) -> None:
    (scene / "depth.png").write_bytes(encoded(np.zeros((48, 48), np.uint8)))
    edit(lambda c: [f.update(depth_file_path="depth.png") for f in c["frames"]])(scene)


def yaml_bomb(scene: Path) -> None:
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join(f'*{a}' for _ in range(9))}]"
              for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    (scene / "scene.yaml").write_text("\n".join(lines))


CASES: dict[str, tuple[Break, tuple[str, ...]]] = {
    # the folder
    "empty folder": (empty_folder, ("no cameras found", "holds nothing", "transforms.json")),
    "one state missing": (remove(END), (END, "cannot be read")),
    "frames without one state": (
        lambda s: [(s / START).rename(s / "transforms.json"), (s / END).unlink()] and None,
        ("24 frames of state 0, 0 of state 1",)),
    "scene is a file": (lambda s: [shutil.rmtree(s), s.write_text("x")] and None,
                        ("is a file", "scene folder")),
    "scene does not exist": (lambda s: shutil.rmtree(s), ("is missing", "scene folder")),
    # camera files
    "json is not json": (text(START, "{'frames': ["), (START, "not valid JSON")),
    "json is empty": (text(START, ""), (START, "not valid JSON")),
    "json is a list": (text(START, "[1, 2]"), (START, "holds a list")),
    "json is not text": (data(START, b"\xff\xfe\x00\x01"), (START, "not valid JSON")),
    "json is nested too deeply": (text(START, "[" * 100_000), (START, "not valid JSON")),
    "json with a number of 5,000 digits": (
        lambda s: (s / START).write_text('{"camera_angle_x": ' + "9" * 5000 + "}") and None,
        (START, "not valid JSON")),
    "json with a number beyond float": (edit(lambda c: c.update(fl_x=10**400)),
                                        ("fl_x", "finite number")),
    "no frames": (edit(lambda c: c.pop("frames")), ("'frames' is missing",)),
    "frames is a number": (edit(lambda c: c.update(frames=3)), ("'frames' is missing",)),
    "a frame is a text": (edit(lambda c: c["frames"].append("x")), ("list of objects",)),
    "3 images": (edit(three_images), ("3 posed images", "at least 20")),
    "a frame twice": (edit(lambda c: c["frames"].append(c["frames"][0])),
                      ("more than one camera",)),
    "image without camera": (edit(lambda c: c["frames"].pop()),
                             ("1 of 24 images have no camera", "0023.png", "--allow-missing")),
    "frame without matrix": (edit(lambda c: c["frames"][3].pop("transform_matrix")),
                             ("1 of 24 frames have no camera", "0003.png")),
    "image file missing": (remove(FIRST), ("1 of 24 frames", "0000.png", "--allow-missing")),
    "no intrinsics": (edit(lambda c: c.pop("camera_angle_x")), ("no intrinsics", "fl_x")),
    "field of view of 4 rad": (edit(lambda c: c.update(camera_angle_x=4.0)), ("is 4", "pi")),
    "negative focal length": (edit(lambda c: c.update(fl_x=-50.0)), ("focal length is -50",)),
    "focal length is a text": (edit(lambda c: c.update(fl_x="wide")), ("fl_x is 'wide'",)),
    "focal length is a matrix": (edit(lambda c: c.update(fl_x=[[1, 2], [3, 4]])), ("fl_x",)),
    "principal point outside": (edit(lambda c: c.update(cx=500.0)), ("principal point is 500",)),
    "fisheye": (edit(lambda c: c.update(camera_model="OPENCV_FISHEYE")),
                ("OPENCV_FISHEYE is not supported", "undistort")),
    "fisheye by flag": (edit(lambda c: c.update(is_fisheye=True)), ("fisheye is not supported",)),
    "lens beyond any lens": (edit(lambda c: c.update(k1=1e30)), ("distortion", "below 100")),
    "focal lengths of two cameras": (edit(lambda c: c.update(fl_x=60, fl_y=600)),
                                     ("two similar numbers",)),
    "fourth radial coefficient": (edit_frame(k4=0.1), ("frame 3", "not supported")),
    "time of a third state": (edit_frame(time=2), ("frame 3", "time is '2'")),
    "other image size in json": (edit(lambda c: c.update(w=96, h=96)),
                                 ("camera says 96 x 96", "48 x 48")),
    # poses
    "NaN pose": (edit_pose(lambda m: m.__setitem__((0, 3), np.nan)), ("frame 3", "NaN")),
    "infinite pose": (edit_pose(lambda m: m.__setitem__((0, 3), np.inf)), ("infinity",)),
    "3 x 4 pose": (edit_frame(transform_matrix=np.eye(4)[:3].tolist()), ("shape (3, 4)", "4 x 4")),
    "ragged pose": (edit_frame(transform_matrix=[[1, 0], [0]]), ("transform_matrix has shape",)),
    "pose of words": (edit_frame(transform_matrix="here"), ("transform_matrix has shape",)),
    "singular pose": (edit_frame(transform_matrix=np.diag([0.0, 0, 0, 1]).tolist()),
                      ("not a rotation",)),
    "scaled pose": (edit_pose(lambda m: m.__imul__(2)), ("not a rotation", "remove scale")),
    "mirrored pose": (edit_frame(transform_matrix=np.diag([-1.0, 1, 1, 1]).tolist()),
                      ("determinant -1",)),
    "projective pose": (edit_pose(lambda m: m.__setitem__((3, 0), 1.0)), ("last row",)),
    "states in different frames": (edit(other_frame, END), ("not in one frame", "COLMAP")),
    "OpenCV axes": (edit(opencv_axes), ("contradict", "OpenGL axes")),
    "scattered cameras": (edit(scattered_cameras), ("contradict",)),
    # images
    "0-byte image": (data(FIRST, b""), ("0000.png", "0 bytes")),
    "text as image": (data(FIRST, b"not an image at all, just text"), ("not a PNG or JPEG",)),
    "header of 20,000 x 20,000": (data(FIRST, png_header(20_000, 20_000)),
                                  ("20000 x 20000", "8192")),
    "header of 8,000 x 8,000": (data(FIRST, png_header(8000, 8000)), ("megapixels",)),
    "header of no width": (data(FIRST, png_header(0, 48)), ("0 x 48",)),
    "header without pixels": (data(FIRST, png_header(48, 48)), ("cannot be decoded",)),
    "one larger image": (data(FIRST, encoded(np.zeros((96, 48, 4), np.uint8))),
                         ("48 x 96", "one size")),
    "black masks": (with_alpha(0), ("24 of 24 masks are empty",)),
    "full masks": (with_alpha(255), ("24 of 24 masks are full",)),
    "no masks": (all_images(lambda p: p[..., :3]), ("no alpha channel", "masks")),
    "masks of another size": (wrong_masks, ("mask is 24 x 24", "48 x 48")),
    "depth of 8 bits": (float_depth, ("depth image is uint8", "--no-depth")),
    "image folder in place of an image": (
        lambda s: [(s / FIRST).unlink(), (s / FIRST).mkdir()] and None, ("1 of 24 frames",)),
    # paths
    "path traversal": (edit_frame(file_path="../../../etc/passwd"), ("outside the scene",)),
    "path traversal by backslash": (edit_frame(file_path="..\\..\\secret.png"), ("outside",)),
    "absolute path": (edit_frame(file_path="/etc/passwd"), ("outside the scene",)),
    "symlink out": (symlink_out, ("outside the scene",)),
    "mask outside": (edit_frame(mask_path="../mask.png"), ("outside the scene",)),
    "path with NUL": (edit_frame(file_path="a\0b.png"), ("frame 3", "name of a file")),
    "path of 5,000 letters": (edit_frame(file_path="a" * 5000), ("frame 3", "name of a file")),
    "path is a number": (edit_frame(file_path=7), ("frame 3", "name of a file")),
    "path is a lone surrogate": (edit_frame(file_path="\ud800.png"), ("frame 3",)),
    # scene.yaml
    "unknown key in scene.yaml": (text("scene.yaml", "partz: 2"),
                                  ("unknown key 'partz'", "Nearest valid name: 'parts'")),
    "wrong value in scene.yaml": (text("scene.yaml", "parts: two"), ("parts is 'two'",)),
    "up of zeros in scene.yaml": (text("scene.yaml", "up: [0, 0, 0]"), ("up is [0, 0, 0]",)),
    "scene.yaml is a list": (text("scene.yaml", "- parts"), ("holds a list",)),
    "scene.yaml is not YAML": (text("scene.yaml", "parts: [1"), ("cannot be read as YAML",)),
    "scene.yaml with a tag": (text("scene.yaml", "parts: !!python/object:os.system x"),
                              ("cannot be read as YAML",)),
    "YAML bomb": (yaml_bomb, ("YAML alias",)),
    "scene.yaml of a megabyte": (text("scene.yaml", "# " + "x" * 10**6), ("more than 65536",)),
    # flags
    "--parts 0": (arguments("--parts", "0"), ("--parts is 0", "from 1 to 64")),
    "--parts two": (arguments("--parts", "two"), ("--parts is 'two'", "whole number")),
    "--preset best": (arguments("--preset", "best"), ("draft, standard, high",)),
    "--seed -1": (arguments("--seed", "-1"), ("--seed is -1",)),
    "--up 0 0 0": (arguments("--up", "0", "0", "0"), ("--up",)),
    "--up nan": (arguments("--up", "nan", "0", "1"), ("--up",)),
    "--max-side 1e9": (arguments("--max-side", "1e9"), ("--max-side",)),
    # --device cuda is refused where CUDA is missing only: test_device.py
    "--device gpu": (arguments("--device", "gpu"), ("--device is 'gpu'", "auto, cpu, cuda")),
    "unknown flag": (arguments("--partz", "2"), ("unknown flag --partz", "--parts")),
    "flag without value": (arguments("--parts"), ("--parts", "expected one argument")),
    "three scenes": (arguments("a", "b"), ("got 3 paths", "SCENE | PHOTOS_0 PHOTOS_1")),
    "photos that are not there": (arguments("another"), ("another: is missing", "video")),
}


def test_there_are_enough_cases() -> None:
    assert len(CASES) >= 30


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_refused(name: str, scene: Path, tmp_path: Path,
                              assert_refused: Callable[..., None]) -> None:
    breaking, fragments = CASES[name]
    words = breaking(scene) or []
    assert_refused(scene, fragments, *words, "-o", str(tmp_path / "out"))
