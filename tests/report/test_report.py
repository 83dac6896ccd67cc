"""The report says what the build found, loads nothing from outside and escapes every text."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from synth import toy_cabinet_twin

from part2gs_robotics.mesh.clearance import separate_pieces
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin
from part2gs_robotics.report.data import Picture, assumed_numbers, check_rows
from part2gs_robotics.report.figures import MAX_PICTURE_PX, curve_svg, png_uri
from part2gs_robotics.report.report_json import ReportData, write_report

HOSTILE = "<script>alert('x')</script> & \"quoted\" ünïcode 日本"


def mesh() -> PartMesh:
    return PartMesh(np.zeros((3, 3)), np.zeros((1, 3), np.int64), np.zeros((3, 3), np.uint8), 0.25)


def twin(name: str = "part_1", notes: tuple[str, ...] = ()) -> Twin:
    joint = Joint("revolute", np.array([0.0, 0.0, 1.0]), np.zeros(3), np.pi / 2, sigma_axis=0.01)
    door = Part(name, 0, mesh(), (mesh(),), joint, (0.0, 2.0), "assumed", 7, {"contact_loss": 0.5})
    return Twin("box", (Part("base", -1, mesh(), (), None), door), notes=notes)


def report(**changes: object) -> ReportData:
    photo = np.full((20, 30, 4), 200, np.uint8)
    data = ReportData(
        scene="box", layout="artgs", exit_code=1, twin=twin(),
        counts={"views": 40}, stage_seconds={"fit": 61.0},
        plan=(("depth term", False, "no depth images"),),
        curves=(("state 0", ((1.0, 20.0), (2.0, float("nan")), (3.0, 30.0))),),
        pictures=(Picture("state 0", 0, photo, photo[..., :3]),),
        checks={"reach": {"status": "pass", "value": 99.5, "limit": 99.0, "unit": "%"}},
    )  # fmt: skip
    return replace(data, **changes)


class Page(HTMLParser):
    """Collects tags, attributes and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.words = ""
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.links += [str(v) for k, v in attrs if k in ("src", "href", "srcset", "action", "data")]
        if tag not in ("meta", "img", "input"):
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data if self.open[-1:] != ["script"] else ""


def written(tmp_path: Path, data: ReportData) -> tuple[dict, Page]:
    write_report(tmp_path, data)
    text = (tmp_path / "report.html").read_text()
    return json.loads((tmp_path / "report.json").read_text()), Page(text)


def test_json_holds_the_contract(tmp_path: Path) -> None:
    content, _ = written(tmp_path, report())
    expected = {"version", "engines", "scene", "stage_seconds", "joints", "checks", "assumed"}
    assert expected <= set(content)
    assert content["exit_code"] == 1
    assert content["verdict"]["Found"] == "1 moving part: part_1 turns by 90.0°."
    assert content["engines"]["mujoco"][0].isdigit()
    joint = content["joints"][0]
    assert joint["type"] == "revolute"
    assert joint["value_state_1"] == pytest.approx(np.pi / 2)
    assert joint["sigma_axis_rad"] == 0.01


def test_numbers_that_are_not_finite_become_null(tmp_path: Path) -> None:
    content, _ = written(tmp_path, report())
    assert content["joints"][0]["sigma_origin"] is None
    assert content["curves"][0]["psnr_db"] == [20.0, None, 30.0]


def test_page_is_well_formed_and_loads_nothing(tmp_path: Path) -> None:
    _, page = written(tmp_path, report())
    assert page.open == []
    assert page.links
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not {"link", "iframe", "object", "a"} & set(page.tags)
    text = re.sub(r"<script>.*?</script>", "", (tmp_path / "report.html").read_text(), flags=re.S)
    assert "url(" not in text
    assert "http://" not in text
    assert "https://" not in text


