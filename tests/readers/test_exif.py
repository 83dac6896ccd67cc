"""Focal lengths in JPEG headers written byte by byte, in both byte orders, torn, and absent."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from part2gs_robotics.photos.frames import read_photos
from part2gs_robotics.readers.exif import focal_35mm, focal_pixels


def jpeg(order: str = "<", focal: int | None = 26, orientation: int = 1,
         size: tuple[int, int] = (80, 60)) -> bytes:
    """Return a JPEG with an EXIF segment of orientation and 35 mm focal length.

    Args:
        order: < or >, the byte order of the segment.
        focal: millimetres, None = not said.
        orientation: as EXIF counts, 6 = turned by a quarter.
        size: width and height as stored.
    """
    pixels = np.random.default_rng(0).integers(0, 255, (size[1], size[0], 3), np.uint8)
    plain = cv2.imencode(".jpg", pixels)[1].tobytes()
    own = struct.pack(f"{order}H", 1) + struct.pack(f"{order}HHIHH", 0xA405, 3, 1, focal or 0, 0)
    own = struct.pack(f"{order}H", 0) if focal is None else own
    first = struct.pack(f"{order}H", 2)
    first += struct.pack(f"{order}HHIHH", 0x0112, 3, 1, orientation, 0)
    first += struct.pack(f"{order}HHII", 0x8769, 4, 1, 8 + 2 + 24 + 4) + bytes(4)
    tiff = (b"II" if order == "<" else b"MM") + struct.pack(f"{order}HI", 42, 8) + first + own
    body = b"Exif\0\0" + tiff + bytes(4)
    return plain[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + plain[2:]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("focal", [13, 26, 77])
def test_the_focal_length_is_read_in_both_byte_orders(order, focal):
    assert focal_35mm(jpeg(order, focal)) == focal


def test_film_of_36_mm_sees_as_wide_as_its_diagonal():
    # a photo of 3:2 has the shape of the film, so its width is 36 mm
    assert focal_pixels(36.0, (3000, 2000)) == pytest.approx(3000, rel=1e-3)


@pytest.mark.parametrize("head", [b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n" + bytes(40),
                                  jpeg(focal=None), jpeg(focal=0), jpeg(focal=60000)])
def test_nothing_is_read_where_nothing_is_said(head):
    assert focal_35mm(head) is None


def test_torn_and_twisted_headers_never_raise():
    whole, rng = jpeg(), np.random.default_rng(0)
    found = [focal_35mm(whole[:cut]) for cut in range(110)]
    for _ in range(2000):
        twisted = bytearray(whole[:120])
        for at in rng.integers(2, 120, 3):
            twisted[at] = rng.integers(256)
        found.append(focal_35mm(bytes(twisted)))
    assert all(one is None or 0 < one < np.inf for one in found)
    assert None in found


def test_photos_are_upright_and_know_their_focal_length(tmp_path):
    for n in range(20):
        (tmp_path / f"{n:02d}.jpg").write_bytes(jpeg(orientation=6))
    photos = read_photos(tmp_path, 20, 400)
    assert photos[0].rgb.shape == (80, 60, 3), "the phone was held upright"
    assert photos[0].focal == pytest.approx(focal_pixels(26, (60, 80)))
    small = read_photos(tmp_path, 20, 40)
    assert small[0].focal == pytest.approx(focal_pixels(26, (30, 40)))
