"""A check as one self-contained page: failures first, nothing loaded from outside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import cast

from part2gs_robotics import __version__
from part2gs_robotics.report.style import STYLE

Tree = Mapping[str, object]
ORDER = ("fail", "incomplete", "warn", "pass", "skipped")
POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def check_html(trees: Sequence[Tree]) -> str:
    """Return the page; every text is escaped."""
    body = "".join(map(_asset, trees))
    return ('<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>checks of {len(trees)} assets</title><style>{STYLE}</style></head>"
            f"<body><main>{body}<p class=\"muted\">part2gs-robotics {escape(__version__)}</p>"
            "</main></body></html>\n")


def _asset(tree: Tree) -> str:
    rows = cast("list[Tree]", tree["checks"])
    rows = sorted(rows, key=lambda row: ORDER.index(str(row["status"])))
    verdict = "pass" if tree["ok"] else "fail"
    notes = "".join(f"<li>{escape(str(n))}</li>" for n in cast("list[object]", tree["notes"]))
    return (f'<section><h2>{escape(str(tree["path"]))} <span class="pill {verdict}">{verdict}'
            f'</span></h2><p class="muted">{escape(str(tree["engine"]))}, '
            f'{cast(float, tree["seconds"]):.1f} s</p><table><tr><th>verdict</th><th>check</th>'
            "<th>about</th><th>value</th><th>limit</th><th>what was found</th><th>cause</th></tr>"
            f'{"".join(map(_row, rows))}</table><ul>{notes}</ul>{_pictures(tree)}</section>')


def _pictures(tree: Tree) -> str:
    """Return the drawings of --stress, which are this program's own, their words escaped."""
    stress = cast("Mapping[str, Mapping[str, str]]", tree.get("stress") or {})
    found = stress.get("pictures", {})
    titles = {"precision": "Error against run time", "frontier": "Frontier: what still holds"}
    return "".join(f"<h3>{titles[name]}</h3>{found[name]}" for name in titles if name in found)


def _row(row: Tree) -> str:
    status = str(row["status"])
    numbers = ["" if row[key] is None else f"{cast(float, row[key]):.4g}"
               for key in ("value", "limit")]
    cells = (str(row["id"]), str(row["subject"]), f"{numbers[0]} {row['unit']}".strip(), numbers[1],
             str(row["note"]), str(row["cause"]))
    return (f'<tr><td><span class="pill {escape(status)}">{escape(status)}</span></td>'
            + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
