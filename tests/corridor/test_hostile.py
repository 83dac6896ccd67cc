"""Files made to do harm: nothing escapes, nothing is executed, nobody waits for long."""

from __future__ import annotations

import json
import os
import struct
import time
import zlib
from pathlib import Path

import layout_writers as writers
import numpy as np
import pytest
import yaml
from synth import toy_cabinet_twin
from synth_photos import write_tiny_scene

from part2gs_robotics import cli
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml

SOON, LATE = 2.0, 20.0  # seconds of this process a refusal may take; of the clock, if others work
START = "transforms_train_start.json"
OUTSIDE = ["/etc/passwd", "../../../etc/passwd", "..\\..\\..\\etc\\passwd", "//etc/passwd",
           "start/../../outside/secret.png", "~/../../etc/passwd", "/proc/self/environ",
           "start/./.././../outside/secret.png", "/dev/zero", "file:///etc/passwd",
           "..", ".", "", "/", "C:\\Windows\\win.ini", "\\\\server\\share\\x.png",
           "start/train/../../../outside",
           "\0/etc/passwd", "a" * 100_000, "\u202e../gnp.terces"]  # fmt: skip
MARKUP = ["<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "]]><evil/>", "&xxe;",
          "${7*7}", "$(touch pwned)", "`touch pwned`", "{{7*7}}", "'; DROP TABLE parts; --"]
BILLION = b"".join([b'<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">',
                    *(f'<!ENTITY {b} "{f"&{a};" * 10}">'.encode()
                      for a, b in zip("abcdefgh", "bcdefghi", strict=True)), b"]>"])


def frame(**values):
    """Break one frame of the first state's json."""
    def run(scene):
        content = json.loads((scene / START).read_text())
        content["frames"][3].update(values)
        (scene / START).write_text(json.dumps(content))
    return run


def file(name, content):
    def run(scene):
        path = scene / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return run


def link(name, target):
    """Put a link in the place of a file; the target lies beside the scene."""
    def run(scene):
        outside = scene.parent / "outside"
        outside.mkdir(exist_ok=True)
        path = scene / name
        if path.is_dir():
            path.rename(outside / path.name)
        elif path.exists():
            (outside / path.name).write_bytes(path.read_bytes())
            path.unlink()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(target or outside / path.name)
    return run


def pipe(name):
    def run(scene):
        (scene / name).unlink(missing_ok=True)
        os.mkfifo(scene / name)
    return run


def png(width, height, bits=8, kind=6, data=b"", chunks=b""):
    def chunk(name, body):
        named = name + body
        return struct.pack(">I", len(body)) + named + struct.pack(">I", zlib.crc32(named))
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunks + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def bomb_chunk(name, prefix):
    body = prefix + zlib.compress(bytes(200 << 20), 9)
    return (struct.pack(">I", len(body)) + name + body
            + struct.pack(">I", zlib.crc32(name + body)))


def yaml_bomb():
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join(f'*{a}' for _ in range(9))}]"
              for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    return "\n".join(lines)


