"""The tables of geometry.py: what is wanted beside what is, and a row per object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_stops import WITHIN
from reconstruction_suite import number

Row = dict[str, Any]
# Title, key, factor, digits.
LOOKS = (("PSNR, dB", "psnr_db", 1, 1), ("SSIM", "ssim", 1, 3),
         ("silhouette IoU", "mask_iou", 1, 3), ("rough", "rough", 1, 2),
         ("of the true mesh", "rough_perfect", 1, 2),
         ("far, %", "far_all", 100, 1), ("far of seen, %", "far_seen", 100, 1),
         ("CD-s", "cd_s", 1, 2), ("CD-w", "cd_w", 1, 2), ("s", "seconds", 1, 0))  # fmt: skip
SOLIDS = (("triangles", "triangles", 1, 0), ("pieces", "most_pieces", 1, 0),
          ("vertices", "most_vertices", 1, 0), ("phantom, %", "phantom", 100, 1),
          ("missing, %", "missing", 100, 1), ("worst part, %", "most_missing", 100, 1),
          ("out, %", "out", 100, 2), ("in, %", "in", 100, 2),
          ("overlap, %", "overlap", 100, 3), ("reach, %", "reach", 100, 1),
          ("in PyBullet, %", "bullet", 100, 1))  # fmt: skip
# Figure, key, factor, digits, goal, whether more is better, and over all objects: mean or worst.
GOALS = (
    ("PSNR, dB", "psnr_db", 1, 1, 28, True, np.mean),
    ("SSIM", "ssim", 1, 3, 0.92, True, np.mean),
    ("silhouette IoU", "mask_iou", 1, 3, 0.985, True, np.mean),
    ("surface far from any true one, seen places, %", "far_seen", 100, 1, 3, False, np.max),
    ("triangles", "triangles", 1, 0, 10_000, False, np.max),
    ("pieces of a part", "most_pieces", 1, 0, 32, False, np.max),
    ("vertices of a piece", "most_vertices", 1, 0, 64, False, np.max),
    ("phantom volume of pieces, %", "phantom", 100, 1, 3, False, np.max),
    ("missing volume of pieces, %", "missing", 100, 1, 5, False, np.max),
    ("swept overlap, % of the size", "overlap", 100, 3, 0.1, False, np.max),
    ("reach, %", "reach", 100, 1, 99, True, np.min),
    ("reach in PyBullet, %", "bullet", 100, 1, 99, True, np.min),
    ("meshes, textures and files, s", "seconds", 1, 0, 30, False, np.max),
)  # fmt: skip


def markdown(result: dict[str, Any]) -> str:
    """Return the tables of all rows."""
    rows = result["rows"]
    missing = [name for name in result.get("objects", []) if name not in
               {row["object"] for row in rows}]
    texts = [goals(rows), table(rows, LOOKS), table(rows, SOLIDS), stop_table(rows),
             grip_table(rows)]
    if missing:
        texts.append(f"Not measured: {', '.join(missing)}.\n")
    return "\n".join(text for text in texts if text)


def lines(head: tuple[str, ...], rows: list[list[str]]) -> str:
    """Return a Markdown table."""
    texts = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return "\n".join([*texts, *("| " + " | ".join(row) + " |" for row in rows), ""])


def table(rows: list[Row], columns: tuple[tuple[str, str, int, int], ...]) -> str:
    """Return a row per object, the commit last."""
    head = ("object", *(title for title, *_ in columns), "commit")
    return lines(head, [[row["object"], *(shown(row.get(key), factor, digits)
                                          for _, key, factor, digits in columns),
                         row["commit"]] for row in rows])


def shown(value: float | None, factor: float, digits: int) -> str:
    """Return a number in the unit of its column."""
    return number(None if value is None else factor * value + 0.0, digits)


def goals(rows: list[Row]) -> str:
    """Return what is wanted beside the mean and the worst of all objects."""
    out = [goal_row(rows, *goal) for goal in GOALS]
    above = [row["rough"] - row["rough_perfect"] for row in rows
             if row.get("rough") is not None and row.get("rough_perfect") is not None]
    out.insert(3, counted("rough beside a true mesh", above, 2, 0.05))
    for kind, words in (("limit", "data set's limit, shown by its meshes"),
                        ("mesh", "true meshes alone")):
        ends = [s for row in rows for s in row.get("stops") or () if s["kind"] == kind]
        good = sum(right(s) for s in ends)
        out.append([f"hinges' stops within {WITHIN}°: {words}", f"{good} of {len(ends)}", "-",
                    "80 %", "-"])
    tried = [g for row in rows for g in row.get("grips") or ()]
    opened, asked = ({g["object"] for g in tried if not which or g["opened"]} for which in (1, 0))
    out.append(["a gripper opens it by 30° or 0.2", f"{len(opened)} of {len(asked)}", "-", "80 %",
                "-"])
    return lines(("figure", "mean", "worst", "goal", "objects that reach it"), out)


def goal_row(rows: list[Row], title: str, key: str, factor: float, digits: int, goal: float,
             more: bool, over: Callable[[list[float]], float]) -> list[str]:
    """Return one figure's cells; `over` tells whether the goal is of the mean or of the worst."""
    values = [factor * row[key] for row in rows if row.get(key) is not None]
    if not values:
        return [title, "-", "-", f"{goal:g}", "-"]
    worst = min(values) if more else max(values)
    good = sum(v >= goal if more else v <= goal for v in values)
    sign, of = ("≥" if more else "≤"), ("" if over is np.mean else " each")
    return [title, number(float(np.mean(values)), digits), number(worst, digits),
            f"{sign} {goal:,}{of}", f"{good} of {len(values)}"]


def counted(title: str, values: list[float], digits: int, goal: float) -> list[str]:
    """Return the cells of a figure of which less is better."""
    if not values:
        return [title, "-", "-", f"{goal:g}", "-"]
    good = sum(v <= goal for v in values)
    return [title, f"{np.mean(values):+.{digits}f}", f"{max(values):+.{digits}f}",
            f"≤ {goal:+g} each", f"{good} of {len(values)}"]


def right(stop: dict[str, Any]) -> bool:
    """Say whether the derived end is the true one."""
    return stop["error"] is not None and abs(stop["error"]) <= WITHIN


def stop_table(rows: list[Row]) -> str:
    """Return every end of a hinge that shows its stop."""
    kinds = {"limit": "data set and meshes", "mesh": "meshes"}
    out = [[row["object"], s["joint"], "01"[s["end"]], kinds[s["kind"]],
            *(shown(s[key], 1, 1) for key in ("limit", "mesh", "found", "error"))]
           for row in rows for s in row.get("stops") or () if s["kind"]]
    return lines(("object", "joint", "beyond state", "stop told by", "data set, deg",
                  "true meshes, deg", "twin, deg", "error, deg"), out) if out else ""


def grip_table(rows: list[Row]) -> str:
    """Return every handle that was gripped."""
    out = [[g["object"], g["handle"], g["part"] or "-", number(g["metres"], 2),
            f"{g['asked']:.3g}" if g["asked"] is not None else "-",
            f"{g['reached']:.3g}" if g["reached"] is not None else "-",
            "yes" if g["opened"] else "no"] for row in rows for g in row.get("grips") or ()]
    return lines(("object", "handle", "part", "metres per unit", "asked", "reached", "opens"),
                 out) if out else ""
