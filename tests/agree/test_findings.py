"""Planted defects: each is found by the check meant for it, at the file at fault, in its words."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from synth import box, toy_cabinet_twin

from part2gs_robotics.agree import truth
from part2gs_robotics.agree.catalogue import CHECKS, check_id, explain
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.model.solids import to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.sim_checks import check
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult

BOTH = ("twin.xml", "twin_actuated.xml")
ROOT = Path(__file__).resolve().parents[2]


def cabinet(folder: Path, moving: int = 2) -> Path:
    twin = toy_cabinet_twin(moving)
    folder.mkdir()
    write_mjcf(twin, folder)
    write_urdf(twin, folder)
    write_twin_yaml(twin, folder)
    return folder


def edit(folder: Path, pattern: str, text: str, *names: str) -> Path:
    for name in names or BOTH:
        before = (folder / name).read_text()
        after = re.sub(pattern, text, before, count=1)
        assert after != before, name
        (folder / name).write_text(after)
    return folder


def rows(folder: Path, name: str) -> list[CheckResult]:
    report = check(folder, only=("files",))
    assert report.exit_code == 1
    return [r for r in report.results if r.name == name and r.status == "fail"]


def test_an_axis_turned_by_two_degrees_is_said_in_degrees(tmp_path: Path) -> None:
    turned = f"{-np.sin(np.deg2rad(2)):.9f} 0 {-np.cos(np.deg2rad(2)):.9f}"
    one, two = rows(edit(cabinet(tmp_path / "t"), 'axis="0 0 -1"', f'axis="{turned}"'),
                    "same joint")
    assert [one.subject, two.subject] == [f"{name}: part_2" for name in BOTH]
    assert "turned by 2 deg" in one.detail
    assert one.cause == "twin.xml: set its axis to 0 0 -1"


def test_a_shifted_pivot_is_measured(tmp_path: Path) -> None:
    (row,) = rows(edit(cabinet(tmp_path / "t"), 'pos="0.503 0 0.4"', 'pos="0.503 0.03 0.4"',
                       "twin.xml"), "same joint")
    assert "a line 0.03 units away" in row.detail
    assert "twin.yaml, twin_actuated.xml, scene.xml, twin.urdf say" in row.detail


def test_a_shift_along_the_axis_is_no_difference(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), 'pos="0.503 0 0.4" axis', 'pos="0.503 0 0.9" axis')
    assert check(folder, only=("files",)).exit_code == 0


def test_one_file_is_blamed_for_its_mass_and_what_to_write_is_said(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), 'mass value="2.592"', 'mass value="259.2"', "twin.urdf")
    (row,) = rows(folder, "same mass")
    assert row.subject == "twin.urdf: part_2"
    assert row.cause == "twin.urdf: correct mass of part_2 to 2.592, or build the twin again"


def test_masses_of_all_files_are_judged_by_the_mesh(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), 'mass="2.592"', 'mass="259.2"')
    edit(folder, 'mass value="2.592"', 'mass value="259.2"', "twin.urdf")
    edit(folder, r"value: 2\.592\d*\n", "value: 259.2\n", "twin.yaml")
    (row,) = rows(folder, "mass of mesh")
    assert row.subject == "twin.yaml: part_2"
    assert "weighs 2.592 kg" in row.detail


def test_a_mass_that_was_measured_stands_for_itself(tmp_path: Path) -> None:
    """Weighed: mass and inertia twice the assumed ones in all files."""
    import yaml

    folder = cabinet(tmp_path / "t", 1)
    tree = yaml.safe_load((folder / "twin.yaml").read_text())
    part = tree["parts"][1]
    inertia = np.array(part["inertia"]["value"]) * 2
    part["mass"] = {"value": 2 * part["mass"]["value"], "source": "measured", "note": "weighed"}
    part["inertia"]["value"] = inertia.tolist()
    (folder / "twin.yaml").write_text(yaml.safe_dump(tree))
    full = " ".join(f"{v:.10g}" for v in [*np.diag(inertia), 0, 0, 0])
    edit(folder, r'mass="7\.10\S*" fullinertia="[^"]*"', f'mass="14.2057728" fullinertia="{full}"')
    text = (folder / "twin.urdf").read_text()
    text = text.replace('value="7.1028864"', 'value="14.2057728"')
    for key, value in zip(("ixx", "iyy", "izz"), np.diag(inertia), strict=True):
        text = re.sub(rf'(name="part_1">.*?){key}="[^"]*"', rf'\g<1>{key}="{value:.10g}"', text,
                      count=1, flags=re.DOTALL)
    (folder / "twin.urdf").write_text(text)
    report = check(folder, only=("files",))
    assert [r for r in report.results if r.status == "fail"] == []


def test_an_exclude_that_hides_nothing_warns_and_one_that_hides_fails(tmp_path: Path) -> None:
    exclude = '<contact><exclude body1="base" body2="part_2"/></contact></mujoco>'
    folder = edit(cabinet(tmp_path / "t"), "</mujoco>", exclude)
    report = check(folder, only=("files",))
    assert report.exit_code == 0
    assert {r.status for r in report.results if r.name == "contact exclude"} == {"warn"}
    edit(folder, r'pos="0\.512 0\.3 0\.6" quat', 'pos="0.5 0.3 0.6" quat')
    near = rows(folder, "contact exclude")
    # the door's piece reaches from 0.491 to the board's front at 0.5
    assert near[0].value == pytest.approx(-0.009, abs=1e-4)


@pytest.mark.parametrize(("distance", "verdict"), [(0.02, "pass"), (0.3, "fail")])
def test_a_loose_bit_is_as_far_as_it_is(distance: float, verdict: str) -> None:
    whole, bit = box((0, 0, 0), (1, 1, 1)), box((1 + distance, 0, 0), (1.1 + distance, 0.1, 0.1))
    mesh = to_mesh(whole + bit)
    (row,) = truth.loose_bits(Twin("t", (Part("base", -1, mesh, (mesh,), None),)))
    size = float(np.linalg.norm([1.1 + distance, 1, 1]))
    far = min(distance, 3 * truth.LOOSE * size)
    assert (row.status, row.value) == (verdict, pytest.approx(far / size, rel=1e-6))


def test_a_bit_inside_another_part_is_not_loose() -> None:
    door = to_mesh(box((0, 0, 0), (1, 1, 0.1)) + box((0.5, 0.5, 0.2), (0.6, 0.6, 0.3)))
    other = to_mesh(box((0, 0, 0.31), (1, 1, 0.4)))
    parts = tuple(Part(n, -1, m, (m,), None) for n, m in (("base", door), ("part_1", other)))
    assert to_manifold(door).num_tri() == 24
    (row,) = truth.loose_bits(Twin("t", parts))
    assert row.status == "pass"


@pytest.mark.parametrize(("value", "said"), [("nan", "compile"), ("0", "compile"),
                                             ("0.02", "options")])
def test_a_time_step_that_is_none_is_a_row(tmp_path: Path, value: str, said: str) -> None:
    folder = edit(cabinet(tmp_path / "t"), r'timestep="[^"]*"', f'timestep="{value}"', "scene.xml")
    found = check(folder, only=("files", "actuation"))
    assert {r.subject for r in found.results if r.name == said and r.status == "fail"} == {
        "scene.xml"}


def test_a_shorter_time_step_is_nobodys_fault(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t"), r'timestep="[^"]*"', 'timestep="0.0005"', "scene.xml")
    assert check(folder, only=("files",)).exit_code == 0


def test_a_weak_servo_lets_the_lever_fall_from_where_it_is_held(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t", 3), r'forcerange="-0\.0\d+ 0\.0\d+"',
                  'forcerange="-0.001 0.001"', "twin_actuated.xml")
    edit(folder, r'frictionloss="0\.0059\d+"', 'frictionloss="0.0001"')
    report = check(folder, only=("stability",))
    fallen = [r for r in report.results if r.name == "hold" and r.status == "fail"]
    assert {r.subject for r in fallen} == {"part_3_joint"}
    assert any("from state_1, where its servo was to hold it" in r.detail for r in fallen)
    assert "raise kp and forcerange" in fallen[0].cause


def test_energy_is_looked_at_from_both_states(tmp_path: Path) -> None:
    """A stop put where the open drawer is pushes it out: nothing of it shows at state 0."""
    geom = ('<geom name="stop" type="box" size="0.02 0.1 0.1" pos="0.787 0.3 0.2" group="3" '
            'solref="0.004 0.1"/><body name="part_1">')
    folder = edit(cabinet(tmp_path / "t", 1), '<body name="part_1">', geom)
    row = next(r for r in check(folder, only=("stability",)).results if r.name == "passive")
    assert "let go at state_1" in row.detail


def full(folder: Path) -> CheckReport:
    return check(folder)


def test_every_row_is_explained_in_plain_words_and_on_the_page(tmp_path: Path) -> None:
    report, page = full(cabinet(tmp_path / "t", 1)), (ROOT / "docs/checks.md").read_text()
    assert {r.name for r in report.results} <= set(CHECKS)
    for name, said in CHECKS.items():
        text = explain(check_id(name))
        assert said.what in text
        assert said.change in text
        assert name == "actuation" or name in page or "files …" in page
    assert explain("gain x 100") == explain("gain-x-100")


def test_an_unknown_id_names_the_nearest() -> None:
    with pytest.raises(CheckError, match="Nearest: same-mass;"):
        explain("same-mas")


def test_a_failing_row_of_any_group_has_a_cause(tmp_path: Path) -> None:
    folder = edit(cabinet(tmp_path / "t", 1), 'kp="[^"]*"', 'kp="1"', "twin_actuated.xml")
    report = check(folder)
    bad = [r for r in report.results if r.status in ("fail", "incomplete")]
    assert {"reach", "same dynamics"} <= {r.name for r in bad}
    assert all(r.cause for r in bad)