FIRST = "start/train/rgba/0000.png"
ARTGS = {
    **{f"file_path {text[:30]!r}": frame(file_path=text) for text in OUTSIDE},
    **{f"mask_path {text[:30]!r}": frame(mask_path=text) for text in OUTSIDE[:6]},
    **{f"depth_file_path {text[:30]!r}": frame(depth_file_path=text) for text in OUTSIDE[:6]},
    "a photo is a link out": link(FIRST, None),
    "the json is a link out": link(START, None),
    "the json is a link to passwd": link(START, "/etc/passwd"),
    "the json is a link to itself": link(START, START),
    "scene.yaml is a link to passwd": link("scene.yaml", "/etc/passwd"),
    "a folder of photos is a link out": link("start/train/rgba", None),
    "the json is a pipe": pipe(START), "a photo is a pipe": pipe(FIRST),
    "a photo of 10^9 pixels a side": file(FIRST, png(10**9, 10**9)),
    "a photo of 2^31 - 1 pixels a side": file(FIRST, png(2**31 - 1, 2**31 - 1)),
    "a small file of 8192 x 4880 pixels": file(FIRST, png(
        8192, 4880, data=zlib.compress(bytes((8192 * 4 + 1) * 4880), 9))),
    "pixels that inflate to 1 GB": file(FIRST, png(48, 48, kind=2,
                                                    data=zlib.compress(bytes(1 << 30), 9))),
    "a text that inflates to 200 MB": file(FIRST, png(48, 48, chunks=bomb_chunk(
        b"zTXt", b"Comment\0\0"))),
    "a profile that inflates to 200 MB": file(FIRST, png(48, 48, chunks=bomb_chunk(
        b"iCCP", b"icc\0\0"))),
    "a JPEG of 65535 pixels a side": file(FIRST, b"\xff\xd8\xff\xc0\0\x11\x08\xff\xff\xff\xff\3"
                                          + bytes(40)),
    "a JPEG of endless segments": file(FIRST, b"\xff\xd8" + b"\xff\xe1\0\2" * 300_000),
    "a photo of 16 bits and no data": file(FIRST, png(48, 48, 16, 2)),
    "json nested 10^6 deep": file(START, "[" * 10**6),
    "json of a number of 10^6 digits": file(START, '{"frames": ' + "9" * 10**6 + "}"),
    "json of 10^5 frames": file(START, json.dumps({"frames": [{}] * 10**5})),
    "json of 70 MB": file(START, '{"frames": [' + " " * (70 << 20) + "]}"),
    "a pose of 10^6 numbers": frame(transform_matrix=[0] * 10**6),
    "a pose nested 500 deep": lambda scene: frame(transform_matrix=json.loads(
        "[" * 500 + "]" * 500))(scene),
    "scene.yaml bomb": file("scene.yaml", yaml_bomb()),
    "scene.yaml nested": file("scene.yaml", "[" * 60_000),
    "scene.yaml runs a command": file("scene.yaml",
                                      "parts: !!python/object/apply:os.system ['touch pwned']"),
    "scene.yaml builds an object": file("scene.yaml", "a: !!python/name:os.remove"),
    "scene.yaml writes elsewhere": file("scene.yaml", "out: ../../../../proc/pwned\nparts: -1"),
    "scene.yaml of merges": file("scene.yaml", "<<: *a\na: 1"),
}  # fmt: skip


def keyframes(content):
    return file("init_keyframes.yml", content)


OTHERS = {
    "PARIS: a key out of the scene": (writers.write_paris, lambda s: file(
        "start/camera_train.json", json.dumps({"K": np.eye(3).tolist(), "../../../../etc/x":
                                               np.eye(4).tolist()}))(s)),
    "DTA: yaml bomb": (writers.write_dta, keyframes(yaml_bomb())),
    "DTA: nested": (writers.write_dta, keyframes("{a: " * 10**6)),
    "DTA: runs a command": (writers.write_dta, keyframes(
        "a: !!python/object/apply:os.system ['touch pwned']")),
    "DTA: a name out of the scene": (writers.write_dta, keyframes(
        "frame_0_../../x:\n  cam_in_ob: []\n  time: 0\n")),
    "DTA: cam_K is a pipe": (writers.write_dta, pipe("cam_K.txt")),
    "DTA: cam_K is a link to /dev/zero": (writers.write_dta, link("cam_K.txt", "/dev/zero")),
    "DTA: photos are a link out": (writers.write_dta, link("color_segmented", None)),
    "COLMAP: 10^9 cameras": (writers.write_colmap, file("sparse/0/cameras.bin",
                                                        struct.pack("<Q", 10**9))),
    "COLMAP: 2^64 - 1 images": (writers.write_colmap, file("sparse/0/images.bin", b"\xff" * 8)),
    "COLMAP: 10^9 keypoints": (writers.write_colmap, file(
        "sparse/0/images.bin", struct.pack("<Qi7di", 1, 1, 1, 0, 0, 0, 0, 0, 4, 7) + b"a/b\0"
        + struct.pack("<Q", 10**9) + bytes(64))),
    "COLMAP: a name of 10^6 letters": (writers.write_colmap, file(
        "sparse/0/images.bin", struct.pack("<Qi7di", 1, 1, 1, 0, 0, 0, 0, 0, 4, 7)
        + b"a" * 10**6)),
    "COLMAP: a name out of the scene": (writers.write_colmap, file(
        "sparse/0/images.bin", struct.pack("<Qi7di", 1, 1, 1, 0, 0, 0, 0, 0, 4, 7)
        + b"../../../../etc/passwd\0" + bytes(8))),
    "COLMAP: the model is a link out": (writers.write_colmap, link("sparse", None)),
    "COLMAP: a file is a link to itself": (writers.write_colmap, link("sparse/0/cameras.bin",
                                                                      "cameras.bin")),
    "COLMAP: a line of 20 MB": (lambda f: writers.write_colmap(f, "txt"),
                                file("sparse/0/images.txt", b"1 " * 10_000_000)),
}  # fmt: skip


