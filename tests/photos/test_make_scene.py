"""Masks and scenes from photos of a room whose cameras are known, and from photos alone."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import photo_room as room
import pytest

from part2gs_robotics.config_rooms import ReadConfig
from part2gs_robotics.errors import ConfigError, Part2GSError, SceneError
from part2gs_robotics.photos import make_scene as maker
from part2gs_robotics.photos import masks
from part2gs_robotics.photos.inspect_scene import inspect_scene
from part2gs_robotics.photos.masks import make_masks
from part2gs_robotics.photos.posed import Posed, eyes
from part2gs_robotics.photos.register import register
from part2gs_robotics.readers.read_scene import read_scene

COUNT = 20


@cache
def shots():
    return room.two_states(COUNT)


def known(names, views) -> Posed:
    """Return the true cameras with points of the table, the object and the room."""
    rng = np.random.default_rng(0)
    points = np.concatenate([np.c_[rng.uniform(-1, 1, (300, 2)), rng.normal(0, 0.002, 300)],
                             rng.uniform([-0.3, -0.2, 0.05], [0.3, 0.2, 0.4], (80, 3))])
    return Posed(room.K, 0.0, names, (views[0], views[1]), points,
                 np.ones((len(points), 2), bool), 0.001, 0.4)


def folders(tmp_path, photos):
    out = []
    for state in (0, 1):
        source = tmp_path / f"photos_{state}"
        source.mkdir()
        for n, rgb in enumerate(photos[state]):
            cv2.imwrite(str(source / f"IMG_{n:04d}.png"), rgb[..., ::-1])
        out.append(source)
    return out[0], out[1]


def overlap(mask: np.ndarray, truth: np.ndarray) -> float:
    return float(((mask > 127) & truth).sum() / ((mask > 127) | truth).sum())


@pytest.fixture
def registered(monkeypatch):
    """Put the true cameras, in another frame and unit, in the place of those of pycolmap."""
    move = np.eye(4)
    move[:3, :3] = cv2.Rodrigues(np.array([0.7, -0.2, 1.9]))[0]
    move[:3, 3] = [3, -1, 2]

    def true_cameras(folder, names, focal):
        return known((tuple(names[0]), tuple(names[1])), shots()[2]).moved(0.2, move)

    monkeypatch.setattr(maker, "register", true_cameras)
    monkeypatch.setattr(maker, "import_colmap", lambda: None)


@pytest.fixture(autouse=True)
def smaller(monkeypatch):
    """Look for masks in smaller pictures and coarser cells: a quarter of the time."""
    monkeypatch.setattr(masks, "SMALL", 280)
    monkeypatch.setattr(masks, "CELLS", 80)
    monkeypatch.setattr(masks, "ROUGH_CELLS", 48)


@pytest.mark.slow
def test_masks_cut_the_object_out_of_the_room():
    photos, truth, views = shots()
    names = tuple(tuple(f"{n}" for n in range(COUNT)) for _ in (0, 1))
    made = make_masks((photos[0], photos[1]), known(names, views))
    for state in (0, 1):
        scores = [overlap(m, t) for m, t in zip(made.masks[state], truth[state], strict=True)]
        assert np.mean(scores) > 0.96
        assert min(scores) > 0.8  # between an open part and the rest the shape of all is filled
        assert np.median(made.agree[state]) > 0.9
    low, high = made.box
    assert low[2] < 0.05
    assert 0.36 < high[2] < 0.46


def test_a_scene_is_written_that_the_reader_takes(tmp_path, registered):
    photos, truth, views = shots()
    made = maker.make_scene(folders(tmp_path, photos), tmp_path / "scene",
                            maker.Wishes(side=480, known_length=0.7))
    assert made.registered == made.taken == (COUNT, COUNT)
    assert made.scale is None
    scene = read_scene(tmp_path / "scene", ReadConfig(max_side=480))
    for state in (0, 1):
        scores = [overlap(m, t) for m, t in zip(scene.states[state].alphas, truth[state],
                                                strict=True)]
        assert np.mean(scores) > 0.95
        true, found = eyes(np.asarray(views[state])), eyes(scene.states[state].viewmats)
        heights = found[:, 2] / np.linalg.norm(found, axis=1)
        np.testing.assert_allclose(heights, true[:, 2] / np.linalg.norm(true, axis=1), atol=0.03)
    assert (tmp_path / "scene/scene.yaml").read_text() == "up: [0, 0, 1]\nknown_length: 0.7\n"
    told = inspect_scene(tmp_path / "scene")
    assert "380 points stayed" in " ".join(told.found)
    assert not [line for line in told.advice if "exposure" in line or "blurred" in line]


def test_given_masks_are_kept(tmp_path, registered):
    photos, truth, _ = shots()
    sources = folders(tmp_path, photos)
    for state, source in enumerate(sources):
        (source / "masks").mkdir()
        for n, mask in enumerate(truth[state]):
            cv2.imwrite(str(source / "masks" / f"IMG_{n:04d}.png"), 255 * mask.astype(np.uint8))
    made = maker.make_scene(sources, tmp_path / "scene", maker.Wishes(side=480))
    assert made.facts["masks"] == "given"
    written = cv2.imread(str(tmp_path / "scene/state_1/masks/IMG_0003.png"), 0)
    assert overlap(written, truth[1][3]) > 0.995


@pytest.mark.slow
def test_photos_alone_give_cameras_and_a_door_of_half_the_picture_does_not_pull(tmp_path):
    big = ((0.0, -0.03, 0.02), (0.9, 0.0, 0.75), room.DOOR[2], 0.9)
    plain = (*room.BODY[:3], 0.05)
    photos, _, views = room.two_states(24, plain, big, (0.3, 1.5))
    names = [[f"{n:02d}.png" for n in range(24)] for _ in (0, 1)]
    for state in (0, 1):
        (tmp_path / str(state)).mkdir()
        for n, rgb in enumerate(photos[state]):
            cv2.imwrite(str(tmp_path / str(state) / names[state][n]), rgb[..., ::-1])
    posed = register(tmp_path, (names[0], names[1]))
    assert sum(map(len, posed.names)) >= 46
    true = np.concatenate([eyes(views[s][[int(n[:2]) for n in posed.names[s]]]) for s in (0, 1)])
    from part2gs_robotics.photos.lock import carried, similarity

    found = eyes(posed.all_viewmats)
    off = true - carried(found, *similarity(true, found))
    assert np.median(np.linalg.norm(off, axis=1)) < 0.01
    assert np.abs(off[:len(posed.names[0])].mean(0)).max() < 0.005


@pytest.mark.slow
def test_walls_that_are_alike_are_told(tmp_path, monkeypatch, caplog):
    """Cameras among alike walls come out wrong; that must not happen without a word."""
    true = room._paint

    def paint(uv, base, contrast, which, face=None):
        alike = which >= 4  # the walls: one pattern, four times along each
        return true((uv * 4) % 1.0 if alike else uv, base, contrast, min(which, 4), face)

    monkeypatch.setattr(room, "_paint", paint)
    photos, _, _ = room.two_states(24)
    names = [[f"{n:02d}.png" for n in range(24)] for _ in (0, 1)]
    for state in (0, 1):
        (tmp_path / str(state)).mkdir()
        for n, rgb in enumerate(photos[state]):
            cv2.imwrite(str(tmp_path / str(state) / names[state][n]), rgb[..., ::-1])
    with caplog.at_level("WARNING", "part2gs_robotics"):
        register(tmp_path, (names[0], names[1]))
    assert "a pattern repeats" in caplog.text


def test_matches_of_the_cameras_own_motion_have_no_error():
    from part2gs_robotics.photos.register import epipolar_errors

    rng = np.random.default_rng(0)
    points = rng.uniform([-1, -1, 3], [1, 1, 6], (50, 3))
    move = np.eye(4)
    move[:3, :3], move[:3, 3] = cv2.Rodrigues(np.array([0.1, 0.4, -0.2]))[0], [0.5, 0.1, 0.2]
    other = points @ move[:3, :3].T + move[:3, 3]
    first, second = points[:, :2] / points[:, 2:], other[:, :2] / other[:, 2:]
    np.testing.assert_allclose(epipolar_errors(first, second, move), 0, atol=1e-12)
    shifted = second + np.array([0.0, 1e-3])
    off = epipolar_errors(first, shifted, move)
    assert (off < 1e-3).all(), "never more than the point is off"
    wrong = move.copy()
    wrong[:3, 3] = [-0.2, 0.5, 0.1]
    assert np.median(epipolar_errors(first, second, wrong)) > 0.01


@pytest.mark.parametrize(("wishes", "text"), [
    (maker.Wishes(side=100), "--side 100"),
    (maker.Wishes(frames=5), "--frames 5"),
    (maker.Wishes(known_length=-1.0), "--known-length -1"),
    (maker.Wishes(marker_m=float("nan")), "--marker-size nan"),
])  # fmt: skip
def test_numbers_that_make_no_sense_are_refused(tmp_path, wishes, text):
    with pytest.raises(ConfigError, match=text):
        maker.make_scene((tmp_path, tmp_path), tmp_path / "scene", wishes)
    assert not (tmp_path / "scene").exists()


def test_an_earlier_scene_is_never_touched(tmp_path):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene/mine").write_text("x")
    with pytest.raises(SceneError, match="not empty"):
        maker.make_scene((tmp_path, tmp_path), tmp_path / "scene")
    assert (tmp_path / "scene/mine").read_text() == "x"


def test_without_pycolmap_the_message_names_the_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(ConfigError, match="pip install"):
        maker.make_scene((tmp_path, tmp_path), tmp_path / "scene")


def test_a_failure_leaves_nothing_behind(tmp_path, registered, monkeypatch):
    photos, _, _ = shots()
    sources = folders(tmp_path, photos)

    def broken(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("part2gs_robotics.photos.write_scene._encoded", broken)
    for source in sources:
        (source / "masks").mkdir()
        for n in range(COUNT):
            cv2.imwrite(str(source / f"masks/IMG_{n:04d}.png"), np.full((360, 480), 255, np.uint8))
    with pytest.raises(Part2GSError, match="No space left"):
        maker.make_scene(sources, tmp_path / "scene", maker.Wishes(side=480))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["photos_0", "photos_1"]


def test_photos_turned_otherwise_are_left_out_or_refused(tmp_path, registered):
    photos, _, _ = shots()
    sources = folders(tmp_path, photos)
    for n in range(3):
        path = str(sources[1] / f"IMG_{n:04d}.png")
        cv2.imwrite(path, cv2.rotate(cv2.imread(path), cv2.ROTATE_90_CLOCKWISE))
    with pytest.raises(SceneError, match="17 of 20 photos are 480 x 360"):
        maker.make_scene(sources, tmp_path / "scene", maker.Wishes(side=480))


def test_moving_a_scene_moves_its_cameras():
    _, _, views = shots()
    posed = known(((), ()), views)
    moved = posed.moved(3.0, np.eye(4))
    np.testing.assert_allclose(eyes(moved.viewmats[0]), 3 * eyes(posed.viewmats[0]), atol=1e-12)
    assert replace(moved, apart=posed.apart).apart == posed.apart
