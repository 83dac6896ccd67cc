"""Measures of exported shapes against closed forms: pieces, surfaces, stops, grips, the tables."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import manifold3d
import numpy as np
import pytest
from synth import toy_cabinet_twin, union_part

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import Twin

BOX = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))
GREY = (120, 120, 120)
KEYS = {"psnr_db": 30.04, "ssim": 0.95, "mask_iou": 0.99, "rough": 0.1, "rough_perfect": 0.08,
        "far_seen": 0.01, "triangles": 900, "most_pieces": 40, "reach": 0.999}


@pytest.fixture
def measures(load):
    return load("geometry_measures")


@pytest.fixture
def stops(load):
    return load("geometry_stops")


def corners(*boxes):
    """The triangles of some boxes, [T, 3, 3]."""
    meshes = [to_mesh(manifold3d.Manifold.cube([b - a for a, b in zip(*box, strict=True)])
                      .translate(list(box[0]))) for box in boxes]
    return np.concatenate([mesh.vertices[mesh.faces] for mesh in meshes])


def test_a_box_that_is_its_own_piece_has_no_phantom_and_misses_nothing(measures):
    row = measures.piece_row(union_part("base", -1, [BOX], None, (0.0, 0.0), GREY), np.sqrt(14))
    assert row["volume"] == pytest.approx(6.0)
    assert row["phantom"] == pytest.approx(0.0, abs=1e-9)
    assert row["missing"] == pytest.approx(0.0, abs=1e-9)
    assert max(row["out"], row["in"]) < 1e-3, "near an edge, the other side's triangle may be taken"


def test_pieces_too_large_and_too_few_are_counted(measures):
    part = union_part("base", -1, [((0, 0, 0), (1, 1, 1)), ((2, 0, 0), (3, 1, 1))], None, (0, 0),
                      GREY)
    tall = union_part("base", -1, [((0, 0, 0), (1, 1, 1.5))], None, (0, 0), GREY).pieces
    case = SimpleNamespace(name="toy", twin=Twin("toy", (
        type(part)("base", -1, part.mesh, tall, None),)))
    found = measures.pieces(case)
    assert found["phantom"] == pytest.approx(0.25)
    assert found["missing"] == pytest.approx(0.5)
    size = np.sqrt(9 + 1 + 1)
    assert found["out"] == pytest.approx(0.5 / size, rel=1e-6)
    assert found["in"] == pytest.approx(2.0 / size, rel=1e-6), "the second box is 2 away"
    assert (found["most_pieces"], found["most_vertices"]) == (1, 8)


def test_surface_that_is_shifted_too_far_is_counted_and_what_nobody_saw_apart(measures):
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), faces
    half = np.random.default_rng(0).random((20_000, 3)) * [0.5, 1.0, 0.0]  # seen where x < 0.5
    for height, far in ((0.02, 0.0), (0.04, 1.0)):
        shifted = square[0] + [0, 0, height], square[1]
        everything, bad, seen, bad_seen = measures.far_counts(shifted, square, half, 1.0)
        assert bad / everything == far
        assert seen / everything == pytest.approx(0.5 + measures.SEEN, abs=0.02)
        assert bad_seen == far * seen


def test_distances_to_a_surface_are_exact(load):
    mesh = to_mesh(manifold3d.Manifold.cube([1.0, 1.0, 1.0]))
    points = np.array([[0.5, 0.5, 1.25], [2.0, 0.5, 0.5], [0.5, 0.5, 0.4], [2.0, 2.0, 0.3]])
    found = load("geometry_kit").Surface(mesh.vertices, mesh.faces).distances(points)
    np.testing.assert_allclose(found, [0.25, 1.0, 0.4, np.sqrt(2)], atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_blade_stops_where_it_meets_a_pillar(stops, sign):
    blade = corners(((0.2, -0.01, 0.0), (1.0, 0.01, 0.3)))
    pillar = corners(((-0.1, 0.5, 0.0), (0.0, 0.7, 0.3)), ((0.5, -0.7, 0.0), (0.7, -0.6, 0.3)))
    (found,) = stops.meeting(blade, pillar, sign, 2.0)
    # Half of its thickness before a right angle; its lower edge at the corner (0.7, -0.6).
    edge = np.rad2deg(np.arcsin(0.01 / 0.5))
    up, down = 90 - edge, np.rad2deg(np.arctan2(0.6, 0.7) - np.arcsin(0.01 / np.hypot(0.6, 0.7)))
    assert found == pytest.approx(up if sign > 0 else down, abs=0.7)


def test_what_touches_already_and_what_never_meets_are_no_stops(stops):
    leaf = corners(((0.05, -0.01, 0.0), (1.0, 0.01, 0.3)))
    far = corners(((3.0, -1.0, 0.0), (4.0, 1.0, 0.3)))
    assert stops.meeting(leaf, far, 1, 2.0) == [np.inf]
    touching = corners(((0.05, -0.02, 0.0), (1.0, -0.01, 0.3)))
    assert stops.meeting(leaf, touching, 1, 2.0)[0] > 300, "only after almost a full turn"


def test_the_data_set_tells_a_stop_where_its_meshes_show_it(stops):
    one = {"joint": "j", "end": 0, "sharp": True, "room": 120.0, "found": 9.0}
    assert stops.Stop(limit=8.0, mesh=8.9, **one).error == pytest.approx(1.0)
    alone = stops.Stop(limit=40.0, mesh=8.9, **one)
    assert (alone.kind, alone.error) == ("mesh", pytest.approx(0.1))
    for limit, mesh in ((8.0, np.inf), (8.0, 130.0), (0.0, 0.2)):
        assert stops.Stop(limit=limit, mesh=mesh, **one).kind is None
    assert stops.Stop(limit=40.0, mesh=8.9, **(one | {"sharp": False})).kind is None


@pytest.mark.parametrize(("value", "limits"), [(0.5, (-0.1, 0.9)), (-0.5, (-0.9, 0.1))])
def test_ways_beyond_the_states_do_not_ask_which_way_a_joint_counts(stops, value, limits):
    joint = Joint("revolute", np.array([0.0, 0.0, 1.0]), np.zeros(3), value)
    twin = Twin("toy", (union_part("base", -1, [BOX], None, (0, 0), GREY),
                        union_part("part_1", 0, [BOX], joint, limits, GREY)))
    np.testing.assert_allclose(stops.derived(twin, "part_1"), np.rad2deg([0.1, 0.4]))
    assert stops.derived(twin, None) is None


def test_a_part_is_pulled_open_and_no_farther_than_its_slide_goes(load):
    grips = load("geometry_grips")
    drawer = toy_cabinet_twin(1).parts[1]
    twin = Twin("toy", (drawer,))
    limit = drawer.limits[1] if drawer.joint.value >= 0 else -drawer.limits[0]
    assert grips.asked(twin, drawer.name, 0.1) == pytest.approx(0.09 * limit)
    turned = grips.opening(union_part("p", 0, [BOX], Joint(
        "revolute", np.array([0.0, 0.0, 1.0]), np.zeros(3), -0.5), (-0.9, 0.1), GREY))
    assert turned.joint.value == 0.5
    assert turned.limits == (-0.1, 0.9)
    assert turned.joint.axis[2] == -1.0


def test_a_measure_that_fails_is_left_out_and_said(load, capsys):
    kit = load("geometry_kit")
    assert kit.attempt("toy: pieces", lambda: 1 / 0) is None
    assert "toy: pieces: ZeroDivisionError" in capsys.readouterr().err


def test_tables_have_a_row_per_object_and_say_what_is_missing(load):
    row = KEYS | {"object": "own", "commit": "abc", "stops": [
        {"joint": "j", "end": 1, "kind": "limit", "limit": 8.0, "mesh": 8.2, "found": 9.0,
         "error": 1.0}]}
    text = load("geometry_tables").markdown({"rows": [row], "objects": ["own", "other"]})
    assert "| PSNR, dB | 30.0 | 30.0 | ≥ 28 | 1 of 1 |" in text
    assert "| pieces of a part | 40 | 40 | ≤ 32 each | 0 of 1 |" in text
    assert "shown by its meshes | 1 of 1 |" in text
    assert "| own | j | 1 | data set and meshes | 8.0 | 8.2 | 9.0 | 1.0 |" in text
    assert "Not measured: other." in text
    assert load("geometry").plain({"a": np.float64(0.1234567), "b": [np.nan, True]}) == {
        "a": 0.12346, "b": [None, True]}


def test_without_numbers_it_says_what_to_give(load, tmp_path, monkeypatch, capsys):
    module = load("geometry")
    monkeypatch.setattr(module, "RESULTS", tmp_path / "none.json")
    monkeypatch.setattr(sys, "argv", ["geometry.py"])
    assert module.main() == 2
    assert "--kit" in capsys.readouterr().err


def test_a_figure_has_photo_and_twins_above_one_another(load, tmp_path, monkeypatch, capsys):
    module = load("looks_figure")
    size, name = 40, next(iter(module.SHOWN))
    strip = np.full((2 * size, 6 * size, 3), 255, np.uint8)
    strip[10:30, 10:-10] = (200, 30, 30)
    for folder, colour in (("old", (30, 30, 200)), ("new", (30, 200, 30))):
        (tmp_path / folder).mkdir()
        strip[size + 10:size + 30] = colour
        module.cv2.imwrite(str(tmp_path / folder / f"{name}.png"), strip)
    out = tmp_path / "looks.png"
    monkeypatch.setattr(sys, "argv", ["looks_figure.py", "--pictures", str(tmp_path / "new"),
                                      "--before", str(tmp_path / "old"), "--out", str(out)])
    assert module.main() == 0
    made, width = module.cv2.imread(str(out)), module.WIDTHS[0]
    assert made.shape == (3 * width + 2 * module.MARGIN, width, 3)
    for k, strongest in enumerate((0, 2, 1)):
        middle = made[k * (width + module.MARGIN) + width // 2, width // 2]
        assert int(np.argmax(middle)) == strongest
    assert "no picture" in capsys.readouterr().err
