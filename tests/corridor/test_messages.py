"""What every message says: the value, the place, what was expected, and what to do about it.

Cases here go through the command line; earlier output must stay as it was. With the broken scenes
of tests/readers this is the table of bad inputs.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
from synth import put, toy_cabinet_twin

from part2gs_robotics import cli
from part2gs_robotics.config import BOUNDS, options
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml

WANTED = re.compile(r"Expected|expected one of|Needed|Nearest valid")
REMEDY = re.compile(r"; |Change the value|see --help|for example|Rename or remove|, or the name")


def beyond(name: str) -> list[tuple[str, object]]:
    """Return values just outside of what a setting may be."""
    low, high = BOUNDS[name]
    whole = options()[name].kinds[0] is int
    step = 1 if whole else max(abs(high), 1e-9) * 0.01
    low_step = 1 if whole else max(abs(low), 1e-9) * 0.5
    return [(name, low - low_step), (name, high + step)]


OUT_OF_BOUNDS = [case for name in BOUNDS for case in beyond(name)]
WRONG_TYPES = [
    ("parts", "two"), ("parts", 1.5), ("parts", True), ("seed", None), ("steps", "1e3x"),
    ("scale", "metre"), ("scale", float("nan")), ("known_length", float("inf")),
    ("material", "cheese"), ("material", 1e9), ("up", [0, 0]), ("up", [0, 0, 0]), ("up", "z"),
    ("up", [0, 0, float("nan")]), ("preset", "best"), ("device", "tpu"), ("depth", "yes please"),
    ("stereo", 3), ("out", 7), ("quiet", "no"), ("convex", []), ("max_side", {}),
    ("alpha_weight", "high"), ("marker_size", [6]), ("frames", "all"), ("side", 1024.5)]
UNKNOWN = ["partz", "scael", "max-sides", "PARTS!", "", "1", "up.z", "read.scale", "none", "<b>"]


def earlier(out: Path) -> None:
    """Write what a build before left."""
    (out / "assets").mkdir(parents=True)
    for name in ("twin.xml", "report.html", "assets/base_visual.obj"):
        (out / name).write_text(f"earlier {name}")


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.fixture
def refused(tmp_path, capsys, monkeypatch):
    """Return a function that runs words and checks all that a refusal must be."""
    monkeypatch.chdir(tmp_path)
    earlier(tmp_path / "out")

    def run(*words: str, says: tuple[str, ...] = ()) -> None:
        before = contents(tmp_path)
        code = cli.main(list(words))
        shown = capsys.readouterr()
        assert code == 2, shown.err
        assert "Traceback" not in shown.err + shown.out
        assert shown.err.startswith("error: ")
        assert WANTED.search(shown.err), shown.err
        assert REMEDY.search(shown.err), shown.err
        assert len(shown.err) < 2500, "a message is read by a person"
        for text in says:
            assert text in shown.err, shown.err
        assert contents(tmp_path) == before, "earlier output is untouched, nothing is added"

    return run


@pytest.mark.parametrize(("name", "value"), [*OUT_OF_BOUNDS, *WRONG_TYPES])
def test_settings_in_scene_yaml(ball_scene, tmp_path, refused, name, value):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene/scene.yaml").write_text(yaml.safe_dump({name: value}))
    refused("build", "scene", "-o", "out", says=("scene.yaml", name))


@pytest.mark.parametrize(("name", "value"), OUT_OF_BOUNDS)
def test_settings_as_flags(refused, name, value):
    refused("build", "scene", "-o", "out", f"{options()[name].flag}={value!r}",
            says=(options()[name].flag, str(value)))


@pytest.mark.parametrize("key", UNKNOWN)
def test_keys_that_are_none(tmp_path, refused, key):
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene/scene.yaml").write_text(yaml.safe_dump({key: 1}))
    refused("build", "scene", "-o", "out", says=("scene.yaml", "Nearest valid name"))


WORDS = {
    "": "no command", "bulid scene": "no command (bulid", "build": "got 0 paths",
    "build a b c": "got 3 paths", "build nothing": "nothing: is missing",
    "build --partz 2 scene": "--partz", "build scene --views 3": "belongs to capture",
    "build scene --up 0 1": "--up", "build scene --scale 1 --known-length 2": "one of them",
    "build scene --quiet=yes": "quiet", "build photos_a photos_b -o out": "photos_a: is missing",
    "build photos photos -o photos/out": "lies in the scene folder photos",
    "build photos photos -o out --scale 2": "--scale is 2",
    "build photos photos -o out/twin.xml": "is a file",
    "scene photos": "got 1 paths", "scene nothing photos -o new": "nothing: is missing",
    "scene photos photos -o new": "0 photos", "scene photos photos -o out": "not empty",
    "scene photos photos -o new --frames 2": "--frames is 2",
    "scene photos photos -o new --side big": "--side is 'big'",
    "scene photos photos -o new --marker-size 0": "--marker-size is 0",
    "scene photos photos -o new --known-length -1": "--known-length is -1",
    "scene note.txt photos -o new": "a file of another kind",
    "marker x": "got 1 paths", "marker -o sheet.png": "ends in .pdf",
    "inspect": "got 0 paths", "inspect nothing": "nothing: is missing",
    "inspect note.txt": "note.txt: is a file", "inspect photos": "no cameras found",
    "check": "got 0 paths", "check nothing": "nothing", "check photos": "photos",
    "check note.txt": "note.txt", "check out --format xml": "--format is 'xml'",
    "check out --sweep-values 1": "--sweep-values is 1", "explain": "got 0 paths",
    "explain magic": "magic", "export out": "no --format",
    "export photos --format glb": "twin.yaml",
    "export nothing --format urdf": "nothing", "export out --format obj": "--format is 'obj'",
    "capture model.xml": "got 1 paths", "capture nothing.xml new": "nothing.xml",
    "batch": "got 0 paths", "batch nothing -o new": "nothing: is missing",
    "batch photos -o new --workers 0": "--workers is 0", "batch photos --on moon": "--on is 'moon'",
    "batch photos -o new --retries many": "--retries is 'many'",
    "batch photos other/photos -o new": "would both be",
    "batch photos -o out/twin.xml": "is a file",
    "batch photos -o new --parts 0": "--parts is 0", "completion": "got 0 paths",
    "completion tcsh": "'tcsh' is not known", "doctor now": "got 1 paths",
    "capture note.txt new": "note.txt", "capture note.txt new --views none": "--views is 'none'",
}  # fmt: skip


@pytest.mark.parametrize("words", WORDS)
def test_words(tmp_path, refused, words):
    (tmp_path / "photos").mkdir()
    (tmp_path / "other/photos").mkdir(parents=True)
    (tmp_path / "note.txt").write_text("a note")
    refused(*words.split(), says=(WORDS[words],))


TWINS = [
    ("format", None), ("format", "two"), ("format", -1), ("parts", None), ("parts", "x"),
    ("parts", {}), ("parts", [[]]), ("parts.1", None), ("parts.1.name", None),
    ("parts.1.name", ""), ("parts.1.parent", "part_1"), ("parts.1.parent", 5),
    ("parts.1.visual_mesh", None), ("parts.1.visual_mesh", "assets/nothing.obj"),
    ("parts.1.visual_mesh", "assets/../../secret.obj"), ("parts.1.visual_mesh", ["a"]),
    ("parts.1.collision_meshes", "x"), ("parts.1.collision_meshes", [3]),
    ("parts.1.collision_meshes", ["/etc/hostname"]), ("joints", None), ("joints", "x"),
    ("joints.0", None), ("joints.0.part", "part_9"), ("joints.0.type", None),
    ("joints.0.type", ["revolute"]), ("joints.0.axis", None), ("joints.0.axis.value", None),
    ("joints.0.axis.value", [0, 0, 0]), ("joints.0.axis.value", [1, 0]),
    ("joints.0.origin.value", "here"), ("joints.0.origin.value", [1e400, 0, 0]),
    ("joints.0.range.value", [0]), ("joints.0.range.value", ["a", "b"]),
    ("joints.0.state_1.value", None), ("joints.0.state_1.value", [1]),
    ("meters_per_unit", 3), ("meters_per_unit.value", 0), ("meters_per_unit.value", "m"),
    ("up.value", "up"), ("notes", {"a": 1}), ("material", 4)]


@pytest.fixture(scope="module")
def twin_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin")
    write_mjcf(toy_cabinet_twin(2), folder)
    write_twin_yaml(toy_cabinet_twin(2), folder)
    return folder


@pytest.mark.parametrize(("path", "value"), TWINS)
def test_twins(twin_folder, tmp_path, refused, path, value):
    (tmp_path / "twin").mkdir()
    (tmp_path / "twin/assets").symlink_to(twin_folder / "assets")
    tree = yaml.safe_load((twin_folder / "twin.yaml").read_text())
    put(path, value)(tree)
    (tmp_path / "twin/twin.yaml").write_text(yaml.safe_dump(tree))
    refused("export", "twin", "--format", "urdf", "-o", "new", says=("twin",))


def test_there_are_enough_cases():
    count = len(OUT_OF_BOUNDS) * 2 + len(WRONG_TYPES) + len(UNKNOWN) + len(WORDS) + len(TWINS)
    assert count >= 150
