"""Reports for CI: each format is read back by another reader and says what the rows say."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import jsonschema
import pytest
import xmlschema

from part2gs_robotics import cli
from part2gs_robotics.report.ci import formatted
from part2gs_robotics.report.lines import place
from part2gs_robotics.sim_checks.result import CheckReport, CheckResult

SCHEMAS = Path(__file__).resolve().parents[1] / "schemas"
ROWS = (
    CheckResult("mesh", "base", "pass", detail="closed"),
    CheckResult("same mass", "twin.urdf: part_2", "fail", 99.0, 1e-6, "kg",
                'mass is "259" & more: 100 %\nof it\x07', "twin.urdf: correct mass of part_2"),
    CheckResult("overlap", "part_1_joint", "incomplete", detail="open mesh"),
    CheckResult("contact exclude", "twin.xml: base and part_2", "warn", detail="excluded"),
    CheckResult("gain x 100", "part_1_joint", "skipped", detail="our servo"),
)


@pytest.fixture
def tree(tmp_path: Path) -> dict[str, object]:
    (tmp_path / "twin.urdf").write_text(
        '<robot>\n<link name="base"/>\n<link name="part_2">\n<mass value="1"/>\n</link></robot>')
    (tmp_path / "twin.xml").write_text('<mujoco>\n\n\n<joint name="part_1_joint"/>\n</mujoco>')
    return CheckReport(str(tmp_path), "mujoco", ROWS, seconds=1.5).to_dict()


def test_junit_counts_and_quotes(tree: dict[str, object]) -> None:
    root = ET.fromstring(formatted([tree], "junit").encode())
    (suite,) = root
    assert root.tag == "testsuites"
    assert [suite.get(k) for k in ("tests", "failures", "errors", "skipped")] == list("5111")
    cases = {c.get("classname"): c for c in suite}
    assert cases["mesh"].find("*") is None
    assert '"259" & more' in (cases["same-mass"].find("failure").text or "")
    assert "cause: twin.urdf: correct mass" in cases["same-mass"].find("failure").get("message")
    assert cases["contact-exclude"].find("system-out") is not None


def test_sarif_names_rule_file_and_line(tree: dict[str, object]) -> None:
    run = json.loads(formatted([tree], "sarif"))
    assert run["version"] == "2.1.0"
    (run,) = run["runs"]
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    assert rules == ["contact-exclude", "overlap", "same-mass"]
    found = {}
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        where = result["locations"][0]["physicalLocation"]
        found[result["ruleId"]] = (result["level"], where["artifactLocation"]["uri"],
                                   where["region"]["startLine"])
    here = Path(str(tree["path"]))
    assert found["same-mass"] == ("error", (here / "twin.urdf").as_uri(), 4)
    assert found["overlap"] == ("error", (here / "twin.xml").as_uri(), 4)
    assert found["contact-exclude"][:2] == ("warning", (here / "twin.xml").as_uri())


def test_github_reads_one_command_a_line(tree: dict[str, object], tmp_path: Path) -> None:
    lines = formatted([tree], "github").splitlines()
    assert [line.partition(" ")[0] for line in lines] == ["::error", "::error", "::warning"]
    head, _, said = lines[0].removeprefix("::").partition("::")
    assert f"file={tmp_path}/twin.urdf,line=4,title=same mass%3A twin.urdf%3A part_2" in head
    assert "100 %25%0Aof it" in said


def test_the_command_line_speaks_it_and_keeps_its_exit_code(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "lid.xml"
    model.write_text("""<mujoco><worldbody><body name="lid"><joint name="j" range="0 0"
        limited="true"/><geom size=".1" mass="1"/></body></worldbody></mujoco>""")
    assert cli.main(["check", str(model), "--format", "sarif"]) == 1
    run = json.loads(capsys.readouterr().out)["runs"][0]
    assert {"compile"} == {result["ruleId"] for result in run["results"]}
    assert cli.main(["explain", "limits"]) == 0
    assert "range" in capsys.readouterr().out
    assert cli.main(["explain", "limitz"]) == 2


def test_junit_and_sarif_are_valid_by_their_schemas(tree: dict[str, object]) -> None:
    junit = xmlschema.XMLSchema(SCHEMAS / "junit-10.xsd")
    sarif = json.loads((SCHEMAS / "sarif-2.1.0.json").read_text())
    clean = tree | {"checks": [], "path": "a folder/twin"}
    for trees in ([tree], [clean], [tree, clean | {"seconds": 12345.678}], [tree | {
            "path": "twins/a b", "seconds": 1e-7}]):
        junit.validate(formatted(trees, "junit"))
        jsonschema.validate(json.loads(formatted(trees, "sarif")), sarif)
    broken = formatted([tree], "junit").replace(' name="mesh: base"', "")
    with pytest.raises(xmlschema.XMLSchemaValidationError):
        junit.validate(broken)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(json.loads(formatted([tree], "sarif").replace("startLine", "at")),
                            sarif)


def test_relative_paths_stay_relative_for_code_scanning(tree: dict[str, object]) -> None:
    run = json.loads(formatted([tree | {"path": "twins/my door"}], "sarif"))["runs"][0]
    uris = {r["locations"][0]["physicalLocation"]["artifactLocation"]["uri"]
            for r in run["results"]}
    assert uris == {"twins/my%20door/twin.urdf", "twins/my%20door/twin.xml"}


def test_the_page_is_whole_escapes_and_shows_failures_first(tree: dict[str, object]) -> None:
    page = formatted([tree, tree], "html")
    assert page.count("<section>") == 2
    assert page.index("same-mass") < page.index("contact-exclude") < page.index("closed")
    assert "&quot;259&quot; &amp; more" in page
    assert not re.search(r"(?:src|href)=|<script", page)


def test_several_assets_are_one_report(tree: dict[str, object]) -> None:
    trees = [tree, tree | {"path": "other"}]
    assert len(json.loads(formatted(trees, "json"))["assets"]) == 2
    root = ET.fromstring(formatted(trees, "junit"))
    assert [s.get("name") for s in root] == [tree["path"], "other"]
    assert root.get("tests") == "10"
    assert len(formatted(trees, "github").splitlines()) == 6


def test_json_is_the_whole_report(tree: dict[str, object]) -> None:
    assert json.loads(formatted([tree], "json"))["checks"][1]["id"] == "same-mass"


def test_a_row_about_nothing_stands_at_the_first_line(tree: dict[str, object]) -> None:
    row = CheckResult("passive", "", "fail").to_dict()
    assert place(tree, row) == ("twin.xml", 1)
    assert place(tree | {"path": "none/there.xml"}, ROWS[2].to_dict()) == ("there.xml", 1)
