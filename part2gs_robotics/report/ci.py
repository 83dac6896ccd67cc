"""What a check says, for machines that run it: JSON, JUnit, SARIF 2.1.0, GitHub's annotations."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import cast

Row = Mapping[str, object]
BAD = ("fail", "incomplete")
LEVELS = {"fail": "error", "incomplete": "error", "warn": "warning"}
FILE = re.compile(r"[\w./-]+\.(?:xml|urdf|yaml|obj|mtl|sdf|glb|usd)\b")
SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
# Characters that XML 1.0 has no way to write.
UNWRITTEN = re.compile(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
MOST_BYTES = 1 << 20  # of a file that is searched for a line; longer ones hold numbers


def formatted(tree: Mapping[str, object], kind: str) -> str:
    """Return a report in one of FORMATS.

    Args:
        tree: of `CheckReport.to_dict`.
        kind: json, junit, sarif or github.
    """
    return FORMATS[kind](tree)


def _rows(tree: Mapping[str, object]) -> list[Row]:
    return cast("list[Row]", tree["checks"])


def _said(row: Row) -> str:
    value = "" if row["value"] is None else f"{cast(float, row['value']):.4g}"
    limit = "" if row["limit"] is None else f" (limit {cast(float, row['limit']):.4g})"
    measured = f"{value}{limit} {row['unit']}".strip()
    cause = f"cause: {row['cause']}" if row["cause"] else ""
    return "; ".join(filter(None, (measured, str(row["note"]), cause)))


def place(tree: Mapping[str, object], row: Row) -> tuple[str, int]:
    """Return the file a row is about, from the checked folder, and the line of its part or joint.

    The first line that names the part; 1 where there is none.
    """
    path = Path(str(tree["path"]))
    text = f"{row['subject']} {row['cause']}"
    found = FILE.search(text)
    name = path.name if path.suffix else found[0] if found else "twin.xml"
    file = path if path.suffix else path / name
    wanted = str(row["subject"]).rpartition(" ")[2]
    try:
        if not wanted or file.stat().st_size > MOST_BYTES:
            return name, 1
        lines = file.read_text("utf-8", "replace").splitlines()
    except OSError:
        return name, 1
    quoted = re.compile(rf"""["': ]{re.escape(wanted)}(?:["'\s]|$)""")
    return name, next((i for i, line in enumerate(lines, 1) if quoted.search(line)), 1)


def _json(tree: Mapping[str, object]) -> str:
    return json.dumps(tree, indent=1, allow_nan=False)


def _junit(tree: Mapping[str, object]) -> str:
    rows = _rows(tree)
    count = {"tests": len(rows), "failures": sum(r["status"] == "fail" for r in rows),
             "errors": sum(r["status"] == "incomplete" for r in rows),
             "skipped": sum(r["status"] == "skipped" for r in rows)}
    totals = {key: str(n) for key, n in count.items()} | {"time": str(tree["seconds"])}
    root = ET.Element("testsuites", {"name": "part2gs-robot check", **totals})
    suite = ET.SubElement(root, "testsuite", {"name": _clean(str(tree["path"])), **totals})
    for row in rows:
        case = ET.SubElement(suite, "testcase", classname=str(row["id"]),
                             name=_clean(str(row["name"])), time="0")
        tag = {"fail": "failure", "incomplete": "error", "skipped": "skipped"}.get(
            str(row["status"]))
        if tag:
            said = _clean(_said(row))
            found = ET.SubElement(case, tag, message=said)
            found.text = None if tag == "skipped" else said
        elif row["status"] == "warn":
            ET.SubElement(case, "system-out").text = _clean(_said(row))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode")


def _clean(text: str) -> str:
    return UNWRITTEN.sub("?", text)


def _sarif(tree: Mapping[str, object]) -> str:
    rows = [r for r in _rows(tree) if r["status"] in LEVELS]
    rules = sorted({str(r["id"]) for r in rows})
    results = []
    for row in rows:
        file, line = place(tree, row)
        where = {"artifactLocation": {"uri": file}, "region": {"startLine": line}}
        results.append({"ruleId": row["id"], "ruleIndex": rules.index(str(row["id"])),
                        "level": LEVELS[str(row["status"])],
                        "message": {"text": f"{row['subject']}: {_said(row)}"},
                        "locations": [{"physicalLocation": where}]})
    driver = {"name": "part2gs-robot", "rules": [{"id": rule} for rule in rules]}
    run = {"tool": {"driver": driver}, "results": results}
    return json.dumps({"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}, indent=1)


def _github(tree: Mapping[str, object]) -> str:
    path = Path(str(tree["path"]))
    lines = []
    for row in _rows(tree):
        if row["status"] in LEVELS:
            file, line = place(tree, row)
            where = str(path if path.suffix else path / file)
            lines.append(f"::{LEVELS[str(row['status'])]} file={_escaped(where, ',:')},line={line},"
                         f"title={_escaped(str(row['name']), ',:')}::{_escaped(_said(row), '')}")
    return "\n".join(lines)


def _escaped(text: str, more: str) -> str:
    """Return text as GitHub reads it: percent codes for what ends a command or a property."""
    for char in "%\r\n" + more:
        text = text.replace(char, f"%{ord(char):02X}")
    return text


FORMATS: dict[str, Callable[[Mapping[str, object]], str]] = {
    "json": _json, "junit": _junit, "sarif": _sarif, "github": _github}