def refused(scene, capsys, monkeypatch, words=("-o",)):
    monkeypatch.chdir(scene.parent)
    seen = {p for p in scene.parent.rglob("*") if "scene" not in p.parts}
    began, own = time.perf_counter(), time.process_time()
    code = cli.main(["build", str(scene), "--steps", "1", *words, str(scene.parent / "out")])
    took, own = time.perf_counter() - began, time.process_time() - own
    shown = capsys.readouterr()
    assert code == 2, shown.err[-300:]
    assert "Traceback" not in shown.err + shown.out
    assert "root:" not in shown.err, "not a word of other files"
    assert own < SOON
    assert took < LATE
    assert not (scene.parent / "pwned").exists()
    assert {p for p in scene.parent.rglob("*") if "scene" not in p.parts} == seen
    return shown.err


@pytest.mark.parametrize("name", ARTGS)
def test_scenes_that_mean_harm_are_refused(scene, capsys, monkeypatch, name):
    ARTGS[name](scene)
    refused(scene, capsys, monkeypatch)


@pytest.mark.parametrize("name", OTHERS)
def test_other_layouts_that_mean_harm_are_refused(tmp_path, capsys, monkeypatch, name):
    write, breaking = OTHERS[name]
    breaking(write(tmp_path / "scene"))
    refused(tmp_path / "scene", capsys, monkeypatch)


TWIN_FILES = {
    "yaml bomb": ("twin.yaml", yaml_bomb()), "nested": ("twin.yaml", "[" * 60_000),
    "a command": ("twin.yaml", "parts: !!python/object/apply:os.system ['touch pwned']"),
    "a mesh of 10^9": ("assets/part_1_visual.obj", "v 0 0 0\nf 1 1000000000 2\n"),
    "a mesh of words": ("assets/part_1_visual.obj", "f " + "1 " * 10**6),
    "a picture of 10^9": ("assets/base_texture.png", png(10**9, 10**9)),
}


@pytest.fixture
def twin(tmp_path):
    folder = tmp_path / "twin"
    folder.mkdir()
    write_mjcf(toy_cabinet_twin(2), folder)
    write_twin_yaml(toy_cabinet_twin(2), folder)
    return folder


@pytest.mark.parametrize("name", TWIN_FILES)
def test_twins_that_mean_harm_are_refused(twin, capsys, monkeypatch, name):
    monkeypatch.chdir(twin.parent)
    path, content = TWIN_FILES[name]
    file(path, content)(twin)
    if "picture" in name:
        tree = yaml.safe_load((twin / "twin.yaml").read_text())
        tree["parts"][0]["texture"] = path
        (twin / "twin.yaml").write_text(yaml.safe_dump(tree))
    began = time.process_time()
    code = cli.main(["export", str(twin), "--format", "urdf", "-o", "new"])
    assert time.process_time() - began < SOON
    assert code == 2, capsys.readouterr().err
    assert not Path("pwned").exists()
    assert not Path("new").exists()


@pytest.mark.parametrize("kind", ["mjcf", "urdf", "sdf", "glb"])
@pytest.mark.parametrize("name", MARKUP)
def test_names_of_parts_stay_names(twin, capsys, monkeypatch, name, kind):
    """A part named by markup comes out as a plain name, or is refused; no file breaks."""
    from xml.etree import ElementTree

    monkeypatch.chdir(twin.parent)
    text = (twin / "twin.yaml").read_text()
    (twin / "twin.yaml").write_text(text.replace("name: part_1", f"name: {json.dumps(name)}")
                                    .replace("part: part_1", f"part: {json.dumps(name)}"))
    code = cli.main(["export", str(twin), "--format", kind, "-o", "new"])
    assert code in (0, 2)
    assert "Traceback" not in capsys.readouterr().err
    assert not Path("pwned").exists()
    for model in Path("new").rglob("*"):
        if model.suffix in (".xml", ".urdf", ".sdf"):
            tree = ElementTree.parse(model)
            assert not {node.tag for node in tree.iter()} & {"script", "img", "evil"}


@pytest.mark.slow
def test_markup_in_names_of_scene_and_photos_reaches_no_page_alive(tmp_path):
    scene = write_tiny_scene(tmp_path / "<script>alert(1)<")
    name = "0004<img src=x onerror=alert(1)>.png"
    for state in ("start", "end"):
        photos = scene / state / "train/rgba"
        (photos / "0004.png").rename(photos / name)
        path = scene / f"transforms_train_{state}.json"
        path.write_text(path.read_text().replace("0004.png", name))
    out = tmp_path / "out"
    assert cli.main(["build", str(scene), "-o", str(out), "--quiet"]) in (0, 1)
    page = (out / "report.html").read_text()
    assert "<img src=x" not in page
    assert "<script>alert" not in page


def test_there_are_enough():
    assert len(ARTGS) + len(OTHERS) + len(TWIN_FILES) + 4 * len(MARKUP) >= 60
