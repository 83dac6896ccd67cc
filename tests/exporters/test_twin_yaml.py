"""twin.yaml: same numbers as the MJCF, provenance complete."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.twin_yaml import read_twin_yaml, write_twin_yaml


def test_numbers_equal_those_of_the_mjcf(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(4)
    write_mjcf(twin, tmp_path)
    write_twin_yaml(twin, tmp_path, {"seconds": 1.0})
    summary = read_twin_yaml(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))
    for name, entry in summary.joints.items():
        joint = model.joint(name)
        np.testing.assert_allclose(entry["axis"]["value"], joint.axis, atol=1e-9)
        np.testing.assert_allclose(entry["range"]["value"], joint.range, atol=1e-9)
        assert entry["damping"]["value"] == pytest.approx(joint.damping[0], rel=1e-9)
        slot = model.jnt_qposadr[joint.id]
        assert entry["state_1"]["value"] == pytest.approx(model.key("state_1").qpos[slot], abs=1e-9)
    for name, entry in summary.parts.items():
        assert entry["mass"]["value"] == pytest.approx(model.body(name).mass[0], rel=1e-9)
        assert (tmp_path / entry["visual_mesh"]).is_file()
        assert all((tmp_path / f).is_file() for f in entry["collision_meshes"])


def test_every_number_has_a_source(tmp_path: Path) -> None:
    write_twin_yaml(toy_cabinet_twin(3), tmp_path)
    document = read_twin_yaml(tmp_path).document
    document.pop("build")
    document.pop("format")
    assert list(bare_numbers(document)) == []


def bare_numbers(tree: object, path: str = ""):  # type: ignore[no-untyped-def]
    if isinstance(tree, dict):
        if tree.get("source") in ("measured", "fitted", "assumed"):
            return
        for key, value in tree.items():
            yield from bare_numbers(value, f"{path}.{key}")
    elif isinstance(tree, list):
        for i, value in enumerate(tree):
            yield from bare_numbers(value, f"{path}[{i}]")
    elif isinstance(tree, (int, float)) and not isinstance(tree, bool):
        yield path


def test_unknown_scale_and_up_are_assumed_and_listed(tmp_path: Path) -> None:
    twin = dataclasses.replace(toy_cabinet_twin(1), meters_per_unit=None, up=None)
    write_twin_yaml(twin, tmp_path)
    summary = read_twin_yaml(tmp_path)
    assert summary.document["meters_per_unit"]["value"] == "unknown"
    assert {"meters_per_unit", "up", "parts.base.mass", "joints.part_1_joint.damping"} <= set(
        summary.assumed
    )
    assert "joints.part_1_joint.axis" not in summary.assumed


def test_diagnostics_come_back(tmp_path: Path) -> None:
    write_twin_yaml(toy_cabinet_twin(1), tmp_path)
    summary = read_twin_yaml(tmp_path)
    assert summary.diagnostics("part_1")["vector_field_loss"] == 1e-4
    assert summary.diagnostics("nobody") == {}


@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_a_diagnostic_that_nobody_knows_is_not_written(tmp_path: Path, unknown: float) -> None:
    twin = toy_cabinet_twin(1)
    base, part = twin.parts
    paid = dataclasses.replace(part, diagnostics=part.diagnostics | {"prices_saved": unknown})
    other = dataclasses.replace(twin, parts=(base, paid))
    write_mjcf(other, tmp_path)
    write_twin_yaml(other, tmp_path)
    assert read_twin(tmp_path).parts[1].diagnostics == part.diagnostics


@pytest.mark.parametrize(
    "text", ["", "- 1", "parts: 3", "a: [1", "\x00", "!!python/object:os.system {}"]
)
def test_foreign_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "twin.yaml").write_text(text)
    with pytest.raises(CheckError, match=r"twin\.yaml"):
        read_twin_yaml(tmp_path)
