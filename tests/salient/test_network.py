"""Masks by a network whose file is written here byte by byte: what is red is the object."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from part2gs_robotics.cli import main
from part2gs_robotics.errors import ConfigError
from part2gs_robotics.photos import make_scene as maker
from part2gs_robotics.photos.frames import Photo
from part2gs_robotics.salient.network import MEAN, SPREAD, load_network

pytest.importorskip("onnxruntime")


def field(number, value):
    """Return a field of a protocol buffer: a whole number, text or bytes."""
    if isinstance(value, int):
        out = bytearray([number << 3])
        while value > 127:
            out.append(value & 127 | 128)
            value >>= 7
        return bytes(out) + bytes([value])
    data = value.encode() if isinstance(value, str) else value
    return bytes([number << 3 | 2]) + field(0, len(data))[1:] + data


def tensor(name, shape):
    dims = b"".join(field(1, field(1, n) if isinstance(n, int) else field(2, n)) for n in shape)
    return field(1, name) + field(2, field(1, field(1, 1) + field(2, dims)))


def constant(name, values):
    array = np.asarray(values, np.float32)
    dims = b"".join(field(1, n) for n in array.shape)
    return dims + field(2, 1) + field(8, name) + field(9, array.tobytes())


def network(path, size=(32, 32), channels=3, sigmoid=True, outputs=1):
    """Write a network that says how red a pixel is: a 1 x 1 convolution."""
    red = np.zeros((outputs, channels, 1, 1), np.float32)
    red[:, 0], red[:, 1:] = 20 * SPREAD[0], -20 * SPREAD[1]  # 20 (red - green - blue), nearly
    bias = np.full(outputs, 20 * (MEAN[0] - MEAN[1] - MEAN[2]) - 2.0, np.float32)
    nodes = [field(1, "x") + field(1, "w") + field(1, "b") + field(2, "c") + field(4, "Conv")]
    if sigmoid:
        nodes.append(field(1, "c") + field(2, "y") + field(4, "Sigmoid"))
    last = "y" if sigmoid else "c"
    graph = b"".join([*(field(1, node) for node in nodes), field(2, "red"),
                      field(5, constant("w", red)), field(5, constant("b", bias)),
                      field(11, tensor("x", (1, channels, *size))),
                      field(12, tensor(last, (1, outputs, *size)))])
    path.write_bytes(field(1, 8) + field(7, graph) + field(8, field(1, "") + field(2, 13)))
    return path


def photo():
    rgb = np.full((90, 120, 3), (90, 110, 120), np.uint8)
    rgb[30:60, 40:80] = (230, 20, 20)
    return rgb


@pytest.mark.parametrize("size", [(32, 32), (64, 48), ("h", "w")])
@pytest.mark.parametrize("sigmoid", [True, False])
def test_what_is_red_is_the_object(tmp_path, size, sigmoid):
    mask = load_network(network(tmp_path / "red.onnx", size, sigmoid=sigmoid)).mask(photo())
    truth = np.zeros((90, 120), bool)
    truth[30:60, 40:80] = True
    assert mask.shape == (90, 120)
    overlap = ((mask > 0) & truth).sum() / ((mask > 0) | truth).sum()
    assert overlap > 0.85, "right to a pixel of the network's"


def test_photos_get_masks_but_those_that_have_one(tmp_path):
    model = network(tmp_path / "red.onnx")
    own = np.full((90, 120), 255, np.uint8)
    states = ([Photo("a", photo(), None), Photo("b", photo(), own)], [Photo("c", photo(), None)])
    masked = maker.masked(states, model)
    assert masked[0][1].mask is own
    assert 0 < masked[0][0].mask.mean() < 128
    assert masked[1][0].mask is not None
    assert maker.masked(states, None) is states


@pytest.mark.parametrize(("write", "text"), [
    (lambda p: None, "is no file"), (lambda p: p.write_bytes(b"not a network"), "cannot be run"),
    (lambda p: p.write_bytes(b""), "cannot be run"),
    (lambda p: network(p, channels=1), "Expected one of floats"),
    (lambda p: network(p, outputs=2), "gives an output of shape"),
])
def test_files_that_are_no_network_are_refused(tmp_path, capsys, write, text):
    write(tmp_path / "x.onnx")
    with pytest.raises(ConfigError, match=text):
        load_network(tmp_path / "x.onnx")
    for name in ("closed", "open"):
        (tmp_path / name).mkdir()
        for n in range(20):
            cv2.imwrite(str(tmp_path / name / f"{n}.png"), np.zeros((40, 60, 3), np.uint8))
    words = ["scene", str(tmp_path / "closed"), str(tmp_path / "open"), "-o",
             str(tmp_path / "scene"), "--mask-model", str(tmp_path / "x.onnx")]
    assert main(words) == 2
    assert text in capsys.readouterr().err
    assert not (tmp_path / "scene").exists()
