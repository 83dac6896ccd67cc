"""Printed markers and boards: sheets that give tables texture, and the scale that photos give."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.runtime.atomic import write_bytes_atomic

U8 = NDArray[np.uint8]

# Patterns of 6 x 6 cells differ in many; none was misread in 128 photos of patterned rooms.
DICTIONARY = cv2.aruco.DICT_6X6_50
COUNT, COLUMNS = 6, 2  # what fits on a page at the size below
SIZE_M = 0.060  # of a marker's black square: 20 px or more in a photo that shows 4 m
GAP_M = 0.020  # white between markers: they are found by their quiet border
PAGE_M = (0.210, 0.297)  # A4; cut off nothing on US letter, which is 18 mm shorter
POINTS_PER_M = 72 / 0.0254  # PDF counts in points
BOARD = 3, 4  # squares of the ChArUco board, as large as single markers: as far off is it found
BOARD_MARKER_M = 0.045  # in a white square of it: a border of 1.3 of its cells stays white
BOARD_FIRST = 6  # number of its first marker: those before are of the sheet
FEWEST_CORNERS = 4  # of the board's six: any four span two directions
FEWEST_VIEWS = 3  # of a marker: its corners are then seen twice more than they have unknowns
AGREE = 0.05  # relative: sides of a marker that differ more are misread, or the sheet moved
NORMAL = 0.6745  # median of a normal deviate's size: makes a deviation of it
EVENLY = 0.02  # relative spread of all sides: a scale that is worse is no better than a tape

Seen = dict[tuple[int, int], list[tuple[int, F64]]]
Box = tuple[float, float, float, float]  # left, low, width, height of a black cell, metres


@dataclass(frozen=True)
class MarkerScale:
    """Metres per scene unit, and what it is from.

    Attributes:
        meters_per_unit: true lengths on the sheet over those in the scene.
        markers: how many (marker, state) pairs it is from, or corners of the board.
        spread: relative standard deviation of what they say.
        source: what they are.
    """

    meters_per_unit: float
    markers: int
    spread: float
    source: str = "markers"


def find_markers(photos: Sequence[U8], state: int) -> Seen:
    """Return (state, marker) -> [(photo, corners [4, 2] in pixels)].

    Args:
        photos: [H, W, 3] uint8, undistorted.
        state: 0 or 1; a sheet may lie elsewhere in the other state.
    """
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(marker_dictionary(), options)
    seen: Seen = {}
    for index, photo in enumerate(photos):
        corners, numbers, _ = detector.detectMarkers(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY))
        for four, number in zip(corners, () if numbers is None else np.ravel(numbers), strict=True):
            if number < COUNT:  # OpenCV counts from pixel centres, we from their corners
                place = index, np.asarray(four, float).reshape(4, 2) + 0.5
                seen.setdefault((state, int(number)), []).append(place)
    return seen


def find_board(photos: Sequence[U8], state: int) -> Seen:
    """Return (state, corner) -> [(photo, [2] pixels)] of the ChArUco board's inner corners.

    Args:
        photos: [H, W, 3] uint8, undistorted.
        state: 0 or 1.
    """
    detector = cv2.aruco.CharucoDetector(charuco_board())
    seen: Seen = {}
    for index, photo in enumerate(photos):
        corners, numbers, _, _ = detector.detectBoard(cv2.cvtColor(photo, cv2.COLOR_RGB2GRAY))
        if numbers is None:
            continue
        for place, number in zip(np.reshape(corners, (-1, 2)), np.ravel(numbers), strict=True):
            seen.setdefault((state, int(number)), []).append((index, place.astype(float) + 0.5))
    return seen


def board_scale(seen: Seen, K: F64, viewmats: tuple[F64, F64], size_m: float = SIZE_M,
                ) -> MarkerScale | None:
    """Return the scale of the board's corners, None where too few are seen or they do not agree.

    Args:
        seen: corners of both states (`find_board`).
        K: [3, 3] pixels.
        viewmats: per state [V, 4, 4] camera_from_world.
        size_m: side of a black square, metres.
    """
    flat = np.asarray(charuco_board().getChessboardCorners()) * size_m / SIZE_M
    units: list[float] = []
    used = 0
    for state in (0, 1):
        placed = {number: _triangulated(np.stack([K @ viewmats[state][v][:3] for v, _ in places]),
                                        np.stack([pixel for _, pixel in places]))
                  for (where, number), places in seen.items()
                  if where == state and len(places) >= FEWEST_VIEWS}
        if len(placed) < FEWEST_CORNERS:
            continue
        used += len(placed)
        units += [float(np.linalg.norm(placed[a] - placed[b]) / np.linalg.norm(flat[a] - flat[b]))
                  for a, b in combinations(placed, 2)]
    if not used:
        return None
    middle = float(np.median(units))
    spread = float(np.median(np.abs(np.array(units) / middle - 1))) / NORMAL
    return MarkerScale(1 / middle, used, spread, "corners") if spread <= EVENLY else None


def charuco_board() -> cv2.aruco.CharucoBoard:
    """Return the board, in metres."""
    count = BOARD[0] * BOARD[1] // 2
    return cv2.aruco.CharucoBoard(BOARD, SIZE_M, BOARD_MARKER_M, marker_dictionary(),
                                  np.arange(BOARD_FIRST, BOARD_FIRST + count))


def marker_scale(seen: Seen, K: F64, viewmats: tuple[F64, F64], size_m: float = SIZE_M,
                 ) -> MarkerScale | None:
    """Return the scale that the markers agree on, None where too few are seen or they do not.

    Args:
        seen: markers of both states (`find_markers`).
        K: [3, 3] pixels.
        viewmats: per state [V, 4, 4] camera_from_world.
        size_m: side of the black square, metres.
    """
    placed = dict(_placed(seen, K, viewmats))
    if not placed:
        return None
    sides = {key: float(_edges(four).mean()) for key, four in placed.items()}
    side = float(np.median(list(sides.values())))
    kept = {key: placed[key] for key in sides if abs(sides[key] / side - 1) < AGREE}
    units = np.array([sides[key] for key in kept]) / size_m  # scene units per metre
    between = _between(kept) * SIZE_M / size_m
    if len(between) and abs(np.median(between) / units.mean() - 1) < AGREE:
        units = between  # edges of black look thinner in bright light, middles stay
    spread = float(units.std() / units.mean())
    if 2 * len(kept) < len(placed) or spread > EVENLY:
        return None
    return MarkerScale(1 / float(units.mean()), len(kept), spread)


def _placed(seen: Seen, K: F64, viewmats: tuple[F64, F64],
            ) -> Iterator[tuple[tuple[int, int], F64]]:
    """Yield (state, marker) and corners [4, 3] of every marker that its views place as a square."""
    for (state, number), places in seen.items():
        if len(places) < FEWEST_VIEWS:
            continue
        cameras = np.stack([K @ viewmats[state][v][:3] for v, _ in places])
        corners = np.stack([_triangulated(cameras, np.stack([four[k] for _, four in places]))
                            for k in range(4)])
        sides = _edges(corners)
        if np.ptp(sides) < AGREE * sides.mean():
            yield (state, number), corners


def _edges(corners: F64) -> F64:
    return np.asarray(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1))


def _between(placed: dict[tuple[int, int], F64]) -> F64:
    """Return scene units per metre between the middles of every two markers of one sheet."""
    step, out = SIZE_M + GAP_M, []
    for (state, one), first in placed.items():
        for (other, two), second in placed.items():
            if state == other and one < two:
                apart = step * np.hypot(one % COLUMNS - two % COLUMNS,
                                        one // COLUMNS - two // COLUMNS)
                out.append(np.linalg.norm(first.mean(0) - second.mean(0)) / apart)
    return np.array(out, float)


def _triangulated(cameras: F64, pixels: F64) -> F64:
    """Return the point [3] that projections [V, 3, 4] show at [V, 2], by linear least squares."""
    rows = (pixels[:, :, None] * cameras[:, 2:3, :] - cameras[:, :2, :]).reshape(-1, 4)
    rows = rows / np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
    point = np.linalg.svd(rows)[2][-1]
    return np.asarray(point[:3] / point[3])


def marker_dictionary() -> cv2.aruco.Dictionary:
    """Return the patterns of the sheet, numbered 0 to COUNT - 1."""
    return cv2.aruco.getPredefinedDictionary(DICTIONARY)


def marker_bits(number: int) -> NDArray[np.bool_]:
    """Return the cells [8, 8] of a marker with its black border, True = black."""
    pixels = cv2.aruco.generateImageMarker(marker_dictionary(), number, 8, borderBits=1)
    return np.asarray(pixels) < 128


def write_marker_sheet(path: Path, charuco: bool = False) -> None:
    """Write the sheet as a PDF page of A4.

    Args:
        path: file that ends in .pdf.
        charuco: one chessboard with markers in its white squares, instead of single markers.

    Raises:
        ConfigError: another ending.
        StoreError: the file cannot be written.
    """
    if path.suffix.lower() != ".pdf":
        raise ConfigError(f"marker: -o {path}. Expected a file that ends in .pdf; write "
                          "-o sheet.pdf.")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes_atomic(path, _pdf(_drawing(list(_board_cells() if charuco else _cells()))))


def _cells() -> Iterator[Box]:
    """Yield the black cells of the sheet's markers."""
    rows, step = COUNT // COLUMNS, SIZE_M + GAP_M
    left = (PAGE_M[0] - COLUMNS * SIZE_M - (COLUMNS - 1) * GAP_M) / 2
    top = (PAGE_M[1] + rows * SIZE_M + (rows - 1) * GAP_M) / 2
    for number in range(COUNT):
        yield from _marker(number, (left + number % COLUMNS * step, top - number // COLUMNS * step),
                           SIZE_M)


def _board_cells() -> Iterator[Box]:
    """Yield the black squares of the board, and the cells of the markers in white ones."""
    board = charuco_board()
    left, top = (PAGE_M[0] - BOARD[0] * SIZE_M) / 2, (PAGE_M[1] + BOARD[1] * SIZE_M) / 2
    black = {(x, y) for x in range(BOARD[0]) for y in range(BOARD[1])}
    for number, corners in zip(np.ravel(board.getIds()), board.getObjPoints(), strict=True):
        x, y = float(corners[0][0]), float(corners[0][1])  # upper left, y down
        black.discard((int(x / SIZE_M), int(y / SIZE_M)))
        yield from _marker(int(number), (left + x, top - y), BOARD_MARKER_M)
    for column, row in sorted(black):
        yield left + column * SIZE_M, top - (row + 1) * SIZE_M, SIZE_M, SIZE_M


def _marker(number: int, upper_left: tuple[float, float], side: float) -> Iterator[Box]:
    cell = side / 8
    for row, column in np.argwhere(marker_bits(number)):
        yield upper_left[0] + column * cell, upper_left[1] - (row + 1) * cell, cell, cell


def _drawing(cells: Sequence[Box]) -> str:
    """Return the page's drawing: black cells as rectangles, and how to print it."""
    out = ["0 g", *(" ".join(f"{v * POINTS_PER_M:.3f}" for v in box) + " re" for box in cells)]
    said = (f"Print at 100 % (no scaling), measure a black square: {1000 * SIZE_M:.0f} mm. "
            "Lay it flat beside the object, in both states at the same place.")
    out.append(f"f BT /F1 9 Tf {0.02 * POINTS_PER_M:.1f} {0.015 * POINTS_PER_M:.1f} Td "
               f"({said.replace('(', chr(92) + '(').replace(')', chr(92) + ')')}) Tj ET")
    return "\n".join(out)


def _pdf(drawing: str) -> bytes:
    """Return a PDF file of one page: five objects, where each begins, and the trailer."""
    width, height = (f"{side * POINTS_PER_M:.3f}" for side in PAGE_M)
    objects = [
        "<< /Type /Catalog /Pages 2 0 R >>",
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width} {height}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>",
        f"<< /Length {len(drawing)} >>\nstream\n{drawing}\nendstream",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"]
    out, begins = "%PDF-1.4\n", []
    for number, content in enumerate(objects, 1):
        begins.append(len(out))
        out += f"{number} 0 obj\n{content}\nendobj\n"
    table = "".join(f"{at:010d} 00000 n \n" for at in begins)
    end = f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{len(out)}\n%%EOF\n"
    return (out + f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n{table}" + end).encode("ascii")
