"""Depth images: found beside the photos or by name, in scene units, refused when unusable."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from part2gs_robotics.config import ReadConfig
from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.validate_depth import check_depth


def write_png(file: Path, pixels: np.ndarray[Any, Any]) -> None:
    file.write_bytes(np.asarray(cv2.imencode(".png", pixels)[1]).tobytes())


@pytest.mark.parametrize("size", [48, 24])
def test_depth_of_any_size_is_read_in_scene_units(scene: Path, size: int) -> None:
    file = scene / "transforms_train_start.json"
    content = json.loads(file.read_text())
    counts = np.full((size, size), 4000, np.uint16)
    counts[0, 0] = 0  # invalid
    write_png(scene / "depth.png", counts)
    for frame in content["frames"]:
        frame["depth_file_path"] = "depth.png"
    file.write_text(json.dumps(content))
    scene_read = read_scene(scene, ReadConfig())
    depths = scene_read.states[0].depths
    assert depths is not None
    assert np.isclose(depths[0, -1, -1], 4.0)
    assert depths[0, 0, 0] == 0
    assert scene_read.states[1].depths is None
    assert read_scene(scene, ReadConfig(depth=False)).states[0].depths is None


def write_depth(scene: Path, dtype: Any = np.uint16) -> None:
    """Add depth/ beside rgba/ of both states: 3900 + view everywhere."""
    for state in ("start", "end"):
        (scene / state / "train/depth").mkdir()
        for view, file in enumerate(sorted((scene / state / "train/rgba").iterdir())):
            counts = np.full((48, 48), 3900 + view).astype(dtype)
            write_png(scene / state / "train/depth" / file.name, counts)


def test_depth_folder_beside_artgs_photos_is_read(scene: Path) -> None:
    before = read_scene(scene, ReadConfig())
    assert before.states[0].depths is None
    write_depth(scene)
    after = read_scene(scene, ReadConfig())
    for old, new in zip(before.states, after.states, strict=True):
        assert new.depths is not None
        assert np.allclose(new.depths[:, 0, 0], 3.9 + 0.001 * np.arange(24))
        assert np.array_equal(old.images, new.images)
    assert read_scene(scene, ReadConfig(depth=False)).states[0].depths is None


def test_photos_without_depth_beside_others_are_named(scene: Path) -> None:
    write_depth(scene)
    for view in (3, 7):
        (scene / f"end/train/depth/{view:04d}.png").unlink()
    with pytest.raises(SceneError, match=r"depth: 2 of 24 images .*0003\.png.* --no-depth"):
        read_scene(scene, ReadConfig())
    assert read_scene(scene, ReadConfig(depth=False)).states[1].depths is None
    read = read_scene(scene, ReadConfig(allow_missing=True))
    assert read.states[1].depths is None
    assert any("depth ignored, 2 images have none" in note for note in read.notes)


@pytest.mark.parametrize("how", ["dtype", "text", "link"])
def test_unusable_depth_beside_artgs_photos_is_refused(scene: Path, how: str) -> None:
    write_depth(scene, np.uint8 if how == "dtype" else np.uint16)
    file = scene / "start/train/depth/0005.png"
    if how == "text":
        file.write_text("not an image")
    elif how == "link":
        outside = Path(shutil.move(file, scene.parent / "depth.png"))
        file.symlink_to(outside)
    want = {"dtype": "depth image is uint8", "text": "not a PNG", "link": "outside the scene"}
    with pytest.raises(SceneError, match=want[how]):
        read_scene(scene, ReadConfig())


def test_depth_of_another_unit_is_refused(scene: Path) -> None:
    write_depth(scene)
    for name in ("transforms_train_start.json", "transforms_train_end.json"):
        content = json.loads((scene / name).read_text()) | {"depth_unit_scale_factor": 2e-3}
        (scene / name).write_text(json.dumps(content))
    with pytest.raises(SceneError, match=r"state 0: \d+ % of the depth points.* --no-depth"):
        read_scene(scene, ReadConfig())
    assert read_scene(scene, ReadConfig(depth=False)).states[0].depths is None


def test_exact_depth_is_confirmed_by_every_mask_and_scaled_depth_is_not(toy: Any) -> None:
    boxes = [toy.Box((-0.4, -0.3, -0.2), (0.4, 0.3, 0.0)), toy.Box((0, -0.1, 0.0), (0.2, 0.2, 0.3))]
    state = toy.cast(boxes, *toy.cameras(16, 64, np.zeros(3), 1.2), 64)
    assert check_depth(state, "toy") > 0.99
    for scale in (0.1, 0.5, 0.85, 1.3, 2.0, 1000.0):
        wrong = replace(state, depths=(state.depths * scale).astype(np.float32))
        with pytest.raises(SceneError, match="toy: "):
            check_depth(wrong, "toy")


def test_views_without_any_depth_are_refused(toy: Any) -> None:
    cameras = toy.cameras(16, 32, np.full(3, 0.5), 1.8)
    state = toy.cast([toy.Box((0, 0, 0), (1, 1, 1))], *cameras, 32)
    with pytest.raises(SceneError, match="0 % of the depth points"):
        check_depth(replace(state, depths=np.zeros_like(state.depths)), "toy")
