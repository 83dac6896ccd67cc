"""What the page is given to draw: the twin's poses and surfaces, read by a reader of its own."""

from __future__ import annotations

import base64
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from random_twins import random_twin
from scipy.spatial.transform import Rotation
from synth import toy_cabinet_twin

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.kinematics import facing, moving_parts, part_transforms
from part2gs_robotics.model.twin import Texture, Twin
from part2gs_robotics.report import script
from part2gs_robotics.report.data import CheckRow, ReportData
from part2gs_robotics.report.report_json import write_report
from part2gs_robotics.report.scene_json import MOST_SPLATS, SOLID, scene_json
from part2gs_robotics.report.verdict import found, sure, to_do, wrong


def told(twin: Twin, **more: object) -> ReportData:
    return ReportData(twin.name, "artgs", 0, twin, **more)


def written(twin: Twin, folder: Path) -> dict:
    """Return the scene as it stands in a page."""
    write_report(folder, told(twin))
    text = (folder / "report.html").read_text()
    (inlined,) = re.findall(r'<script type="application/json" id="twin">(.*?)</script>', text)
    return json.loads(inlined)


def poses(scene: dict, positions: list[float]) -> list[np.ndarray]:
    """Return per part [4, 4] world_at_q_from_world_at_0 in the page's own words."""
    out, values = [], iter(positions)
    for part in scene["parts"]:
        move, joint = np.eye(4), part["joint"]
        if joint:
            q, axis, origin = next(values), np.array(joint["axis"]), np.array(joint["origin"])
            turn = 0.0 if joint["kind"] == "prismatic" else q
            slide = q if joint["kind"] == "prismatic" else joint["pitch"] * q
            move[:3, :3] = Rotation.from_rotvec(turn * axis).as_matrix()
            move[:3, 3] = origin - move[:3, :3] @ origin + slide * axis
        out.append(move if part["parent"] < 0 else out[part["parent"]] @ move)
    return out


def array(text: str, kind: str, width: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)


@pytest.mark.parametrize("twin", [toy_cabinet_twin(4), *map(random_twin, range(30))],
                         ids=lambda twin: f"{len(twin.parts)} parts")
