"""What ladder.py knows of an object: its study from saved fits, its true motions and labels."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from part2gs_robotics.config import resolve
from part2gs_robotics.decide.candidate import Candidate, on_base
from part2gs_robotics.evidence.canonical import Canonical, canonical
from part2gs_robotics.fit.brightness import alike
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene_frame import SceneFrame, frame_of, internal
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.runtime.store import read_stage
from part2gs_robotics.stages import load_fit, load_motion


def remade(purpose: str, results: Path, stage: str,
           measure: Callable[..., dict[str, Any]], **flags: str) -> dict[str, dict[str, Any]]:
    """Return rows by object: those stored, and those of the builds that the command line names.

    Args:
        purpose: of the script, for its help.
        results: JSON of rows, written after each.
        stage: that a build must have finished.
        measure: (object, folder of its build, its scene; flags by name) to its row.
        flags: further ones of the script, each with its help.
    """
    parser = argparse.ArgumentParser(description=purpose)
    parser.add_argument("--work", type=Path, nargs="+", default=[], help="folders of the suite")
    parser.add_argument("--objects", nargs="+", help="only these")
    for flag, told in flags.items():
        parser.add_argument(f"--{flag}", action="store_true", help=told)
    args = parser.parse_args()
    asked = {flag: getattr(args, flag) for flag in flags}
    rows = {r["object"]: r for r in json.loads(results.read_text())} if results.exists() else {}
    for name, out, scene in places(args.work, args.objects, stage):
        rows[name] = measure(name, out, scene, **asked)
        sys.stderr.write(f"{rows[name]}\n")
        results.write_text(json.dumps([rows[n] for n in sorted(rows)], indent=1) + "\n")
    return rows


def places(works: Sequence[Path], only: Sequence[str] | None, stage: str,
           ) -> Iterator[tuple[str, Path, Path]]:
    """Yield name, build and scene of every object of the suite's folders that has a stage."""
    for work in works:
        for file in sorted(work.glob(f"runs/*/*/stages/{stage}/manifest.json")):
            out = file.parents[2]
            if not only or out.name in only:
                yield out.name, out, work / "scenes" / out.parent.name / out.name


@dataclass(frozen=True)
class Known:
    """One object beside its truth.

    Attributes:
        name: of the object.  out: folder of its build, stages kept.  both: states, comparable.
        frame: of the internal units.  truth: gt.json of the kit.  points: visible true points.
    """

    name: str
    out: Path
    both: Canonical
    frame: SceneFrame
    truth: dict[str, Any]
    points: dict[str, np.ndarray]

    @cached_property
    def candidate(self) -> Candidate:
        """The true motions, not judged."""
        centre, unit = np.array(self.frame.centre), self.frame.unit
        found: list[Joint] = []
        parents = tuple(int(p.get("parent") or 0) for p in self.truth["parts"])
        for part, parent in zip(self.truth["parts"], parents, strict=True):
            slides = part["type"] == "prismatic"
            axis = np.array(part["axis"], float)
            found.append(Joint("prismatic" if slides else "revolute", axis / np.linalg.norm(axis),
                               (np.array(part["point"], float) - centre) / unit,
                               part["motion"] / (unit if slides else 1.0),
                               carrier=found[parent - 1].move if parent else None))
        return replace(on_base(found), parents=parents)

    def labels(self, surfels: tuple[Any, Any]) -> np.ndarray:
        """Return the true part of every surfel of both states: that of the nearest true point."""
        out = []
        for state in (0, 1):
            parts = [(self.points[f"p{k}_s{state}"] - np.array(self.frame.centre)) / self.frame.unit
                     for k in range(len(self.candidate) + 1)]
            owner = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
            nearest = cKDTree(np.concatenate(parts)).query(surfels[state].points)[1]
            out.append(owner[nearest])
        return np.concatenate(out)

    def own(self, k: int) -> np.ndarray:
        """Return [n, 3] visible true points of part k at state 0, internal units."""
        centre, unit = np.array(self.frame.centre), self.frame.unit
        here = (self.points[f"p{k + 1}_s0"] - centre) / unit
        if len(here):
            return here
        there = (self.points[f"p{k + 1}_s1"] - centre) / unit
        return se3.apply(se3.inverse(self.candidate.motions[k].move), there)

    @property
    def parts_built(self) -> int | None:
        """Moving parts of the build's own twin; None where it has none."""
        try:
            return len(load_motion(_stage(self.out, "03_articulate")).joints)
        except OSError:
            return None


def known(name: str, out: Path, scene: Path) -> Known:
    """Return an object whose fits a build has kept."""
    config = resolve({})
    read = read_scene(scene, config.read)
    frame = frame_of(read)
    zero, one = (load_fit(_stage(out, f"0{s + 1}_fit_{s}")) for s in (0, 1))
    seen = alike(internal(read, frame), (zero[2], one[2]))
    both = canonical(seen, (zero[0], one[0]), config.search)
    folder = Path(f"{scene}.gt")
    with np.load(folder / "visible.npz") as points:
        return Known(name, out, both, frame, json.loads((folder / "gt.json").read_text()),
                     dict(points))


def _stage(out: Path, name: str) -> Any:
    folder = out / "stages" / name
    return read_stage(folder, json.loads((folder / "manifest.json").read_text())["key"])


def iou(found: np.ndarray, true: np.ndarray, count: int) -> np.ndarray:
    """Return [count] intersection over union of every label."""
    return np.array([((found == k) & (true == k)).sum() / max(((found == k) | (true == k)).sum(), 1)
                     for k in range(count)])
