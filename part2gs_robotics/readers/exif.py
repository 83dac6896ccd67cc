"""What a phone writes into a JPEG about its lens: the focal length, as EXIF 2.32 lays it out."""

from __future__ import annotations

import math
import struct

FILM_DIAGONAL_MM = 43.267  # of 36 x 24 mm film, which the 35 mm equivalent refers to (CIPA DC-008)
IFD_POINTER, FOCAL_35MM = 0x8769, 0xA405  # tags: where EXIF's own entries lie; the focal length
SHORT, LONG = 3, 4  # types of values
MOST_ENTRIES = 512  # of a directory: phones write below a hundred
SEEMLY_MM = (5.0, 1000.0)  # a fisheye's and a long telephoto's equivalent; outside is nonsense


def focal_35mm(head: bytes) -> float | None:
    """Return the focal length in 35 mm equivalent, millimetres; None where it is not said.

    Args:
        head: first bytes of a JPEG file.
    """
    body = _tiff(head)
    if body is None:
        return None
    order = {b"II": "<", b"MM": ">"}.get(body[:2])
    if order is None:
        return None
    try:
        start = struct.unpack_from(f"{order}I", body, 4)[0]
        pointer = _entry(body, order, start, IFD_POINTER)
        value = None if pointer is None else _entry(body, order, pointer, FOCAL_35MM)
    except struct.error:  # a torn header says nothing
        return None
    return float(value) if value and SEEMLY_MM[0] <= value <= SEEMLY_MM[1] else None


def focal_pixels(mm_35: float, size: tuple[int, int]) -> float:
    """Return the focal length in pixels of an image (width, height) that was not cropped."""
    return mm_35 * math.hypot(*size) / FILM_DIAGONAL_MM


def _tiff(head: bytes) -> bytes | None:
    """Return the TIFF structure in the JPEG's EXIF segment."""
    at = 2 if head.startswith(b"\xff\xd8") else len(head)
    while at + 4 <= len(head) and head[at] == 0xFF and head[at + 1] != 0xDA:
        length = struct.unpack_from(">H", head, at + 2)[0]
        if head[at + 1] == 0xE1 and head[at + 4:at + 10] == b"Exif\0\0":
            return head[at + 10:at + 2 + length]
        at += 2 + length
    return None


def _entry(body: bytes, order: str, start: int, tag: int) -> int | None:
    """Return the number that a directory holds under a tag."""
    count = min(struct.unpack_from(f"{order}H", body, start)[0], MOST_ENTRIES)
    for index in range(count):
        at = start + 2 + 12 * index
        found, kind = struct.unpack_from(f"{order}HH", body, at)
        if found == tag and kind in (SHORT, LONG):
            form = "H" if kind == SHORT else "I"
            return int(struct.unpack_from(order + form, body, at + 8)[0])
    return None
