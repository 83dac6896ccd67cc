"""What checks say to machines: JSON, JUnit, SARIF 2.1.0, GitHub's annotations, a page."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import cast
from urllib.parse import quote

from part2gs_robotics import __version__
from part2gs_robotics.report.check_html import check_html
from part2gs_robotics.report.lines import Row, place

Tree = Mapping[str, object]
LEVELS = {"fail": "error", "incomplete": "error", "warn": "warning"}
SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
# Characters that XML 1.0 has no way to write.
UNWRITTEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def formatted(trees: Sequence[Tree], kind: str) -> str:
    """Return the reports of one or more assets in one of FORMATS.

    Args:
        trees: of `CheckReport.to_dict`.
        kind: json, junit, sarif, github or html.
    """
    return FORMATS[kind](trees)


def _rows(tree: Tree) -> list[Row]:
    return cast("list[Row]", tree["checks"])


def _said(row: Row) -> str:
    value = "" if row["value"] is None else f"{cast(float, row['value']):.4g}"
    limit = "" if row["limit"] is None else f" (limit {cast(float, row['limit']):.4g})"
    measured = f"{value}{limit} {row['unit']}".strip()
    cause = f"cause: {row['cause']}" if row["cause"] else ""
    return "; ".join(filter(None, (measured, str(row["note"]), cause)))


def _json(trees: Sequence[Tree]) -> str:
    """Return the report of one asset as it is, of several as a list."""
    return json.dumps(trees[0] if len(trees) == 1 else {"assets": list(trees)}, indent=1,
                      allow_nan=False)


def _junit(trees: Sequence[Tree]) -> str:
    counts = [_counts(_rows(tree)) for tree in trees]
    total = {key: str(sum(c[key] for c in counts)) for key in ("tests", "failures", "errors")}
    seconds = sum(cast(float, tree["seconds"]) for tree in trees)
    root = ET.Element("testsuites", {"name": "part2gs-robot check", **total,
                                     "time": f"{seconds:.3f}"})
    for tree, count in zip(trees, counts, strict=True):
        suite = ET.SubElement(root, "testsuite", {
            "name": _clean(str(tree["path"])), **{key: str(n) for key, n in count.items()},
            "time": f"{cast(float, tree['seconds']):.3f}"})
        for row in _rows(tree):
            _case(suite, row)
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode")


def _counts(rows: list[Row]) -> dict[str, int]:
    return {"tests": len(rows), "failures": sum(r["status"] == "fail" for r in rows),
            "errors": sum(r["status"] == "incomplete" for r in rows),
            "skipped": sum(r["status"] == "skipped" for r in rows)}


def _case(suite: ET.Element, row: Row) -> None:
    case = ET.SubElement(suite, "testcase", classname=str(row["id"]),
                         name=_clean(str(row["name"])), time="0")
    tag = {"fail": "failure", "incomplete": "error", "skipped": "skipped"}.get(str(row["status"]))
    said = _clean(_said(row))
    if tag:
        found = ET.SubElement(case, tag, message=said)
        found.text = None if tag == "skipped" else said
    elif row["status"] == "warn":
        ET.SubElement(case, "system-out").text = said


def _clean(text: str) -> str:
    return UNWRITTEN.sub("?", text)


def _sarif(trees: Sequence[Tree]) -> str:
    told = [(tree, row) for tree in trees for row in _rows(tree) if row["status"] in LEVELS]
    rules = sorted({str(row["id"]) for _, row in told})
    results = []
    for tree, row in told:
        file, line = _where(tree, row)
        where = {"artifactLocation": {"uri": _uri(file)}, "region": {"startLine": line}}
        results.append({"ruleId": row["id"], "ruleIndex": rules.index(str(row["id"])),
                        "level": LEVELS[str(row["status"])],
                        "message": {"text": f"{row['subject']}: {_said(row)}"},
                        "locations": [{"physicalLocation": where}]})
    driver = {"name": "part2gs-robot", "version": __version__,
              "rules": [{"id": rule} for rule in rules]}
    run = {"tool": {"driver": driver}, "results": results}
    return json.dumps({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=1)


def _where(tree: Tree, row: Row) -> tuple[Path, int]:
    """Return the file of a row as it is found from here, and the line."""
    path = Path(str(tree["path"]))
    file, line = place(tree, row)
    return (path if path.suffix else path / file), line


def _uri(file: Path) -> str:
    """Return a reference: relative ones are those that code scanning shows beside the file."""
    return file.as_uri() if file.is_absolute() else quote(file.as_posix())


def _github(trees: Sequence[Tree]) -> str:
    lines = []
    for tree in trees:
        for row in _rows(tree):
            if row["status"] in LEVELS:
                file, line = _where(tree, row)
                lines.append(f"::{LEVELS[str(row['status'])]} file={_escaped(str(file), ',:')},"
                             f"line={line},title={_escaped(str(row['name']), ',:')}"
                             f"::{_escaped(_said(row), '')}")
    return "\n".join(lines)


def _escaped(text: str, more: str) -> str:
    """Return text as GitHub reads it: percent codes for what ends a command or a property."""
    for char in "%\r\n" + more:
        text = text.replace(char, f"%{ord(char):02X}")
    return text


FORMATS: dict[str, Callable[[Sequence[Tree]], str]] = {
    "json": _json, "junit": _junit, "sarif": _sarif, "github": _github, "html": check_html}
