"""Plain photos to a twin in one command: the scene is made once, kept, or made again."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import photo_room as room
import pytest
from synth_photos import write_tiny_scene

from part2gs_robotics import cli
from part2gs_robotics.commands.from_photos import scene_of_photos, settings_for
from part2gs_robotics.config import resolve
from part2gs_robotics.errors import ConfigError, SceneError, StoreError
from part2gs_robotics.photos import make_scene as maker


@pytest.fixture
def photos(tmp_path):
    """Two folders of small files: what they show does not matter here."""
    for name in ("closed", "open"):
        (tmp_path / name).mkdir()
        for n in range(3):
            (tmp_path / name / f"{n}.jpg").write_bytes(f"{name} {n}".encode())
    return tmp_path / "closed", tmp_path / "open"


@pytest.fixture
def made(monkeypatch):
    """Put a drawn scene in the place of the one that pycolmap finds; count how often it is made."""
    calls = []

    def make(sources, out, wishes):
        calls.append(wishes)
        write_tiny_scene(out)
        (out / "scene.json").write_text(json.dumps({"registered": [24, 24]}))
        return maker.Made((24, 24), (24, 24), None, {})

    monkeypatch.setattr(maker, "make_scene", make)
    return calls


def test_a_scene_is_made_once(photos, tmp_path, made):
    config, out = resolve({"quiet": True}), tmp_path / "out"
    assert scene_of_photos(photos, out, config) == out / "scene"
    assert len(made) == 1
    scene_of_photos(photos, out, config)
    assert len(made) == 1, "unchanged photos: the scene is kept"
    events = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [e["resumed"] for e in events if e.get("stage") == "scene"] == [False, True]
    assert not list(out.glob("**/*tmp-*")) + list(out.glob("**/.new-*"))


@pytest.mark.parametrize("what", ["a photo", "one photo more", "a setting", "the scene", "a mask",
                                  "the record"])
def test_a_scene_of_other_photos_is_made_again(photos, tmp_path, made, what):
    out = tmp_path / "out"
    scene_of_photos(photos, out, resolve({"quiet": True}))
    flags = {"quiet": True}
    if what == "a photo":
        (photos[1] / "2.jpg").write_bytes(b"another")
    elif what == "one photo more":
        (photos[0] / "9.jpg").write_bytes(b"one more")
    elif what == "a setting":
        flags["side"] = 800
    elif what == "the scene":
        next((out / "scene").rglob("*.png")).write_bytes(b"torn")
    elif what == "a mask":
        (photos[0] / "masks").mkdir()
        (photos[0] / "masks/0.png").write_bytes(b"mask")
    else:
        (out / "stages/00_scene.json").write_text("{")
    scene_of_photos(photos, out, resolve(flags))
    assert len(made) == 2
    assert len(list((out / "scene").rglob("*.png"))) == 48


def test_a_failure_keeps_the_earlier_scene(photos, tmp_path, made, monkeypatch):
    out = tmp_path / "out"
    scene_of_photos(photos, out, resolve({"quiet": True}))
    before = {p: p.read_bytes() for p in (out / "scene").rglob("*") if p.is_file()}
    (photos[1] / "2.jpg").write_bytes(b"another")

    def fails(sources, target, wishes):
        target.mkdir()
        raise SceneError("photos do not register")

    monkeypatch.setattr(maker, "make_scene", fails)
    with pytest.raises(SceneError, match="do not register"):
        scene_of_photos(photos, out, resolve({"quiet": True}))
    assert {p: p.read_bytes() for p in (out / "scene").rglob("*") if p.is_file()} == before
    assert not list(out.glob(".new-*"))


def test_photos_are_never_written_to(photos, tmp_path):
    for out in (photos[0], photos[1] / "out"):
        with pytest.raises(StoreError, match="folder of photos"):
            scene_of_photos(photos, out, resolve({}))
    with pytest.raises(SceneError, match="nowhere: is missing"):
        scene_of_photos((photos[0], tmp_path / "nowhere"), tmp_path / "out", resolve({}))
    assert not (tmp_path / "out").exists()


def test_a_scale_of_units_that_do_not_exist_yet_is_refused(photos, tmp_path):
    with pytest.raises(ConfigError, match=r"--scale is 2\. Expected none with plain photos"):
        scene_of_photos(photos, tmp_path / "out", resolve({"scale": 2.0}))


def test_markers_win_over_a_tape():
    assert settings_for({"known_length": 0.5, "seed": 1}, {"scale": 1.0}) == {"seed": 1}
    assert settings_for({"known_length": 0.5}, {"known_length": 0.5}) == {"known_length": 0.5}


def test_the_twin_is_named_by_its_folder(photos, tmp_path, made, capsys):
    out = tmp_path / "My Cupboard"
    words = ["build", *map(str, photos), "-o", str(out), "--quiet"]
    assert cli.main(words) in (0, 1), capsys.readouterr().err
    assert 'model="my_cupboard"' in (out / "twin.xml").read_text()
    assert (out / "scene/scene.yaml").is_file(), "the scene is there, and the next run takes it"


@pytest.mark.slow
def test_photos_alone_become_a_twin(tmp_path):
    shots, _, _ = room.two_states(24)
    for state, name in enumerate(("closed", "open")):
        (tmp_path / name).mkdir()
        for n, rgb in enumerate(shots[state]):
            cv2.imwrite(str(tmp_path / name / f"{n:02d}.png"), np.ascontiguousarray(rgb[..., ::-1]))
    words = ["build", str(tmp_path / "closed"), str(tmp_path / "open"), "-o",
             str(tmp_path / "out"), "--preset", "draft", "--side", "480"]
    assert cli.main(words) in (0, 1)
    assert Path(tmp_path / "out/twin.xml").is_file()
    assert (tmp_path / "out/scene/scene.json").is_file()
