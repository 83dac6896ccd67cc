"""Folders and videos: what is read, what is refused, and the sharpest frames."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from part2gs_robotics.errors import SceneError
from part2gs_robotics.photos import frames


def picture(seed: int, size=(64, 48)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, (size[1], size[0], 3)).astype(np.uint8)


def folder(path, count=20, ending=".jpg", channels=3):
    path.mkdir(parents=True)
    for n in range(count):
        pixels = picture(n)
        if channels == 4:
            alpha = np.zeros(pixels.shape[:2], np.uint8)
            alpha[10:30, 10:40] = 255
            pixels = np.dstack([pixels, alpha])
        cv2.imwrite(str(path / f"IMG_{n:04d}{ending}"), pixels)
    return path


def test_photos_come_in_order_and_within_the_side(tmp_path):
    photos = frames.read_photos(folder(tmp_path / "a"), 40, 32)
    assert [p.name for p in photos] == [f"IMG_{n:04d}" for n in range(20)]
    assert {p.rgb.shape for p in photos} == {(24, 32, 3)}
    assert all(p.mask is None for p in photos)


def test_alpha_and_mask_folders_are_masks(tmp_path):
    by_alpha = frames.read_photos(folder(tmp_path / "a", ending=".png", channels=4), 40, 64)
    source = folder(tmp_path / "b")
    (source / "masks").mkdir()
    for n, photo in enumerate(by_alpha):
        cv2.imwrite(str(source / "masks" / f"IMG_{n:04d}.png"), photo.mask)
    for a, b in zip(by_alpha, frames.read_photos(source, 40, 64), strict=True):
        np.testing.assert_array_equal(a.mask, b.mask)
        assert a.mask.sum() == 255 * 20 * 30


def test_a_turned_photo_is_put_upright(tmp_path):
    source = folder(tmp_path / "a", 19)
    good, data = cv2.imencode(".jpg", picture(5))
    assert good
    turned = (b"\xff\xe1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0"
              b"\0\x01\0\x06\0\0\0\0\0\0")
    (source / "IMG_0019.jpg").write_bytes(data.tobytes()[:2] + turned + data.tobytes()[2:])
    assert frames.read_photos(source, 40, 64)[-1].rgb.shape == (64, 48, 3)


@pytest.mark.parametrize(("spoil", "text"), [
    (lambda s: [f.unlink() for f in sorted(s.iterdir())[:3]], "17 photos"),
    (lambda s: (s / "IMG_9.HEIC").write_bytes(b"x"), "cannot be read"),
    (lambda s: (s / "IMG_0000.png").write_bytes(b"x"), "twice"),
    (lambda s: (s / "IMG_0003.jpg").write_bytes(b"no image"), "not a PNG or JPEG"),
    (lambda s: (s / "IMG_0003.jpg").write_bytes((s / "IMG_0001.jpg").read_bytes()[:330]),
     "IMG_0003"),
])  # fmt: skip
def test_what_cannot_be_used_is_refused_with_what_to_do(tmp_path, spoil, text):
    source = folder(tmp_path / "a")
    spoil(source)
    with pytest.raises(SceneError, match=text) as told:
        frames.read_photos(source, 40, 64)
    assert str(source) in str(told.value)
    assert "Expected" in str(told.value)


@pytest.mark.parametrize("name", ["nothing", "a.txt"])
def test_neither_folder_nor_video_is_refused(tmp_path, name):
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(SceneError, match="Expected a folder of photos or a video"):
        frames.read_photos(tmp_path / name, 40, 64)


def test_a_mask_of_another_size_is_refused(tmp_path):
    source = folder(tmp_path / "a")
    (source / "masks").mkdir()
    cv2.imwrite(str(source / "masks" / "IMG_0002.png"), np.zeros((5, 5), np.uint8))
    with pytest.raises(SceneError, match="mask is 5 x 5 pixels"):
        frames.read_photos(source, 40, 64)


def test_of_a_video_the_sharp_frames_are_taken(tmp_path):
    path = tmp_path / "walk.avi"
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for n in range(60):
        frame = picture(n)
        video.write(frame if n % 3 == 1 else cv2.blur(frame, (9, 9)))
    video.release()
    photos = frames.read_photos(path, 20, 64)
    assert [p.name for p in photos] == [f"frame_{3 * n + 1:06d}" for n in range(20)]
    with pytest.raises(SceneError, match="60 frames can be read"):
        frames.read_photos(path, 80, 64)


def test_blur_lowers_sharpness():
    sharp = picture(0, (640, 480))
    values = [frames.sharpness(cv2.GaussianBlur(sharp, (0, 0), s)) for s in (0.5, 1, 2, 4)]
    assert values == sorted(values, reverse=True)
