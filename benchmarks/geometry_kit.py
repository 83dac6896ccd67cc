"""What the measures of geometry.py share: the kit, finished twins, points on surfaces."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
NEAREST = 16  # sampled points whose triangles are compared exactly: 0.02 % of the size is left


@dataclass(frozen=True)
class Case:
    """One finished twin beside its scene and truth.

    Attributes:
        name: object.  folder: of the twin.  scene: photos.  truth: folder .gt of the kit.
        kit: folder of the benchmark kit.
    """

    name: str
    folder: Path
    scene: Path
    truth: Path
    kit: Path

    @cached_property
    def true(self) -> Any:
        """The kit's reader of the truth."""
        return module(self.kit, "common").GroundTruth(self.truth)

    @cached_property
    def twin(self) -> Any:
        """The twin as its exporter wrote it."""
        from part2gs_robotics.exporters.read_twin import read_twin

        return read_twin(self.folder)

    @cached_property
    def score(self) -> dict[str, Any]:
        """What the kit's score.py says, parts matched with their names in the twin."""
        return dict(module(self.kit, "score").score(self.folder / "twin.xml", self.truth))

    @cached_property
    def report(self) -> dict[str, Any]:
        """The build's report.json."""
        return dict(json.loads((self.folder / "report.json").read_text()))


def module(kit: Path, name: str) -> ModuleType:
    """Return a module of the kit, which may be read-only."""
    from importlib import import_module

    sys.dont_write_bytecode = True
    os.environ.setdefault("MUJOCO_GL", "egl")
    if str(kit.resolve()) not in sys.path:
        sys.path.append(str(kit.resolve()))
    return import_module(name)


def cases(kit: Path, works: list[Path]) -> list[Case]:
    """Return every finished twin of the folders that the suite filled, one per object."""
    found = {}
    for work in works:
        for twin in sorted(work.glob("runs/*/*/twin.xml")):
            tag, name = twin.parts[-3:-1]
            scene = work / "scenes" / tag / name
            found[name] = Case(name, twin.parent, scene, Path(f"{scene}.gt"), kit)
    return list(found.values())


def wanted(kit: Path) -> list[str]:
    """Return the names of all objects of the kit, in its order."""
    import yaml

    lists = yaml.safe_load((kit / "objects.yaml").read_text())
    return [*lists["dev"], *lists["dev_nested"], *lists["dev2"]]


def attempt(what: str, measure: Callable[[], T]) -> T | None:
    """Return what a measure finds; None, and a line on stderr, where it fails."""
    try:
        return measure()
    except Exception as error:  # one failing measure must not hide the others
        said = str(error).strip().partition("\n")[0][:200]
        sys.stderr.write(f"{what}: {type(error).__name__}: {said}\n")
        return None


def sampled(vertices: np.ndarray, faces: np.ndarray, count: int,
            seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return points spread evenly over a surface, [N, 3], and the face of each, [N]."""
    tri = np.asarray(vertices, float)[faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    rng = np.random.default_rng(seed)
    face = rng.choice(len(faces), count, p=area / area.sum())
    root, share = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = (tri[face, k] for k in range(3))
    return (1 - root) * a + root * (1 - share) * b + root * share * c, face


class Surface:
    """A triangle mesh that tells distances to it.

    Args:
        vertices: [V, 3].
        faces: [F, 3].
        count: of points that find the nearest triangles.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, count: int = 100_000) -> None:
        """Spread the points."""
        from scipy.spatial import cKDTree

        self.tri = np.asarray(vertices, float)[faces]
        points, self.face = sampled(vertices, faces, count)
        # Small faces may get no point: every face has its centre as well.
        self.face = np.concatenate([self.face, np.arange(len(faces))])
        self.tree = cKDTree(np.concatenate([points, self.tri.mean(1)]))

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Return the distance of every point."""
        from part2gs_robotics.collision.depth import point_triangle_distance

        near = self.face[self.tree.query(points, NEAREST)[1]]
        return np.asarray(point_triangle_distance(points[:, None], self.tri[near]).min(1))


def joined(meshes: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return one mesh of several."""
    starts = np.cumsum([0, *(len(v) for v, _ in meshes)])
    return (np.concatenate([v for v, _ in meshes]),
            np.concatenate([f + start for (_, f), start in zip(meshes, starts, strict=False)]))
