"""What a batch leaves for people and machines: one page, CSV, JUnit."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from xml.etree import ElementTree

from part2gs_robotics.commands.batch_job import Row
from part2gs_robotics.runtime.atomic import write_bytes_atomic, write_text_atomic

COLUMNS = ("name", "outcome", "code", "tries", "seconds", "parts", "failing", "bytes", "said",
           "scene", "out")
COLORS = {"built": "#1a7f37", "built, checks fail": "#9a6700", "refused": "#cf222e",
          "failed": "#cf222e"}
STYLE = """body{font:16px/1.4 system-ui,sans-serif;margin:1em;max-width:70em}
table{border-collapse:collapse;width:100%}td,th{padding:.3em .6em;text-align:left;
border-bottom:1px solid #d0d7de;vertical-align:top}td.n{text-align:right}
pre{white-space:pre-wrap;margin:0;font-size:13px}"""


def write_pages(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write index.html, batch.csv and batch.xml, whole or not at all; return their paths.

    Args:
        folder: of the twins.
        rows: of all scenes, in the order they were given.

    Raises:
        StoreError: the folder cannot be written.
    """
    page, table, junit = folder / "index.html", folder / "batch.csv", folder / "batch.xml"
    write_text_atomic(table, as_csv(rows))
    write_bytes_atomic(junit, as_junit(rows))
    write_text_atomic(page, as_html(folder, rows))
    return [page, table, junit]


def counts(rows: Sequence[Row]) -> str:
    """Return how many scenes ended how, in words."""
    found = {outcome: sum(row.outcome == outcome for row in rows) for outcome in COLORS}
    return f"{len(rows)} scenes: " + ", ".join(f"{n} {name}" for name, n in found.items() if n)


def as_csv(rows: Sequence[Row]) -> str:
    """Return one line per scene."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        data = asdict(row) | {"failing": "; ".join(row.failing), "said": _inert(row.said)}
        writer.writerow([_inert(str(data[column])) for column in COLUMNS])
    return text.getvalue()


def _inert(text: str) -> str:
    """Return text that no spreadsheet takes for a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "@", "\t") else text


def as_junit(rows: Sequence[Row]) -> bytes:
    """Return a test case per scene: a failure where checks fail, an error where none was built."""
    bad = [row for row in rows if row.outcome in ("refused", "failed")]
    failing = [row for row in rows if row.outcome == "built, checks fail"]
    suite = ElementTree.Element("testsuite", name="part2gs-robot batch", tests=str(len(rows)),
                                failures=str(len(failing)), errors=str(len(bad)),
                                time=f"{sum(row.seconds for row in rows):.3f}")
    for row in rows:
        case = ElementTree.SubElement(suite, "testcase", classname="batch", name=_xml(row.name),
                                      time=f"{row.seconds:.3f}")
        if row.outcome != "built":
            kind = "failure" if row in failing else "error"
            told = ElementTree.SubElement(case, kind, message=_xml(
                ", ".join(row.failing) or row.said[:200] or f"exit code {row.code}"))
            told.text = _xml(row.said)
    return ElementTree.tostring(suite, encoding="utf-8", xml_declaration=True)


def _xml(text: str) -> str:
    """Return text without the control characters that XML cannot hold."""
    return "".join(c if c in "\t\n" or " " <= c <= "\ud7ff" or "\ue000" <= c <= "\ufffd"
                   or c > "\uffff" else "?" for c in text)


def as_html(folder: Path, rows: Sequence[Row]) -> str:
    """Return a page with one line per scene, worst first, that names what to do."""
    order = list(COLORS)[::-1]
    lines = "".join(_line(folder, row) for row in
                    sorted(rows, key=lambda row: (order.index(row.outcome), row.name)))
    hours = sum(row.seconds for row in rows) / 3600
    size = sum(row.bytes for row in rows) / 1e9
    return (f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" '
            f'content="width=device-width"><title>Twins</title><style>{STYLE}</style>'
            f"<h1>Twins</h1><p>{html.escape(counts(rows))}; {hours:.2f} hours of work, "
            f"{size:.2f} GB.</p><table><tr><th>scene<th>outcome<th>parts<th>seconds<th>tries"
            f"<th>what was said</tr>{lines}</table></html>\n")


def _line(folder: Path, row: Row) -> str:
    report = Path(row.out) / "report.html"
    name = html.escape(row.name)
    if report.is_file() and Path(row.out).parent == folder:
        name = f'<a href="{html.escape(Path(row.out).name, quote=True)}/report.html">{name}</a>'
    said = html.escape(", ".join(row.failing) or row.said)
    return (f'<tr><td>{name}<td style="color:{COLORS[row.outcome]}">{row.outcome}'
            f'<td class="n">{row.parts}<td class="n">{row.seconds:.1f}<td class="n">{row.tries}'
            f"<td><pre>{said}</pre></tr>\n")
