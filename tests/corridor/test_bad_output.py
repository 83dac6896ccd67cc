"""An output that cannot be written ends with exit code 2 and keeps what was there before."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from part2gs_robotics.runtime import store

Build = Callable[..., tuple[int, str]]


@pytest.mark.parametrize(("out", "fragments"), [
    ("taken", ("is a file", "-o")),
    ("taken/out", ("taken: is a file", "-o")),
    ("/proc/part2gs_out", ("/proc/part2gs_out", "cannot be written")),
    ("scene", ("never written",)),
    ("scene/out", ("never written",)),
])
def test_folder_that_cannot_be_the_output_is_refused(
    scene: Path, tmp_path: Path, out: str, fragments: tuple[str, ...],
    assert_refused: Callable[..., None],
) -> None:
    (tmp_path / "taken").write_text("a file")
    assert_refused(scene, fragments, "-o", str(tmp_path / out))


def test_full_disk_keeps_earlier_results(ball_scene: Path, tmp_path: Path,
                                         monkeypatch: pytest.MonkeyPatch,
                                         build: Build) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "twin.xml").write_text("earlier")

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    code, message = build(ball_scene, "-o", str(out))
    assert code == 2
    assert "No space left" in message
    assert "free some space" in message
    assert (out / "twin.xml").read_text() == "earlier"
    assert not [path for path in out.rglob("*") if ".tmp-" in path.name]


def test_too_little_free_space_is_refused_before_fitting(
    ball_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    build: Build,
) -> None:
    monkeypatch.setattr(store, "NEEDED_BYTES", 1 << 60)
    code, message = build(ball_scene, "-o", str(tmp_path / "out"))
    assert code == 2
    assert "MB free" in message


def test_unwritable_kernel_cache_is_named(ball_scene: Path, tmp_path: Path,
                                          monkeypatch: pytest.MonkeyPatch,
                                          build: Build) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "cache"))
    code, message = build(ball_scene, "-o", str(tmp_path / "out"))
    assert code == 2
    assert "NUMBA_CACHE_DIR" in message
    assert not (tmp_path / "out").exists()


def test_second_build_in_one_folder_is_refused(ball_scene: Path, tmp_path: Path,
                                               build: Build) -> None:
    first = store.Store(tmp_path / "out")
    first.prepare()
    with first.locked():
        code, message = build(ball_scene, "-o", str(tmp_path / "out"))
    assert code == 2
    assert f"pid {os.getpid()} on" in message


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind the superuser")
def test_read_only_output_is_refused(ball_scene: Path, tmp_path: Path,
                                     build: Build) -> None:
    out = tmp_path / "out"
    out.mkdir(mode=0o500)
    code, message = build(ball_scene, "-o", str(out))
    assert code == 2
    assert "Permission denied" in message


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_write_to_a_full_device_is_a_store_error(tmp_path: Path) -> None:
    target = tmp_path / f"report.json.tmp-{os.getpid()}"
    target.symlink_to("/dev/full")
    with pytest.raises(store.StoreError, match="No space left"):
        store.write_bytes_atomic(tmp_path / "report.json", b"x" * 100_000)
    assert not (tmp_path / "report.json").exists()
