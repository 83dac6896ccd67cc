"""Which device renders, and what is said where CUDA cannot."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.render import cpu as render_cpu
from part2gs_robotics.render import pick_device as device
from part2gs_robotics.render.pick_device import describe, pick_device
from part2gs_robotics.runtime.device import current_device, rendering_on

NO_LIBRARY = "libsurely-not-there.so.1"


@pytest.fixture(autouse=True)
def _asked_anew() -> Iterator[None]:
    device.why_not_cuda.cache_clear()
    yield
    device.why_not_cuda.cache_clear()


@pytest.fixture
def no_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make any machine one without an NVIDIA driver."""
    monkeypatch.setattr(device, "DRIVER", NO_LIBRARY)


@pytest.fixture
def some_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a library that is everywhere pass for the driver."""
    monkeypatch.setattr(device, "DRIVER", None)  # the program itself


def gsplat_is(monkeypatch: pytest.MonkeyPatch, version: str | None) -> None:
    def ask(name: str) -> str:
        assert name == "gsplat"
        if version is None:
            raise metadata.PackageNotFoundError(name)
        return version

    monkeypatch.setattr(device, "metadata", SimpleNamespace(
        version=ask, PackageNotFoundError=metadata.PackageNotFoundError))


@pytest.mark.usefixtures("no_driver")
def test_without_a_driver_auto_takes_the_cpu_and_says_why() -> None:
    assert pick_device("auto") == "cpu"
    assert describe("auto", "cpu") == f"the CPU: no NVIDIA driver is loaded ({NO_LIBRARY} is not " \
                                      "found)"
    assert describe("cpu", "cpu") == "the CPU: --device is cpu"


@pytest.mark.usefixtures("no_driver")
def test_cuda_without_a_driver_is_refused_in_four_parts() -> None:
    with pytest.raises(ConfigError) as refused:
        pick_device("cuda")
    message = str(refused.value)
    for part in ("--device is cuda", "no NVIDIA driver", "Expected an NVIDIA GPU", "nvcc",
                 "--device cpu", "minutes rather than seconds"):
        assert part in message


@pytest.mark.usefixtures("some_driver")
@pytest.mark.parametrize(("version", "words"), [
    (None, "gsplat is not installed: pip install 'part2gs-robotics[gpu]'"),
    ("1.4.0", "gsplat is 1.4.0, older than 1.5.3"), ("0.1.13", "older than 1.5.3")])
def test_gsplat_that_is_missing_or_old_is_named(monkeypatch: pytest.MonkeyPatch,
                                                version: str | None, words: str) -> None:
    gsplat_is(monkeypatch, version)
    with pytest.raises(ConfigError, match="--device is cuda") as refused:
        pick_device("cuda")
    assert words in str(refused.value)
    assert pick_device("auto") == "cpu"


@pytest.mark.usefixtures("some_driver")
@pytest.mark.parametrize("version", ["1.5.3", "1.5.3+pt24cu124", "1.6", "2.0.1"])
def test_torch_without_cuda_is_named(monkeypatch: pytest.MonkeyPatch, version: str) -> None:
    import torch

    gsplat_is(monkeypatch, version)
    monkeypatch.setattr(torch.version, "cuda", None)
    assert device.why_not_cuda() == f"torch {torch.__version__} is built without CUDA"
    monkeypatch.setattr(torch.version, "cuda", "12.8")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    device.why_not_cuda.cache_clear()
    assert "finds no CUDA device" in str(device.why_not_cuda())


def test_kernels_that_fail_are_a_reason_not_a_crash(monkeypatch: pytest.MonkeyPatch,
                                                    capsys: pytest.CaptureFixture[str]) -> None:
    from part2gs_robotics.render import cuda as render_cuda

    monkeypatch.setattr(render_cuda, "DEVICE", "cuda:99")  # drawn nowhere, with or without a GPU
    reason = device._no_kernels()
    assert reason is not None
    assert reason.startswith("gsplat draws nothing here (")
    assert capsys.readouterr().out == ""


def test_cpu_looks_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def looked() -> str | None:
        raise AssertionError

    monkeypatch.setattr(device, "why_not_cuda", looked)
    assert pick_device("cpu") == "cpu"


def test_block_ends_with_the_device_it_began_with() -> None:
    assert current_device() == "cpu"
    with rendering_on("cuda"):
        assert current_device() == "cuda"
        with rendering_on("cpu"):
            assert current_device() == "cpu"
        assert current_device() == "cuda"
    with pytest.raises(ValueError, match="stop"), rendering_on("cuda"):
        raise ValueError("stop")
    assert current_device() == "cpu"


@pytest.mark.usefixtures("one_numba_thread")
def test_gradient_is_taken_where_the_image_was_drawn() -> None:
    from part2gs_robotics.render.dispatch import render, render_backward

    one = np.ones((1, 3))
    splats = Splats(one * [0, 0, 2], np.ones((1, 4)), 0.1 * one, np.array([0.9]), one)
    K = np.array([[40.0, 0, 8], [0, 40, 8], [0, 0, 1]])
    drawn = render(splats, Camera(np.eye(4), K, 16, 16))
    expected = render_cpu.render_backward(drawn, np.ones_like(drawn.color)).opacities.copy()
    with rendering_on("cuda"):
        gradients = render_backward(drawn, np.ones_like(drawn.color))
    np.testing.assert_array_equal(gradients.opacities, expected)


@pytest.mark.usefixtures("no_driver")
def test_build_refuses_cuda_it_does_not_have(scene: Path,
                                             assert_refused: Callable[..., None],
                                             tmp_path: Path) -> None:
    assert_refused(scene, ("--device is cuda", "no NVIDIA driver", "cpu"), "--device", "cuda", "-o",
                   str(tmp_path / "out"))


@pytest.mark.usefixtures("no_driver")
def test_build_refuses_cuda_of_scene_yaml(scene: Path, assert_refused: Callable[..., None],
                                          tmp_path: Path) -> None:
    (scene / "scene.yaml").write_text(yaml.safe_dump({"device": "cuda"}))
    assert_refused(scene, ("--device is cuda", "cpu"), "-o", str(tmp_path / "out"))
