"""How far right masks contradict each other, and wrong ones the right: limits of wrong_masks.py.

    python benchmarks/masks.py SCENE ...

Every SCENE is one with right masks in both states. As it is, with noisy poses, with few views and
with close photos among them no mask may be blamed; planted wrong masks should be. No fit is made.
Writes benchmarks/results/masks.json and docs/masks.md; scenes that are not given keep their rows.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from reconstruction_suite import insert

from part2gs_robotics.config import resolve
from part2gs_robotics.model.scene import StateViews
from part2gs_robotics.model.se3 import make, rotation_from_rotvec
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.readers.wrong_masks import contradictions, right_masks

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/masks.json", ROOT / "docs/masks.md"
HEAD = ("masks", "states", "reach beyond the others", "lack", "named", "of wrong ones",
        "right ones named")
PLANTED = (5, 25, 45)  # views, of 64, whose masks are made wrong
NOISE_DEG = 1.0  # every camera turned by that about its eye: the worst poses of robustness.py
ZOOM = 2.5  # of close photos, at a random point of the object
SHIFT, BLOB = 0.15, 0.4  # of the image's width; of the object's

Mask = NDArray[np.uint8]
Change = Callable[[StateViews, np.random.Generator], StateViews]


def main() -> int:
    """Look at the scenes given, store the rows, and write the page."""
    rows = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for word in sys.argv[1:]:
        rows[Path(word).name] = looked_at(Path(word))
    RESULTS.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n")
    PAGE.write_text(insert(PAGE.read_text(), table(rows), "<!-- masks:begin -->",
                           "<!-- masks:end -->"))
    sys.stdout.write(table(rows))
    return 0


def looked_at(scene: Path) -> list[dict[str, Any]]:
    """Return what is said of the masks of both states, as they are and changed."""
    states = read_scene(scene, resolve({}).read).states
    return [case for state in states for case in cases(state, np.random.default_rng(0))]


def cases(state: StateViews, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Return one row per condition: the worst right masks, the best wrong ones, who was named."""
    rows = [judged(name, change(state, rng), ()) for name, change in RIGHT.items()]
    for name, spoil in WRONG.items():
        alphas = state.alphas.copy()
        for view in PLANTED:
            alphas[view] = spoil(alphas[view])
        rows.append(judged(name, replace(state, alphas=alphas), PLANTED))
    return rows


def judged(name: str, state: StateViews, planted: tuple[int, ...]) -> dict[str, Any]:
    """Return the measures of the planted masks, or of all where none is, and who was named."""
    beyond, missing = contradictions(state, name)
    named = np.flatnonzero(~right_masks(state, name))
    asked = list(planted) or list(range(len(state)))
    return {"case": name, "beyond": ends(beyond[asked]), "missing": ends(missing[asked]),
            "planted": len(planted), "found": len(set(named) & set(planted)),
            "blamed": len(set(named) - set(planted))}


def ends(values: NDArray[np.float64]) -> list[float] | None:
    """Return the least and the most of what is known; None where nothing is."""
    known = values[np.isfinite(values)]
    return [float(known.min()), float(known.max())] if len(known) else None


def noisy(state: StateViews, rng: np.random.Generator) -> StateViews:
    """Return the state with every camera turned about its eye."""
    axes = rng.normal(size=(len(state), 3))
    axes *= np.deg2rad(NOISE_DEG) / np.linalg.norm(axes, axis=1, keepdims=True)
    turns = np.stack([make(rotation_from_rotvec(axis), np.zeros(3)) for axis in axes])
    return replace(state, viewmats=turns @ state.viewmats)


def fewer(count: int) -> Change:
    """Return a change that keeps so many views, evenly."""
    def change(state: StateViews, _: np.random.Generator) -> StateViews:
        keep = np.zeros(len(state), bool)
        keep[np.linspace(0, len(state) - 1, count).round().astype(int)] = True
        return state.select(keep)
    return change


def close(state: StateViews, rng: np.random.Generator) -> StateViews:
    """Return the state with a third of the photos taken close, at a point of the object each."""
    alphas, Ks = state.alphas.copy(), state.Ks.copy()
    for view in rng.choice(len(state), len(state) // 3, replace=False):
        rows, columns = np.nonzero(alphas[view] >= 128)
        pick = rng.integers(len(rows))
        middle = np.array([columns[pick] + 0.5, rows[pick] + 0.5])
        shift = np.array([state.width, state.height]) / 2 - ZOOM * middle
        zoom = np.array([[ZOOM, 0.0, shift[0]], [0.0, ZOOM, shift[1]], [0.0, 0.0, 1.0]])
        # OpenCV's pixel centres are whole numbers, ours at + 0.5
        half = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
        warp = np.linalg.inv(half) @ zoom @ half
        alphas[view] = cv2.warpAffine(alphas[view], warp[:2], (state.width, state.height))
        Ks[view] = zoom @ Ks[view]
    return replace(state, alphas=alphas, Ks=Ks)


def shifted(mask: Mask) -> Mask:
    """Return the mask moved aside."""
    return np.roll(mask, round(SHIFT * mask.shape[1]), axis=1)


def halved(mask: Mask) -> Mask:
    """Return the mask without its left half."""
    left = mask.copy()
    left[:, : int(np.median(np.nonzero(mask)[1]))] = 0
    return left


def with_a_blob(mask: Mask) -> Mask:
    """Return the mask with a square beside the object."""
    rows, columns = np.nonzero(mask)
    side = int(BLOB * np.ptp(columns))
    out = mask.copy()
    out[rows.min():rows.min() + side, max(0, columns.min() - side):columns.min()] = 255
    return out


RIGHT: dict[str, Change] = {
    "as they are": lambda state, _: state,
    f"poses {NOISE_DEG:g} deg off": noisy,
    "32 views": fewer(32), "20 views": fewer(20),
    "a third close": close,
}
WRONG: dict[str, Callable[[Mask], Mask]] = {"three shifted": shifted, "three halved": halved,
                                            "three with a blob": with_a_blob}


def table(rows: dict[str, list[dict[str, Any]]]) -> str:
    """Return one line per condition over all scenes as Markdown."""
    lines = [_line(HEAD), _line(("---",) * len(HEAD))]
    for name in (*RIGHT, *WRONG):
        own = [case for row in rows.values() for case in row if case["case"] == name]
        total = sum(case["planted"] for case in own)
        lines.append(_line((name, str(len(own)), _span(own, "beyond"), _span(own, "missing"),
                            str(sum(case["found"] for case in own)) if total else "",
                            str(total) if total else "",
                            str(sum(case["blamed"] for case in own)))))
    return "\n".join(lines) + "\n"


def _span(own: list[dict[str, Any]], key: str) -> str:
    """Return the least and the most, over the states, of a state's most; least if planted."""
    known = [case[key] for case in own if case[key] is not None]
    if not known:
        return ""
    if own[0]["planted"]:
        return f"{min(k[0] for k in known):.2f} to {max(k[1] for k in known):.2f}"
    return f"at most {max(k[1] for k in known):.2f}"


def _line(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