def test_the_page_moves_parts_as_the_kinematics_do(twin: Twin, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    scene = written(twin, tmp_path)
    centre = np.array(scene["centre"])
    for _ in range(5):
        spans = [3.0 if twin.parts[i].joint.turns else scene["size"] for i in moving_parts(twin)]
        q = [float(span * rng.uniform(-1, 1)) for span in spans]
        for part, ours, theirs in zip(twin.parts, part_transforms(twin, q), poses(scene, q),
                                      strict=True):
            place = part.mesh.vertices @ ours[:3, :3].T + ours[:3, 3]
            seen = (part.mesh.vertices - centre) @ theirs[:3, :3].T + theirs[:3, 3] + centre
            np.testing.assert_allclose(seen, place, atol=1e-9 * (scene["size"] + abs(place).max()))


def test_surfaces_and_pieces_are_the_twins_own() -> None:
    twin = toy_cabinet_twin(2)
    rng = np.random.default_rng(0)
    mesh = twin.parts[1].mesh
    texture = Texture(rng.random((len(mesh.faces), 3, 2)).astype(np.float32),
                      rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
    parts = (twin.parts[0], replace(twin.parts[1], mesh=replace(mesh, texture=texture)))
    scene = scene_json(told(replace(twin, parts=parts)))
    for part, drawn in zip(parts, scene["parts"], strict=True):
        shapes = [(part.mesh, drawn["surface"]), *zip(part.pieces, drawn["pieces"], strict=True)]
        for own, shape in shapes:
            points = array(shape["points"], "<f4", 3)[array(shape["faces"], "<u4", 3)]
            np.testing.assert_allclose(points, own.vertices[own.faces] - scene["centre"], atol=1e-6)
    surface = scene["parts"][1]["surface"]
    uv = array(surface["uv"], "<u2", 2)[array(surface["faces"], "<u4", 3)] / 65535
    np.testing.assert_allclose(uv, texture.uv, atol=1e-5)
    assert surface["image"].startswith("data:image/jpeg;base64,")
    colors = array(scene["parts"][0]["surface"]["colors"], "u1", 3)
    np.testing.assert_array_equal(colors, parts[0].mesh.colors)


def test_of_many_gaussians_the_solid_ones_that_cover_most_are_shown() -> None:
    rng = np.random.default_rng(0)
    twin, count = toy_cabinet_twin(1), 30_000
    shares = tuple(Gaussians(rng.normal(size=(count, 3)).astype(np.float32),
                             np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
                             rng.normal(-4, 1, (count, 3)).astype(np.float32),
                             rng.normal(1, 1, count).astype(np.float32),
                             np.zeros((count, 3), np.float32), np.zeros((count, 0, 3), np.float32))
                   for _ in twin.parts)
    drawn = [part["splats"] for part in scene_json(told(twin, splats=shares))["parts"]]
    counts = [len(array(splats["points"], "<f4", 3)) for splats in drawn]
    assert sum(counts) == MOST_SPLATS
    solid = np.concatenate([np.sort(s.scales, 1)[s.opacities > SOLID, 1] for s in shares])
    shown = np.concatenate([array(splats["radius"], "<f4", 1) for splats in drawn])
    assert shown.mean() > 1.2 * solid.mean()
    assert scene_json(told(twin))["parts"][0]["splats"] is None


def test_the_first_view_is_from_where_parts_move_to() -> None:
    assert facing(toy_cabinet_twin(1))[0] > 0.8, "the drawer comes out along +x"
    assert np.isfinite(facing(Twin("one", toy_cabinet_twin(1).parts[:1]))).all()


def test_the_page_runs_its_own_script_alone(tmp_path: Path) -> None:
    write_report(tmp_path, told(toy_cabinet_twin(1)))
    text = (tmp_path / "report.html").read_text()
    assert script.policy(script.page_script()) in text
    assert "unsafe-eval" not in text
    assert "Permission is hereby granted, free of charge" in text, "the licence of three.js"


@pytest.mark.parametrize("text", ["</script>", "x = '</SCRIPT ' + y", "<!-- x"])
def test_a_script_that_would_end_its_element_is_refused(
        text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "viewer.js").write_text(text)
    monkeypatch.setattr(script.resources, "files", lambda package: tmp_path)
    with pytest.raises(ValueError, match=r"viewer\.js would end the element"):
        script.script("viewer.js")


def test_the_verdict_says_kind_size_and_carrier() -> None:
    twin = toy_cabinet_twin(4)
    assert found(twin) == ("4 moving parts: part_1 slides by 30 cm, part_2 turns by 68.8°, part_3 "
                           "turns by 28.6° on part_2, part_4 turns by 114.6° and rises by 2 cm.")
    assert found(Twin("one", twin.parts[:1])) == "Nothing that moves was found."
    more = (*twin.parts, replace(twin.parts[1], name="part_5"))
    assert found(replace(twin, parts=more)) == "5 moving parts: 2 slides, 2 hinges and 1 screw."
    assert "slides by 0.3 units" in found(replace(twin, meters_per_unit=None))


def test_the_verdict_says_what_is_unknown_wrong_and_next() -> None:
    twin = toy_cabinet_twin(2)
    joint = replace(twin.parts[2].joint, sigma_axis=0.01, sigma_value=0.02)
    lost = replace(twin.parts[1].joint, sigma_axis=float("inf"))
    known = replace(twin, parts=(twin.parts[0], replace(twin.parts[1], joint=lost),
                                 replace(twin.parts[2], joint=joint)))
    assert "axes ± 0.57°, turns ± 1.1°" in sure(told(known))
    assert "do not say how sure part_1 is" in sure(told(known))
    paid = [replace(p, diagnostics={"prices_saved": gap}) for p, gap in
            zip(twin.parts, (math.nan, 9.0, math.log(20)), strict=True)]
    assert "Without part_2, the least sure part" in sure(told(replace(twin, parts=tuple(paid))))
    assert "cost 3.0 prices" in sure(told(replace(twin, parts=tuple(paid))))
    assert "odds of 20 to 1" in sure(told(replace(twin, parts=tuple(paid))))
    bad = CheckRow("overlap: part_1", "fail", cause="part the pieces.")
    rows = (CheckRow("compile", "pass"), bad)
    assert wrong(told(twin), rows).startswith("1 of 2 checks do not pass: overlap: part_1.")
    assert to_do(told(twin), rows).startswith("Part the pieces. ")
    assert wrong(told(twin), rows[:1]) == "All 1 checks pass."
    assert "--known-length" in to_do(told(replace(twin, meters_per_unit=None)), rows[:1])
