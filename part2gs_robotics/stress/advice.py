"""Which time step and integrator a model needs, and the frontier of every study."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from part2gs_robotics.errors import CheckError
from part2gs_robotics.runtime.atomic import write_text_atomic
from part2gs_robotics.stress.cells import RIGHT, Cell
from part2gs_robotics.stress.extremes import MEETS
from part2gs_robotics.stress.precision import SECONDS, Diagram, diverges_at

ROOMY = 2.0  # x below the step at which an integrator diverges: a stiffer moment must not break it
AS_CHEAP = 1.3  # x the cheapest: closer than that, clocks of a busy machine cannot tell


@dataclass(frozen=True)
class Advice:
    """What to set in scene.xml.

    Attributes:
        integrator.  step: s.  smooth, contact: errors there, of the range.
        cost: s of the processor for a second of both motions.  good: all limits are kept.
    """

    integrator: str
    step: float
    smooth: float
    contact: float
    cost: float
    good: bool

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return dict(self.__dict__)

    @property
    def said(self) -> str:
        """The advice in words."""
        return (f"{self.integrator} at {self.step:.4g} s: wrong by {self.smooth:.2g} of the range "
                f"in smooth motion, {self.contact:.2g} in contact"
                + ("" if self.good else "; nothing in the ladder keeps both limits"))


def advice(smooth: Diagram, contact: Diagram, own: str, most: float = np.inf) -> Advice:
    """Return the cheapest integrator and step that keep the limits in both motions.

    Args:
        smooth: diagram of the smooth motion.
        contact: the same of contact, over the same steps.
        own: integrator that the model has now; kept where it is about as cheap.
        most: largest step to advise, s; a twin's own servos are made for theirs.
    """
    found, finest = list[Advice](), min(c.set["step"] for c in smooth.cells)
    for one, other in zip(smooth.cells, contact.cells, strict=True):
        step, name = one.set["step"], one.set["integrator"]
        ends = min(diverges_at(d.line(name)) for d in (smooth, contact))
        errors = [np.inf if c.error is None else c.error for c in (one, other)]
        good = errors[0] <= RIGHT and errors[1] <= MEETS and step * ROOMY <= ends
        seconds = (one.seconds + other.seconds) / (2 * SECONDS)
        if step <= max(most * (1 + 1e-9), finest):
            found.append(Advice(name, step, errors[0], errors[1], seconds, good))
    right = [a for a in found if a.good]
    if right:
        cheapest = min(a.cost for a in right)
        near = [a for a in right if a.cost <= AS_CHEAP * cheapest]
        return min(near, key=lambda a: (a.integrator != own, -a.step, a.cost))
    return min(found, key=lambda a: max(a.smooth / RIGHT, a.contact / MEETS))


def frontier(cells: Sequence[Cell], key: str) -> tuple[float, float]:
    """Return the span of values, around the middle of the list, within which all cells are ok.

    Args:
        cells: of one study; several of one value count as the worst.
        key: name of the setting.
    """
    values = sorted({float(c.set[key]) for c in cells})
    fine = [all(c.status == "ok" for c in cells if c.set[key] == v) for v in values]
    if not any(fine):
        return float("nan"), float("nan")
    runs, at = list[tuple[int, int]](), 0
    while at < len(fine):
        if fine[at]:
            end = at
            while end + 1 < len(fine) and fine[end + 1]:
                end += 1
            runs.append((at, end))
            at = end
        at += 1
    low, high = max(runs, key=lambda r: r[1] - r[0])
    return values[low], values[high]


def apply(scene: Path, chosen: Mapping[str, Any]) -> str:
    """Write integrator and time step into the <option> of scene.xml; return what was written.

    Args:
        scene: the file.
        chosen: `Advice.to_dict`.

    Raises:
        CheckError: no scene.xml, or no <option> in it.
    """
    if not chosen:
        return "not changed, as nothing was measured"
    if not scene.is_file():
        raise CheckError(f"{scene}: does not exist. --apply writes into the scene.xml of a twin "
                         "folder; give such a folder, or leave --apply out.")
    text = scene.read_text("utf-8")
    found = re.search(r"<option\b[^>]*>", text)
    if found is None:
        raise CheckError(f"{scene}: has no <option>. Expected the scene.xml of a twin folder; "
                         "build the twin again.")
    option = found[0]
    wanted = {"timestep": f"{chosen['step']:.10g}", "integrator": str(chosen["integrator"])}
    for key, value in wanted.items():
        option, count = re.subn(rf'\b{key}\s*=\s*(["\'])[^"\']*\1', f'{key}="{value}"', option)
        if not count:
            option = option.replace("<option", f'<option {key}="{value}"', 1)
    write_text_atomic(scene, text[:found.start()] + option + text[found.end():])
    return f"timestep {chosen['step']:.4g} s, integrator {chosen['integrator']}"
