"""The printed sheet is read back with its size, and gives photos their scale."""

from __future__ import annotations

import re

import cv2
import numpy as np
import photo_room as room
import pytest

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.photos import markers

DPI = 200


def printed(path) -> np.ndarray:
    """Return the sheet as a printer would put it on paper, one pixel per dot."""
    text = path.read_bytes().decode("ascii")
    page = np.full((round(11.69 * DPI), round(8.27 * DPI)), 255, np.uint8)
    for x, y, w, h in re.findall(r"([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re", text):
        left, low, right, top = (float(v) * DPI / 72 for v in (
            x, y, float(x) + float(w), float(y) + float(h)))
        page[round(len(page) - top):round(len(page) - low), round(left):round(right)] = 0
    return page


def test_the_sheet_holds_all_markers_at_their_size(tmp_path):
    markers.write_marker_sheet(tmp_path / "sheet.pdf")
    page = cv2.cvtColor(printed(tmp_path / "sheet.pdf"), cv2.COLOR_GRAY2RGB)
    seen = markers.find_markers([page], 1)
    assert set(seen) == {(1, n) for n in range(markers.COUNT)}
    for ((_, corners),) in seen.values():
        sides = np.linalg.norm(corners - np.roll(corners, 1, 0), axis=1) / DPI * 0.0254
        np.testing.assert_allclose(sides, markers.SIZE_M, rtol=0.01)


def test_the_sheet_is_a_whole_pdf_file(tmp_path):
    markers.write_marker_sheet(tmp_path / "sheet.pdf")
    data = (tmp_path / "sheet.pdf").read_bytes()
    table = int(re.findall(rb"startxref\n(\d+)", data)[0])
    assert data[table:].startswith(b"xref")
    for number, at in enumerate(re.findall(rb"(\d{10}) 00000 n", data[table:]), 1):
        assert data[int(at):].startswith(b"%d 0 obj" % number)


def test_another_ending_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"ends in \.pdf"):
        markers.write_marker_sheet(tmp_path / "sheet.png")


def seen_from(views: np.ndarray, unit: float, thin: float = 0.0, step: float = 0.08,
              ) -> markers.Seen:
    """Return exact corners of four markers of a sheet, in a scene of other units."""
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) / 2
    square *= (markers.SIZE_M - thin) / unit
    seen: markers.Seen = {}
    for number in range(4):
        corners = square + np.array([number % 2, -(number // 2), 0.0]) * step / unit
        for v, view in enumerate(views):
            local = corners @ view[:3, :3].T + view[:3, 3]
            pixels = (local @ room.K.T)[:, :2] / local[:, 2:]
            seen.setdefault((0, number), []).append((v, pixels))
    return seen


@pytest.mark.parametrize("unit", [0.01, 1.0, 37.0])
def test_scale_follows_the_unit_of_the_scene(unit):
    views = room.walk(8, 0)
    seen = seen_from(views, unit)
    found = markers.marker_scale(seen, room.K, (views, views))
    assert found is not None
    assert found.meters_per_unit == pytest.approx(unit, rel=1e-6)
    assert found.markers == 4


def test_edges_that_look_thinner_do_not_change_the_scale():
    views = room.walk(8, 0)
    found = markers.marker_scale(seen_from(views, 1.0, thin=0.002), room.K, (views, views))
    assert found is not None
    assert found.meters_per_unit == pytest.approx(1.0, rel=1e-6)


def test_markers_cut_apart_are_measured_one_by_one():
    views = room.walk(8, 0)
    found = markers.marker_scale(seen_from(views, 1.0, step=0.11), room.K, (views, views))
    assert found is not None
    assert found.meters_per_unit == pytest.approx(1.0, rel=1e-6)


def test_one_misread_marker_does_not_pull_and_two_sizes_are_refused():
    views = room.walk(8, 0)
    seen = seen_from(views, 1.0)
    wrong = seen_from(views, 0.7)
    one = seen | {(0, 3): wrong[0, 3]}
    found = markers.marker_scale(one, room.K, (views, views))
    assert found is not None
    assert found.meters_per_unit == pytest.approx(1.0, rel=1e-6)
    assert found.markers == 3
    third = seen_from(views, 1.4)
    mixed = {(0, 0): seen[0, 0], (0, 1): wrong[0, 1], (0, 2): third[0, 2]}
    assert markers.marker_scale(mixed, room.K, (views, views)) is None


def test_two_views_of_a_marker_are_too_few():
    views = room.walk(8, 0)
    few = {key: places[:2] for key, places in seen_from(views, 1.0).items()}
    assert markers.marker_scale(few, room.K, (views, views)) is None


def seen_flat(page: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Return what a camera [4, 4] sees of a page that lies on z = 0, its middle at the origin."""
    dot = 0.0254 / DPI
    world_from_page = np.array([[dot, 0, -page.shape[1] * dot / 2],
                                [0, -dot, page.shape[0] * dot / 2], [0, 0, 1.0]])
    flat = view[:3][:, [0, 1, 3]] @ world_from_page
    half = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1.0]])  # OpenCV counts from pixel centres
    picture = cv2.warpPerspective(page, half @ room.K @ flat @ np.linalg.inv(half), room.SIZE,
                                  flags=cv2.INTER_AREA, borderValue=120)
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    file = tmp_path_factory.mktemp("board") / "board.pdf"
    markers.write_marker_sheet(file, charuco=True)
    return cv2.GaussianBlur(printed(file), (0, 0), 2.0)


@pytest.mark.parametrize("unit", [1.0, 25.0])
def test_photos_of_the_printed_board_give_metres(board, unit):
    views = room.walk(8, 0, radius=0.6)
    photos = [seen_flat(board, view) for view in views]
    seen = markers.find_board(photos, 0)
    assert {number for _, number in seen} == set(range(6))
    views[:, :3, 3] /= unit  # the scene's own unit
    found = markers.board_scale(seen, room.K, (views, views))
    assert found is not None
    assert found.meters_per_unit == pytest.approx(unit, rel=0.003)
    assert found.source == "corners"
    larger = markers.board_scale(seen, room.K, (views, views), 1.1 * markers.SIZE_M)
    assert larger is not None
    assert larger.meters_per_unit == pytest.approx(1.1 * found.meters_per_unit)


def test_a_board_is_no_sheet_and_a_sheet_no_board(board, tmp_path):
    views = room.walk(4, 0, radius=0.6)
    assert not markers.find_markers([seen_flat(board, view) for view in views], 0)
    markers.write_marker_sheet(tmp_path / "sheet.pdf")
    sheet = cv2.GaussianBlur(printed(tmp_path / "sheet.pdf"), (0, 0), 2.0)
    assert not markers.find_board([seen_flat(sheet, view) for view in views], 0)


def test_corners_that_contradict_each_other_give_no_scale(board):
    views = room.walk(8, 0, radius=0.6)
    seen = markers.find_board([seen_flat(board, view) for view in views], 0)
    rng = np.random.default_rng(0)
    wrong = {key: [(v, rng.uniform(0, 300, 2)) for v, _ in places] for key, places in seen.items()}
    assert markers.board_scale(wrong, room.K, (views, views)) is None
    few = dict(list(seen.items())[:3])
    assert markers.board_scale(few, room.K, (views, views)) is None