@pytest.mark.parametrize(
    "changes",
    [
        {"scene": HOSTILE},
        {"layout": HOSTILE},
        {"twin": twin(name=HOSTILE)},
        {"twin": twin(notes=(HOSTILE,))},
        {"notes": (HOSTILE,)},
        {"assumed": (HOSTILE,)},
        {"plan": ((HOSTILE, True, HOSTILE),)},
        {"stage_seconds": {HOSTILE: 1.0}},
        {"counts": {HOSTILE: 1.0}},
        {"curves": ((HOSTILE, ((0.0, 1.0), (1.0, 2.0))),)},
        {"checks": {HOSTILE: {"status": "fail", "value": HOSTILE, "note": HOSTILE}}},
        {"pictures": (Picture(HOSTILE, 0, np.zeros((4, 4, 3), np.uint8),
                              np.zeros((4, 4, 3), np.uint8)),)},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_every_text_is_escaped(tmp_path: Path, changes: dict[str, object]) -> None:
    _, page = written(tmp_path, report(**changes))
    assert page.tags.count("script") == 3, "two of data, one of code"
    assert "alert('x')" in page.words
    assert page.open == []


def test_page_states_angles_in_degrees_with_their_error(tmp_path: Path) -> None:
    _, page = written(tmp_path, report())
    assert "90°" in page.words
    assert "± 0.57°" in page.words
    assert "built, checks fail" in page.words
    assert "no depth images" in page.words


def test_failures_are_listed_before_passes(tmp_path: Path) -> None:
    checks = {"a": {"status": "pass"}, "b": {"status": "fail"}, "c": {"status": "skipped"}}
    _, page = written(tmp_path, report(checks=checks))
    assert [t[:5] for t in page.words.split("measuredlimitnote")[1:]] == ["bfail", "apass"]


def test_a_long_list_of_passes_is_folded(tmp_path: Path) -> None:
    checks = {f"c{i}": {"status": "pass"} for i in range(40)} | {"bad": {"status": "fail"}}
    _, page = written(tmp_path, report(checks=checks))
    assert "40 checks passed" in page.words
    assert page.words.index("badfail") < page.words.index("40 checks passed")


def test_empty_report_is_still_a_page(tmp_path: Path) -> None:
    bare = ReportData("empty", "artgs", 0, Twin("empty", (Part("base", -1, mesh(), (), None),)))
    content, page = written(tmp_path, bare)
    assert content["joints"] == []
    assert page.open == []
    assert "none run" in page.words


def test_assumed_numbers_of_twin_yaml_are_listed(tmp_path: Path) -> None:
    density = {"value": 600.0, "source": "assumed", "note": "wood"}
    axis = {"value": [0.0, 0.0, 1.0], "source": "fitted", "note": ""}
    tree = {"parts": [{"name": "base", "density": density, "axis": axis}]}
    (tmp_path / "twin.yaml").write_text(yaml.safe_dump(tree))
    content, page = written(tmp_path, report(assumed=("up: +z",)))
    assert content["assumed"] == ["up: +z", "parts.base.density: 600 (wood)"]
    assert "parts.base.density" in page.words
    assert assumed_numbers(None) == ()


def test_sweeps_losses_and_notes_of_the_checks_are_shown(tmp_path: Path) -> None:
    curve = {
        "joint": "part_1_joint",
        "positions": [-0.5, 0.0, 1.0],
        "overlap_volume": [0.0, 0.0, 0.0],
        "overlap_depth": [0.0, 0.001, 0.0],
        "contact_depth": [0.0, 0.004, 0.0],
    }
    clean = curve | {"joint": "part_2_joint", "overlap_depth": [0.0], "contact_depth": [0.0]}
    clean["positions"] = [0.0]
    losses = [{"part": "part_1", "contact_loss": 0.25, "overlap": None}]
    checks = {
        "checks": [{"name": "reach: part_1", "status": "pass"}],
        "curves": [curve, clean], "losses": losses, "notes": ["<decimated>"],
    }  # fmt: skip
    _, page = written(tmp_path, report(checks=checks))
    assert "exact meshes" in page.words
    assert "position of part_1_joint" in page.words
    assert "part_2_joint: no overlap and no contact anywhere." in page.words
    assert "part_10.25—" in page.words
    assert "<decimated>" in page.words
    assert "reach: part_1pass" in page.words


def test_notes_added_after_articulation_are_listed(tmp_path: Path) -> None:
    """A drawer deep inside a solid base cannot be cut free: the report says so."""
    cabinet = toy_cabinet_twin(1)
    block = to_mesh(to_manifold(cabinet.parts[0].mesh).hull())
    parts = (replace(cabinet.parts[0], mesh=block, pieces=(block,)), *cabinet.parts[1:])
    stuck = separate_pieces(replace(cabinet, parts=parts, notes=("depth ignored",)))
    content, page = written(tmp_path, report(twin=stuck, notes=("base fixed", "depth ignored")))
    assert content["notes"][0] == "depth ignored"
    assert content["notes"][-1] == "base fixed"
    assert any("too deep to cut back: base and part_1" in note for note in content["notes"])
    listed = page.words.partition("Notes")[2]
    assert all(note in listed for note in content["notes"])


def test_checks_are_found_at_any_depth() -> None:
    checks = {
        "joints": [{"name": "door", "reach": {"status": "fail", "value": 1.5, "unit": "mm"}}],
        "compile": {"status": "pass", "files": {"status": "skipped"}},
        "other": {"status": "unknown word"},
    }
    rows = check_rows(checks)
    assert [r.name for r in rows] == ["joints · door · reach", "compile", "compile · files"]
    assert check_rows({"checks": [{"name": "a: b", "status": "pass"}]})[0].name == "a: b"
    assert rows[0].value == "1.5 mm"


def test_pictures_survive_and_are_bounded() -> None:
    rng = np.random.default_rng(0)
    small = rng.integers(0, 256, (12, 17, 3), dtype=np.uint8)
    data = base64.b64decode(png_uri(small).split(",")[1])
    read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read[..., ::-1], small)
    wide = png_uri(np.zeros((50, 3 * MAX_PICTURE_PX, 4), np.uint8))
    read = cv2.imdecode(np.frombuffer(base64.b64decode(wide.split(",")[1]), np.uint8), -1)
    assert max(read.shape[:2]) == MAX_PICTURE_PX


@pytest.mark.parametrize(("low", "high"), [(0.0, 1e-9), (20.0, 20.0), (-5.0, 40.0), (1e3, 1e6)])
def test_curve_stays_inside_its_frame(low: float, high: float) -> None:
    svg = curve_svg([("a", [(0.0, low), (0.0, high), (9.0, high)])], "s", "dB")
    numbers = re.search(r'points="([^"]*)"', svg)
    assert numbers is not None
    points = np.array([p.split(",") for p in numbers[1].split()], float)
    assert (points >= 0).all()
    assert (points <= [640, 260]).all()


def test_curve_without_points_is_left_out() -> None:
    assert curve_svg([], "s", "dB") == ""
    assert curve_svg([("a", [(1.0, float("nan"))])], "s", "dB") == ""
