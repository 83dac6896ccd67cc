"""COLMAP's cameras and images, text and binary: little-endian, packed, counts checked first.

Format: colmap.github.io/format.html. Points are not read; rigs and frames files are not needed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.lenses import COUNTS, LENSES
from part2gs_robotics.readers.nerfstudio import MAX_FRAMES

MAX_BYTES = 1 << 30  # 10,000 photos of 4,000 points each
MAX_NAME = 1024  # bytes of an image's name
POINT_BYTES = 24  # of a keypoint as the format has it: x, y and the id of its point
MAX_LINE = 16 << 20  # keypoints of a photo in text: 10,000 are half a megabyte


@dataclass(frozen=True)
class ColmapCamera:
    """A camera: COLMAP's model, size (width, height) and parameters."""

    model: str
    size: tuple[int, int]
    params: tuple[float, ...]


@dataclass(frozen=True)
class ColmapImage:
    """An image: its name, the camera's id, and camera_from_world as q (wxyz) and t."""

    name: str
    camera: int
    q: tuple[float, ...]
    t: tuple[float, ...]


def read_cameras(folder: Path) -> dict[int, ColmapCamera]:
    """Return the cameras by id, from cameras.bin or cameras.txt.

    Raises:
        SceneError: torn, unknown model, or counts that cannot be.
    """
    binary = folder / "cameras.bin"
    found = dict(_cameras_bin(binary) if binary.is_file() else _cameras_txt(folder / "cameras.txt"))
    if not found:
        raise SceneError(f"{folder}: 0 cameras. Expected at least one in cameras.bin or "
                         "cameras.txt; export the model again.")
    return found


def read_images(folder: Path) -> list[ColmapImage]:
    """Return the posed images, from images.bin or images.txt.

    Raises:
        SceneError: torn, numbers that are none, or counts that cannot be.
    """
    binary = folder / "images.bin"
    images = list(_images_bin(binary) if binary.is_file() else _images_txt(folder / "images.txt"))
    if len(images) > MAX_FRAMES:
        raise SceneError(f"{folder}: {len(images)} images. Expected at most {MAX_FRAMES}; keep the "
                         "sharpest photos of each state.")
    return images


class _Bytes:
    """A binary file read in order; nothing is allocated that the file does not hold."""

    def __init__(self, path: Path) -> None:
        self.path, self.at = path, 0
        self.data = _contents(path)

    def take(self, form: str) -> tuple[int | float, ...]:
        """Return the next numbers of a struct format."""
        size = struct.calcsize("<" + form)
        if self.at + size > len(self.data):
            raise self.torn()
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += size
        return values

    def count(self, least: int) -> int:
        """Return the next uint64, a count of things of at least so many bytes."""
        number = int(self.take("Q")[0])
        if number * least > len(self.data) - self.at:
            raise SceneError(f"{self.path}: says it holds {number} entries at byte {self.at - 8}, "
                             f"{len(self.data) - self.at} bytes are left. Expected a whole file of "
                             "COLMAP; copy or export it again.")
        return number

    def name(self) -> str:
        """Return the next text up to a NUL."""
        end = self.data.find(b"\0", self.at, self.at + MAX_NAME + 1)
        if end < 0:
            raise self.torn()
        text = self.data[self.at:end]
        self.at = end + 1
        return text.decode("utf-8", "replace")

    def torn(self) -> SceneError:
        return SceneError(f"{self.path}: ends in the middle of an entry at byte {self.at}, or a "
                          "name is endless. Expected a whole file of COLMAP; copy or export it "
                          "again.")


def _contents(path: Path) -> bytes:
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise SceneError(f"{path}: {size} bytes. Expected at most {MAX_BYTES} bytes of "
                             "camera data; check that this is a COLMAP model.")
        return path.read_bytes()
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror}). Expected the cameras of the "
                         "scene in this file; check that it exists and is readable.") from err


def _cameras_bin(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    file, models = _Bytes(path), tuple(LENSES)
    for _ in range(file.count(struct.calcsize("<iiQQ"))):
        number, model, width, height = map(int, file.take("iiQQ"))
        if not 0 <= model < len(models):
            raise _unknown(f"{path}: camera {number}", str(model))
        params = file.take(f"{COUNTS[models[model]]}d")
        yield number, _camera(f"{path}: camera {number}", models[model], (width, height), params)


def _cameras_txt(path: Path) -> Iterator[tuple[int, ColmapCamera]]:
    for number, line in _lines(path):
        words = line.split()
        if not words:
            continue
        where = f"{path}:{number}"
        model = words[1] if len(words) > 1 else ""
        if model not in LENSES:
            raise _unknown(where, model)
        try:
            key, size = int(words[0]), (int(words[2]), int(words[3]))
            params = tuple(map(float, words[4:]))
        except (ValueError, IndexError, OverflowError) as err:
            raise _bad_line(where, line, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS") from err
        if len(params) != COUNTS[model]:
            raise _bad_line(where, line, f"{COUNTS[model]} parameters of {model}")
        yield key, _camera(where, model, size, params)


def _camera(where: str, model: str, size: tuple[int, int],
            params: tuple[int | float, ...]) -> ColmapCamera:
    if not all(map(math.isfinite, params)):
        raise SceneError(f"{where}: parameters are {params}. Expected finite numbers; export the "
                         "model again.")
    return ColmapCamera(model, size, tuple(map(float, params)))


def _images_bin(path: Path) -> Iterator[ColmapImage]:
    file = _Bytes(path)
    for _ in range(file.count(struct.calcsize("<i7di") + 9)):
        _, *pose = file.take("i7d")
        camera = int(file.take("i")[0])
        name = file.name()
        keypoints = file.count(POINT_BYTES)
        file.at += POINT_BYTES * keypoints
        yield ColmapImage(name, camera, tuple(map(float, pose[:4])), tuple(map(float, pose[4:])))


def _images_txt(path: Path) -> Iterator[ColmapImage]:
    """Every image has two lines; the second, its keypoints, may be empty."""
    keypoints = False
    for number, line in _lines(path):
        if keypoints or not line.strip():
            keypoints = False
            continue
        words = line.rstrip("\r\n").split(maxsplit=9)
        try:
            pose, camera, name = tuple(map(float, words[1:8])), int(words[8]), words[9]
        except (ValueError, IndexError, OverflowError) as err:
            raise _bad_line(f"{path}:{number}", line,
                            "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME") from err
        keypoints = True
        yield ColmapImage(name.rstrip(), camera, pose[:4], pose[4:])


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and text of the lines that are no comments."""
    data, at, number = _contents(path), 0, 0
    while at < len(data):
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        number += 1
        if end - at > MAX_LINE:
            raise SceneError(f"{path}:{number}: line of {end - at} bytes. Expected a text file of "
                             "COLMAP; export the model again.")
        line = data[at:end].decode("utf-8", "replace")
        if not line.startswith("#"):
            yield number, line
        at = end + 1


def _unknown(where: str, model: str) -> SceneError:
    return SceneError(f"{where}: camera model {model[:40]!r} is not supported. Expected one of "
                      f"{', '.join(LENSES)}; undistort the photos first with COLMAP's "
                      "image_undistorter.")


def _bad_line(where: str, line: str, wanted: str) -> SceneError:
    return SceneError(f"{where}: {line.strip()[:60]!r} cannot be read. Expected {wanted}; export "
                      "the model again.")
