"""Files at the trust boundary: those of the scene alone, and of images the header before pixels."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.lenses import Lens

MAX_SIDE = 8192  # largest side of a phone photo today is about 8,000 px
MAX_PIXELS = 40_000_000  # 40 MP RGBA is 160 MB decoded: the most one image may cost
HEADER_BYTES = 1 << 20  # JPEG metadata before the size marker stays far below 1 MiB
MOST_BYTES = 8  # of a PNG's pixel: four channels of 16 bits
ENVELOPE = 1024  # bytes, of streams and blocks: a picture of one pixel takes a dozen
PACKED = 1.01  # of its raw pixels: what cannot be packed grows by less than 0.1 %
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
# JPEG markers that carry the frame size: SOF0..SOF15 without DHT (C4), JPG (C8) and DAC (CC)
SOF_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}

U8 = NDArray[np.uint8]


def inside(root: Path, base: Path, relative: object, where: str) -> Path:
    """Return base / relative with symlinks resolved, refused when it leaves the scene.

    Raises:
        SceneError: not a usable path, absolute, or outside `root`.
    """
    text = str(relative)
    try:
        path = (base / text.replace("\\", "/")).resolve()
        path.exists()  # raises for names the file system cannot hold
        usable = isinstance(relative, str) and bool(text)
    except (OSError, ValueError, RuntimeError):  # too long, NUL or lone surrogate, link loop
        usable, path = False, base
    if not usable:
        raise SceneError(f"{where}: path is {text[:60]!r}. Expected the name of a file in the "
                         "scene; correct the entry.")
    if Path(text).is_absolute() or not path.is_relative_to(root.resolve()):
        raise SceneError(f"{where}: {text[:120]!r} leads outside the scene folder. Expected a file "
                         f"inside {root}; copy the files into the scene.")
    return path


def own_file(path: Path, root: Path) -> None:
    """Refuse a camera or settings file that is a link out of the scene, or no file.

    Raises:
        SceneError: it is.
    """
    try:
        own = path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError):  # a loop of links
        own = False
    if not own:
        raise SceneError(f"{path}: is a link that leads outside the scene folder. Expected a file "
                         f"inside {root}; copy the files into the scene.")
    if path.exists() and not path.is_file():  # reading a pipe would wait for ever
        raise SceneError(f"{path}: is no file. Expected a plain file; copy it into the scene.")


def image_size(path: Path) -> tuple[int, int]:
    """Return (width, height) from the header alone, within the limits.

    Raises:
        SceneError: not a PNG or JPEG, truncated header, or larger than the limits.
    """
    try:
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror}). Expected a PNG or JPEG image; "
                         "check the file and its permissions.") from err
    size = _png_size(head) or _jpeg_size(head)
    if size is None:
        raise SceneError(f"{path}: {len(head)} bytes read, not a PNG or JPEG image. Expected a "
                         "complete PNG or JPEG file; export it again or remove it with its frame.")
    width, height = size
    if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
        raise SceneError(f"{path}: header says {width} x {height} pixels. Expected 1 to {MAX_SIDE} "
                         f"pixels a side and at most {MAX_PIXELS // 10**6} megapixels; "
                         "downscale the images before building.")
    return size


def _png_size(head: bytes) -> tuple[int, int] | None:
    if not head.startswith(PNG_SIGNATURE) or len(head) < 24 or head[12:16] != b"IHDR":
        return None
    width, height = struct.unpack(">II", head[16:24])
    return width, height


def _jpeg_size(head: bytes) -> tuple[int, int] | None:
    if not head.startswith(b"\xff\xd8"):
        return None
    at = 2
    while at + 9 <= len(head):
        if head[at] != 0xFF:
            return None
        marker = head[at + 1]
        if marker in SOF_MARKERS:
            height, width = struct.unpack(">HH", head[at + 5 : at + 9])
            return width, height
        if marker == 0xFF:  # fill byte
            at += 1
        elif 0xD0 <= marker <= 0xD9 or marker == 0x01:  # markers without a length
            at += 2
        else:
            at += 2 + struct.unpack(">H", head[at + 2 : at + 4])[0]
    return None


def decode(path: Path) -> NDArray[np.generic]:
    """Return the pixels as stored, [H, W] or [H, W, C] in BGR(A) order, 8 or 16 bit."""
    size, data = image_size(path), path.read_bytes()
    pixels = None
    if not _overfull(data, size):
        with suppress(cv2.error):
            pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise SceneError(f"{path}: the header is valid but the pixels cannot be decoded (truncated "
                         "or corrupt). Expected a complete PNG or JPEG file; export it again.")
    return np.asarray(pixels)


def _overfull(data: bytes, size: tuple[int, int]) -> bool:
    """Say whether a PNG packs more than its pixels can be: a bomb is inflated for seconds."""
    at, packed = len(PNG_SIGNATURE), 0
    while data.startswith(PNG_SIGNATURE) and at + 8 <= len(data):
        length = int.from_bytes(data[at:at + 4], "big")
        packed += length * (data[at + 4:at + 8] == b"IDAT")
        at += length + 12  # its length, name and checksum
    return packed > PACKED * size[1] * (MOST_BYTES * size[0] + 1) + ENVELOPE


def read_rgba(path: Path) -> tuple[U8, U8 | None]:
    """Return straight RGB [H, W, 3] and alpha [H, W], None when the file has no alpha."""
    pixels = _to_8_bit(decode(path))
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=2), None
    alpha = np.ascontiguousarray(pixels[..., 3]) if pixels.shape[2] == 4 else None
    return np.ascontiguousarray(pixels[..., 2::-1]), alpha


def read_mask(path: Path, size: tuple[int, int]) -> U8:
    """Return [H, W] uint8, 255 = object; must have the size (width, height) of its image."""
    pixels = _to_8_bit(decode(path))
    mask = pixels if pixels.ndim == 2 else pixels[..., :3].max(axis=2)
    if mask.shape != (size[1], size[0]):
        raise SceneError(f"{path}: mask is {mask.shape[1]} x {mask.shape[0]} pixels. Expected "
                         f"{size[0]} x {size[1]} as its image; export masks at the image's size.")
    return np.ascontiguousarray(mask)


def read_depth(path: Path, size: tuple[int, int]) -> NDArray[np.uint16]:
    """Return [H, W] z-depth in the counts of the file, 0 = invalid, resized to nearest.

    Args:
        path: 16-bit PNG.
        size: (width, height) wanted; depth images may have another resolution.
    """
    pixels = decode(path)
    if pixels.ndim != 2 or pixels.dtype != np.uint16:
        raise SceneError(f"{path}: depth image is {pixels.dtype} with shape {pixels.shape}. "
                         "Expected one 16-bit channel; export 16-bit PNG or use --no-depth.")
    return resize_nearest(np.asarray(pixels, np.uint16), size)


def _to_8_bit(pixels: NDArray[np.generic]) -> U8:
    if pixels.dtype == np.uint16:
        return np.asarray((pixels.astype(np.uint32) + 128) // 257, np.uint8)
    return np.asarray(pixels, np.uint8)


def resize_area(rgb: U8, alpha: U8, size: tuple[int, int]) -> tuple[U8, U8]:
    """Downscale to (width, height) with the area filter, colour weighted by alpha.

    Weighting keeps the colour hidden under alpha 0 out of the object's edge.
    """
    weight = alpha.astype(np.float32)
    small = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    color = cv2.resize(rgb * weight[..., None], size, interpolation=cv2.INTER_AREA)
    plain = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
    # below half a count of alpha the quotient is rounding noise: plain average there
    safe = np.where(small > 0.5, small, 1.0)[..., None]
    out = np.where(small[..., None] > 0.5, color / safe, plain)
    return _round_u8(out), _round_u8(small)


def resize_nearest(depth: NDArray[np.uint16], size: tuple[int, int]) -> NDArray[np.uint16]:
    """Resize depth to (width, height) without mixing depths across edges."""
    return np.asarray(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST), np.uint16)


class Undistorter:
    """Maps of one lens to a pinhole camera without invalid pixels."""

    def __init__(self, K: NDArray[np.float64], distortion: tuple[float, ...],
                 size: tuple[int, int], model: str | None = None) -> None:
        """Build the maps once.

        Args:
            K: [3, 3] pixels, pixel centres at +0.5.
            distortion: k1, k2, p1, p2, k3 in OpenCV's order, or those of the model.
            size: (width, height).
            model: a lens of COLMAP; None = OpenCV's.

        Raises:
            SceneError: no pinhole photo fits into what the lens shows.
        """
        if model is not None:
            lens = Lens(K, model, distortion)
            fitting = lens.fitting(size)
            if fitting is None:
                raise SceneError(f"camera model {model} with parameters {distortion}: no pinhole "
                                 "photo fits into it. Expected a lens of less than half a circle "
                                 "that does not fold; calibrate it again, or undistort the photos "
                                 "with COLMAP's image_undistorter.")
            self.K = fitting
            column, row = lens.maps(fitting, size)
            self._maps = column.astype(np.float32), row.astype(np.float32)
            return
        shift = np.zeros((3, 3))
        shift[:2, 2] = 0.5  # OpenCV counts from pixel centres at integers
        coefficients = np.array(distortion)
        new_K, _ = cv2.getOptimalNewCameraMatrix(K - shift, coefficients, size, 0.0)
        self.K = np.asarray(new_K, np.float64) + shift
        self._maps = cv2.initUndistortRectifyMap(K - shift, coefficients, np.eye(3), new_K, size,
                                                 cv2.CV_32FC1)

    def color(self, rgb: U8, alpha: U8) -> tuple[U8, U8]:
        """Return undistorted straight colour and alpha."""
        return self._remap(rgb, cv2.INTER_LINEAR), self.alone(alpha)

    def alone(self, alpha: U8) -> U8:
        """Return undistorted alpha."""
        return self._remap(alpha, cv2.INTER_LINEAR)

    def depth(self, depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Return undistorted depth, nearest sample: depths must not be mixed across edges."""
        return np.asarray(cv2.remap(depth, *self._maps, cv2.INTER_NEAREST), np.uint16)

    def _remap(self, pixels: U8, interpolation: int) -> U8:
        return np.asarray(cv2.remap(pixels, *self._maps, interpolation), np.uint8)


def _round_u8(values: NDArray[np.floating]) -> U8:
    return np.asarray(np.clip(np.rint(values), 0, 255), np.uint8)
