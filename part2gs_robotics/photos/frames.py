"""Photos of one state: a folder of images, or the sharpest frames of a video."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.exif import focal_35mm, focal_pixels
from part2gs_robotics.readers.image_files import HEADER_BYTES, image_size

U8 = NDArray[np.uint8]

IMAGES = frozenset({".jpg", ".jpeg", ".png"})
VIDEOS = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm"})
UNREADABLE = frozenset({".heic", ".heif", ".dng"})  # what phones write when nobody says otherwise
FEWEST = 20  # photos per state: what `build` needs
SHARP_SIDE = 640  # px that sharpness is measured at: noise of single pixels is averaged away


@dataclass(frozen=True)
class Photo:
    """A photo as it is used: upright, at most the side asked for.

    Attributes:
        name: of its file, or of the video's frame; unique within a state.
        rgb: [H, W, 3] uint8.
        mask: [H, W] uint8 given with it, 255 = object; None when none was.
        focal: pixels, as the phone wrote it; None where it did not.
    """

    name: str
    rgb: U8
    mask: U8 | None
    focal: float | None = None


def read_photos(source: Path, frames: int, side: int) -> list[Photo]:
    """Return the photos of one state in the order they were taken (by name).

    Args:
        source: folder of PNG or JPEG files (with alpha, or with masks in `masks/` below or
            beside it, if there are any), or a video file.
        frames: how many frames are taken from a video.
        side: longest side in pixels; larger photos are downscaled.

    Raises:
        SceneError: no photos, formats that cannot be read, or fewer than 20.
    """
    if source.is_file() and source.suffix.lower() in VIDEOS:
        photos = list(_video_frames(source, frames, side))
    elif source.is_dir():
        photos = _folder(source, side)
    else:
        found = "a file of another kind" if source.exists() else "missing"
        raise SceneError(f"{source}: is {found}. Expected a folder of photos or a video of one "
                         "state; give one per state.")
    if len(photos) < FEWEST:
        raise SceneError(f"{source}: {len(photos)} photos. Expected at least {FEWEST} of "
                         "one state, all around the object; take more (40 are comfortable).")
    return photos


def sharpness(rgb: U8) -> float:
    """Return the mean squared Laplacian at a common size: small where a photo is blurred."""
    gray = cv2.cvtColor(_within(rgb, SHARP_SIDE), cv2.COLOR_RGB2GRAY)
    return float(np.square(cv2.Laplacian(gray, cv2.CV_32F)).mean())


def _folder(source: Path, side: int) -> list[Photo]:
    files = sorted(f for f in source.iterdir() if f.is_file() and not f.name.startswith("."))
    foreign = [f.name for f in files if f.suffix.lower() in UNREADABLE]
    if foreign:
        raise SceneError(f"{source}: {len(foreign)} photos cannot be read ({foreign[0]}, ...). "
                         "Expected JPEG or PNG; set the phone to 'most compatible', or convert "
                         "them.")
    images = [f for f in files if f.suffix.lower() in IMAGES]
    if len({f.stem for f in images}) < len(images):
        twice = next(f.stem for f in images if sum(g.stem == f.stem for g in images) > 1)
        raise SceneError(f"{source}: {twice} is there twice, with two endings. Expected one file "
                         "per photo; remove the copies.")
    return [_photo(f, side) for f in images]


def _photo(file: Path, side: int) -> Photo:
    image_size(file)
    data = np.frombuffer(file.read_bytes(), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)  # turns the photo upright, as its header says
    if bgr is None:
        raise SceneError(f"{file}: the header is valid but the pixels cannot be decoded "
                         "(truncated or corrupt). Expected a complete photo; copy it again.")
    mask = _given_mask(file, data, (bgr.shape[1], bgr.shape[0]))
    small = None if mask is None else _within(mask, side)
    rgb = _within(np.ascontiguousarray(bgr[..., ::-1]), side)
    film = focal_35mm(data[:HEADER_BYTES].tobytes())
    focal = None if film is None else focal_pixels(film, (rgb.shape[1], rgb.shape[0]))
    return Photo(file.stem, rgb, small, focal)


def _given_mask(file: Path, data: U8, size: tuple[int, int]) -> U8 | None:
    """Return the mask in the alpha channel or in a masks folder below or beside the photos."""
    whole = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if file.suffix.lower() == ".png" else None
    if whole is not None and whole.ndim == 3 and whole.shape[2] == 4 and whole.dtype == np.uint8:
        alpha = np.ascontiguousarray(whole[..., 3])
        if int(alpha.min()) < 255:
            return alpha
    for folder in (file.parent / "masks", file.parent.parent / "masks" / file.parent.name):
        for name in (f"{file.stem}.png", f"{file.name}.png"):
            if (folder / name).is_file():
                return _read_mask(folder / name, size)
    return None


def _read_mask(file: Path, size: tuple[int, int]) -> U8:
    image_size(file)
    mask = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_GRAYSCALE)
    if mask is None or mask.shape != (size[1], size[0]):
        shape = "unreadable" if mask is None else f"{mask.shape[1]} x {mask.shape[0]} pixels"
        raise SceneError(f"{file}: mask is {shape}. Expected {size[0]} x {size[1]} "
                         "as its photo; export masks at the photo's size.")
    return np.asarray(mask, np.uint8)


def _video_frames(source: Path, frames: int, side: int) -> Iterator[Photo]:
    """Yield the sharpest frame of each of `frames` equal stretches of a video."""
    video = cv2.VideoCapture(str(source))
    total = int(video.get(cv2.CAP_PROP_FRAME_COUNT))
    if not video.isOpened() or total < frames:
        raise SceneError(f"{source}: {max(total, 0)} frames can be read. Expected a video of at "
                         f"least {frames} frames; record a slow walk round the object, or lower "
                         "--frames.")
    best: tuple[float, int, U8] | None = None
    for number in range(total):
        good, bgr = video.read()
        if good:
            rgb = np.asarray(np.ascontiguousarray(bgr[..., ::-1]), np.uint8)
            score = sharpness(rgb)
            if best is None or score > best[0]:
                best = score, number, rgb
        if (number + 1) * frames // total > number * frames // total and best is not None:
            yield Photo(f"frame_{best[1]:06d}", _within(best[2], side), None)
            best = None
    video.release()


def _within(pixels: U8, side: int) -> U8:
    scale = side / max(pixels.shape[:2])
    if scale >= 1:
        return pixels
    size = (round(pixels.shape[1] * scale), round(pixels.shape[0] * scale))
    return np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
