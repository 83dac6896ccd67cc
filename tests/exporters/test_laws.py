"""Laws: a random twin, written, read back and exported, moves in every format as it should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from random_twins import random_twin
from twin_readers import MujocoTree, read_glb, read_sdf, read_urdf, read_usd

from part2gs_robotics.exporters.glb import write_glb
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.sdf import write_sdf
from part2gs_robotics.exporters.sound import sound_twin
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.exporters.usd import write_usd
from part2gs_robotics.model.kinematics import moving_parts, part_transforms
from part2gs_robotics.model.solids import size_of
from part2gs_robotics.model.twin import Twin

WRITERS = {"mjcf": write_mjcf, "urdf": write_urdf, "sdf": write_sdf, "glb": write_glb,
           "usd": write_usd}
POSE = 1e-6  # of the size, and rad
POINT = 2e-6  # of the size and place: vertices are float32 in four of the formats


def reader(kind: str, folder: Path, twin: Twin):
    names = [part.name for part in twin.parts]
    if kind == "mjcf":
        return MujocoTree(folder / "twin.xml", names)
    if kind == "urdf":
        return read_urdf(folder / "twin.urdf", names)
    if kind == "sdf":
        return read_sdf(folder / "model.sdf", twin.meters)
    return {"glb": read_glb, "usd": read_usd}[kind](folder / f"twin.{kind}")


def unit_of(kind: str, found) -> float:
    """Return the file's lengths in scene units: SDF alone is in metres all through."""
    return found.unit if kind == "sdf" else 1.0


def judge(twin: Twin, kind: str, found, rng: np.random.Generator) -> None:
    size, unit = size_of(tuple(p.mesh for p in twin.parts)), unit_of(kind, found)
    moving = moving_parts(twin)
    by_name = {part.name: part for part in twin.parts}
    assert set(found.limits) == {twin.parts[i].name for i in moving}
    for name, limits in found.limits.items():
        slides = by_name[name].joint.kind == "prismatic"
        np.testing.assert_allclose(np.array(limits) / (unit if slides else 1),
                                   by_name[name].limits, rtol=1e-6, atol=1e-9 * size)
    rest = found.poses({})
    for _ in range(3):
        q = [rng.uniform(*twin.parts[i].limits) for i in moving]
        values = {twin.parts[i].name: v * (unit if twin.parts[i].joint.kind == "prismatic" else 1)
                  for i, v in zip(moving, q, strict=True)}
        posed = found.poses(values)
        for part, place in zip(twin.parts, part_transforms(twin, q), strict=True):
            seen = posed[part.name] @ np.linalg.inv(rest[part.name])
            np.testing.assert_allclose(seen[:3, :3], place[:3, :3], atol=POSE)
            at = part.mesh.vertices.mean(0)  # where the part is, not where the world begins
            there = (seen[:3, :3] @ (at * unit) + seen[:3, 3]) / unit
            assert np.linalg.norm(there - place[:3, :3] @ at - place[:3, 3]) < POSE * size
    reach = size + max(float(np.abs(p.mesh.vertices).max()) for p in twin.parts)
    for name, box in found.boxes().items():
        points = by_name[name].mesh.vertices
        np.testing.assert_allclose(box / unit, [points.min(0), points.max(0)], atol=POINT * reach)


def run(seed: int, folder: Path) -> None:
    rng = np.random.default_rng(seed)
    twin = sound_twin(random_twin(seed))
    home = folder / "twin"
    home.mkdir()
    write_mjcf(twin, home)
    write_twin_yaml(twin, home)
    read = read_twin(home)
    truth = MujocoTree(home / "twin.xml", [p.name for p in twin.parts]).masses
    for kind, write in WRITERS.items():
        out = folder / kind
        out.mkdir()
        write(read, out)
        found = reader(kind, out, twin)
        judge(twin, kind, found, rng)
        for name, mass in truth.items():
            assert found.masses[name] == pytest.approx(mass, rel=1e-6)
        if kind in ("sdf", "glb"):
            goal = (0, 0, 1) if kind == "sdf" else (0, 1, 0)
            up = np.array([0, 0, 1.0]) if twin.up is None else twin.up
            np.testing.assert_allclose(found.root @ up, goal, atol=1e-6)
            assert np.linalg.det(found.root) == pytest.approx(1.0, abs=1e-6)
            assert found.unit == pytest.approx(twin.meters, rel=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_every_format_moves_as_the_twin(seed: int, tmp_path: Path) -> None:
    run(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("block", range(10))
def test_five_hundred_more(block: int, tmp_path: Path) -> None:
    for seed in range(1000 + 50 * block, 1050 + 50 * block):
        folder = tmp_path / str(seed)
        folder.mkdir()
        run(seed, folder)
