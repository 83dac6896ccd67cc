"""A twin folder read back: the same twin, and words for every damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from random_twins import random_twin
from synth import put, toy_cabinet_twin

from part2gs_robotics import cli
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.exporters.sound import sound_twin
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.model.twin import Twin

FORMATS = ("mjcf", "urdf", "usd", "sdf", "glb")


def stored(twin: Twin, folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    write_mjcf(twin, folder)
    write_twin_yaml(twin, folder)
    return folder


@pytest.mark.parametrize("seed", range(12))
def test_what_is_read_is_what_was_written(seed: int, tmp_path: Path) -> None:
    twin = sound_twin(random_twin(seed))
    read = read_twin(stored(twin, tmp_path))
    for key in ("name", "meters_per_unit", "assumed_meters", "material", "notes"):
        assert getattr(read, key) == getattr(twin, key)
    assert (read.up is None) == (twin.up is None)
    for one, two in zip(twin.parts, read.parts, strict=True):
        for key in ("name", "parent", "limits", "limits_source", "num_gaussians", "diagnostics"):
            assert getattr(one, key) == getattr(two, key)
        np.testing.assert_array_equal(one.mesh.faces, two.mesh.faces)
        np.testing.assert_array_equal(one.mesh.colors, two.mesh.colors)
        np.testing.assert_allclose(one.mesh.vertices, two.mesh.vertices, rtol=1e-8)
        assert one.mesh.synthesised == two.mesh.synthesised
        assert (one.mesh.texture is None) == (two.mesh.texture is None)
        if one.mesh.texture is not None:
            np.testing.assert_array_equal(one.mesh.texture.image, two.mesh.texture.image)
            np.testing.assert_allclose(one.mesh.texture.uv, two.mesh.texture.uv, atol=1e-6)
        if one.joint is not None:
            assert (one.joint.kind, one.joint.value, one.joint.pitch) == (
                two.joint.kind, two.joint.value, two.joint.pitch)
            np.testing.assert_array_equal(one.joint.axis, two.joint.axis)
            np.testing.assert_array_equal(one.joint.origin, two.joint.origin)


def test_a_second_reading_changes_no_byte(tmp_path: Path) -> None:
    first = stored(toy_cabinet_twin(4), tmp_path / "a")
    second = stored(read_twin(first), tmp_path / "b")
    third = stored(read_twin(second), tmp_path / "c")
    for file in second.rglob("*.*"):
        assert file.read_bytes() == (third / file.relative_to(second)).read_bytes(), file


def test_a_folder_of_the_first_format_is_read(tmp_path: Path) -> None:
    folder = stored(toy_cabinet_twin(2), tmp_path)
    text = (folder / "twin.yaml").read_text().replace("assets/", "").replace("format: 2",
                                                                             "format: 1")
    (folder / "twin.yaml").write_text("\n".join(line for line in text.splitlines()
                                                if "texture:" not in line))
    for file in (folder / "assets").iterdir():
        file.rename(folder / file.name)
    assert len(read_twin(folder).parts) == 3


@pytest.mark.parametrize(("path", "value", "said"), [
    ("format", 99, "has format 99"), ("parts", [], "has 0 parts"), ("parts", [3], "mapping"),
    ("joints", [], "has no joint"), ("parts.1.parent", "nobody", "has parent 'nobody'"),
    ("parts.1.name", "base", "has parent"), ("parts.0.visual_mesh", "../x.obj", "not there"),
    ("parts.0.visual_mesh", "/etc/passwd", "not there"), ("parts.0.visual_mesh", 7, "not there"),
    ("parts.0.texture", "assets/base_visual.obj", "is no PNG"),
    ("parts.0.collision_meshes", None, "a list"), ("joints.0.type", "ball", "has type 'ball'"),
    ("joints.0.axis.value", [0, 0, 2.0], "has length 2"),
    ("joints.0.axis.value", ["a", "b", "c"], "finite numbers"),
    ("joints.0.origin.value", [0, float("nan"), 0], "3 finite numbers"),
    ("joints.0.range.value", [1.0, 0.0], "lower end"), ("joints.0.state_1.value", "x", "finite"),
    ("meters_per_unit.value", -1.0, "positive"), ("up.value", [0, 0], "3 finite numbers"),
    ("up.value", [0, 0, 3.0], "has length 3"), ("notes", 5, "a list"),
])
def test_damage_is_named_and_exits_2(path: str, value: object, said: str, tmp_path: Path,
                                     capsys: pytest.CaptureFixture[str]) -> None:
    folder = stored(toy_cabinet_twin(2), tmp_path / "t")
    tree = yaml.safe_load((folder / "twin.yaml").read_text())
    put(path, value)(tree)
    (folder / "twin.yaml").write_text(yaml.safe_dump(tree))
    with pytest.raises(CheckError, match=said):
        read_twin(folder)
    assert cli.main(["export", str(folder), "--format", "glb"]) == 2
    assert not (folder / "glb").exists()
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("text", [
    "", "v 0 0\n", "v 0 0 0\nf 1 2 3\n", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 1\n", "\xff\xfe\x00",
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "v 0 0 1e30\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "v a b c\nf 1 1 1\n",
    f"v 0 0 0\nf 1 {'9' * 400} 1\n", "v " + "x" * 9000 + "\n",
    "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -3\n",
])
def test_a_damaged_mesh_is_named(text: str, tmp_path: Path) -> None:
    folder = stored(toy_cabinet_twin(1), tmp_path)
    (folder / "assets/part_1_visual.obj").write_text(text)
    with pytest.raises(CheckError, match=r"part_1_visual.obj: is not a mesh of triangles") as told:
        read_twin(folder)
    assert len(str(told.value)) < 1000, "a message is read by a person"


@pytest.mark.parametrize("kind", FORMATS)
def test_the_command_writes_every_format(kind: str, tmp_path: Path,
                                         capsys: pytest.CaptureFixture[str]) -> None:
    folder = stored(toy_cabinet_twin(4), tmp_path / "t")
    before = {f: f.read_bytes() for f in folder.rglob("*") if f.is_file()}
    for _ in range(2):  # the same command again replaces its files
        assert cli.main(["export", str(folder), "--format", kind]) == 0
    assert " files: " in capsys.readouterr().out
    assert any((folder / kind).iterdir())
    assert all(f.read_bytes() == data for f, data in before.items())
    assert not [f for f in folder.rglob("*") if ".new-" in f.name or ".tmp-" in f.name]


@pytest.mark.parametrize(("words", "said"), [
    ([], "export got no --format"), (["--format", "obj"], "--format"),
    (["--format", "glb", "-o", "{}"], "is the twin folder itself"),
])
def test_wrong_words_exit_2(words: list[str], said: str, tmp_path: Path,
                            capsys: pytest.CaptureFixture[str]) -> None:
    folder = stored(toy_cabinet_twin(1), tmp_path)
    assert cli.main(["export", str(folder), *(w.format(folder) for w in words)]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_without_a_twin_exits_2(tmp_path: Path) -> None:
    assert cli.main(["export", str(tmp_path), "--format", "sdf"]) == 2
