"""Where a row of a check stands: the file at fault, and the line of the number in it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

Row = Mapping[str, object]
FILE = re.compile(r"[\w./-]+\.(?:xml|urdf|yaml|obj|mtl|sdf|glb|usd)\b")
MOST_BYTES = 1 << 20  # of a file that is searched for a line; longer ones hold numbers
# By id of a check: what holds its number in MJCF, URDF, SDFormat or twin.yaml.
HOLDS = {
    "same-mass": r"<inertial\b.*mass|<mass\b|^ *mass:", "same-center": r"<inertial|^ *center:",
    "same-inertia": r"<inertia|^ *inertia:", "inertia": r"<inertial|<inertia\b",
    "same-joint": r"<joint|<axis|^ *axis:", "same-motion": r"<joint|<axis|^ *axis:",
    "same-limits": r"<limit|\brange=|^ *range:", "limits": r"<limit|\brange=|^ *range:",
    "same-dynamics": r"<dynamics|damping=|^ *damping:",
    "same-collision": r"<collision|class=\"collision\"|^ *collision_meshes:",
    "collision": r"<collision|class=\"collision\"", "mesh": r"<visual|class=\"visual\"",
    "same-surface": r"<visual|class=\"visual\"|^ *visual_mesh:",
    "options": r"<option", "clear-world": r"<geom", "same-states": r"<key\b|^ *state_1:",
}  # fmt: skip
NEXT = re.compile(r"<(?:body|link)\b|^ *- name:")  # another part begins


def place(tree: Mapping[str, object], row: Row) -> tuple[str, int]:
    """Return the file a row is about, from the checked folder, and the line of its number.

    That is the first line of the part or joint that holds what the check compares; the line that
    names the part where none does, 1 where nothing does.
    """
    path = Path(str(tree["path"]))
    text = f"{row['subject']} {row['cause']}"
    found = FILE.search(text)
    name = path.name if path.suffix else found[0] if found else "twin.xml"
    file = path if path.suffix else path / name
    try:
        if file.stat().st_size > MOST_BYTES:
            return name, 1
        lines = file.read_text("utf-8", "replace").splitlines()
    except OSError:
        return name, 1
    return name, _line(lines, str(row["subject"]).rpartition(" ")[2], str(row["id"]))


def _line(lines: list[str], wanted: str, check: str) -> int:
    """Return the number of a line, from 1."""
    holds = re.compile(HOLDS[check]) if check in HOLDS else None
    named = -1
    if wanted and not FILE.fullmatch(wanted):
        quoted = re.compile(rf"""["': ]{re.escape(wanted)}(?:["'\s]|$)""")
        # Files list meshes and materials before bodies: the part itself is a body, link or joint.
        hits = [i for i, line in enumerate(lines) if quoted.search(line)]
        real = [i for i in hits if re.search(r"<(?:body|link|joint)\b|^ *- name:", lines[i])]
        named = (real or hits or [-1])[0]
    if holds is None or (named < 0 and wanted and not FILE.fullmatch(wanted)):
        return max(named, 0) + 1
    for i in range(max(named, 0), len(lines)):
        if i > named >= 0 and NEXT.search(lines[i]):
            break
        if holds.search(lines[i]):
            return i + 1
    return max(named, 0) + 1
